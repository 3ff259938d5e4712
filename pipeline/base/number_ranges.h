// SPDX-License-Identifier: GPL-3.0-or-later
// Numbers in messages, and lists of whole numbers such as "0-46, 50".
// Tests: tests/pipeline/scan/warnings_test.cpp
#pragma once

#include <set>
#include <string>

namespace trocar::pipeline {

/// A value in messages, with at most so many significant digits: "226" or "0.3125".
std::string text_of(double value, int digits = 7);

/// The numbers in ascending order, with runs of consecutive numbers as A-B and `separator` between
/// the runs. After `max_runs` runs the rest is only counted (" and 7 more").
std::string number_ranges(const std::set<int>& numbers, const std::string& separator = ", ",
                          int max_runs = 20);

/// "slice 3" or "slices 0-46, 50".
std::string named_ranges(const std::string& name, const std::set<int>& numbers, int max_runs = 20);

}  // namespace trocar::pipeline
