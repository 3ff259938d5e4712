// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/number_ranges.h"

#include <cstdio>

#include <iterator>

namespace trocar::pipeline {

std::string text_of(double value) {
  char out[32];
  std::snprintf(out, sizeof out, "%.7g", value);
  return out;
}

std::string number_ranges(const std::set<int>& numbers, const std::string& separator) {
  constexpr int kMostRuns = 20;
  std::string out;
  int runs = 0;
  for (auto first = numbers.begin(); first != numbers.end();) {
    if (runs++ == kMostRuns)
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

std::string named_ranges(const std::string& name, const std::set<int>& numbers) {
  return name + (numbers.size() == 1 ? " " : "s ") + number_ranges(numbers);
}

}  // namespace trocar::pipeline
