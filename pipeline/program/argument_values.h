// SPDX-License-Identifier: GPL-3.0-or-later
// Reads option values that consist of several numbers, or of a list of labels.
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

/// The numbers in `text`, in their order. `pattern` is the form of the text with a # for each
/// number: "#:#" for "3:12". Errors: kUsage if the text has another form; the message is "OPTION
/// TEXT: must be LIKE".
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

/// Adds the labels of `list`, such as "7,20-24" for 7 and 20 to 24, to `labels`. If `joined` is not
/// null, the list may also join labels by +, as in "20+21", so that they form one material. Joined
/// labels are added to `joined` as one set, and not to `labels`. Errors: kUsage if the list is
/// wrong; the message names `option`.
Result<void> add_labels(const std::string& option, const std::string& list, std::set<int>& labels,
                        std::vector<std::set<int>>* joined = nullptr);

/// The union of the labels in all values of --labels. A value is a list or "all". Errors: kUsage
/// if a list is wrong, or if a label would belong to two materials.
Result<Labels> labels(const std::vector<std::string>& lists);

}  // namespace trocar::pipeline
