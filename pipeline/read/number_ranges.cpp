// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/number_ranges.h"

#include <cstdio>
#include <iterator>

namespace trocar::pipeline {

std::string text_of(double value, int digits) {
  char out[32];
  std::snprintf(out, sizeof out, "%.*g", digits, value);
  return out;
}

std::string number_ranges(const std::set<int>& numbers, const std::string& separator,
                          int max_runs) {
  std::string out;
  int runs = 0;
  for (auto first = numbers.begin(); first != numbers.end();) {
    if (runs++ == max_runs)
      return out + " and " + std::to_string(std::distance(first, numbers.end())) + " more";
    auto last = first, next = std::next(first);
    while (next != numbers.end() && *next == *last + 1)
      last = next++;
    if (!out.empty()) out += separator;
    out += std::to_string(*first);
    if (last != first) out.append("-").append(std::to_string(*last));
    first = next;
  }
  return out;
}

std::string named_ranges(const std::string& name, const std::set<int>& numbers, int max_runs) {
  return name + (numbers.size() == 1 ? " " : "s ") + number_ranges(numbers, ", ", max_runs);
}

}  // namespace trocar::pipeline
