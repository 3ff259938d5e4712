// SPDX-License-Identifier: GPL-3.0-or-later
// Reads values of options with a special form: several numbers, or lists of labels.
// Tests: tests/pipeline/program/parameters_test.cpp
#pragma once

#include <algorithm>
#include <set>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/segment/segmentation.h"

namespace trocar::pipeline {

/// The numbers in a text such as "A:B", "X,Y,Z" or "X0:X1,Y0:Y1". `pattern` has a # for each
/// number, and the text must match the pattern completely. Errors: kUsage if it does not; the
/// message says that the value of `option` must be `like`.
template <typename T>
Result<std::vector<T>> numbers(const std::string& text, std::string_view pattern,
                               const std::string& option, const char* like) {
  std::vector<T> out;
  std::istringstream in(text);
  for (const char c : pattern) {
    if (c == '#') {
      T value{};
      if (!(in >> value)) break;
      out.push_back(value);
    } else if (in.get() != c) {
      break;
    }
  }
  if (in.fail() || in.peek() != std::char_traits<char>::eof() ||
      out.size() != static_cast<std::size_t>(std::count(pattern.begin(), pattern.end(), '#'))) {
    return usage(option + " " + text + ": must be " + like);
  }
  return out;
}

/// Adds the labels of a list to `labels`. The elements of a list are L or A-B, with commas between
/// them. If `joined` is given, elements may also be joined by +, and each set of joined labels is
/// added to `joined` instead. Errors: kUsage if the list is wrong.
Result<void> add_labels(const std::string& option, const std::string& list, std::set<int>& labels,
                        std::vector<std::set<int>>* joined = nullptr);

/// The labels of all values of --labels. Errors: kUsage if a list is wrong.
Result<Labels> labels(const std::vector<std::string>& lists);

}  // namespace trocar::pipeline
