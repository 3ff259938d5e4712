// SPDX-License-Identifier: GPL-3.0-or-later
// Texts for messages: a number, or a list of whole numbers such as "0-46, 50".
#pragma once

#include <set>
#include <string>

namespace trocar::pipeline {

/// A value for messages, with at most `digits` significant digits, such as "226" or "0.3125".
std::string text_of(double value, int digits = 7);

/// Lists the numbers in ascending order, such as "0-46, 50". Consecutive numbers are written as one
/// range A-B, and a single number counts as a range, too. `separator` stands between two ranges. If
/// there are more than `max_runs` ranges, the text has the first `max_runs`, and ends with how many
/// numbers are left (" and 7 more").
std::string number_ranges(const std::set<int>& numbers, const std::string& separator = ", ",
                          int max_runs = 20);

/// A name, followed by the text of number_ranges(): "slice 3", "slices 0-46". The name gets an s
/// unless there is exactly one number.
std::string named_ranges(const std::string& name, const std::set<int>& numbers, int max_runs = 20);

}  // namespace trocar::pipeline
