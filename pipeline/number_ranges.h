// SPDX-License-Identifier: GPL-3.0-or-later
// Numbers in messages, and lists of whole ones: "0-46, 50".
#pragma once

#include <set>
#include <string>

namespace trocar::pipeline {

/// A value in messages: at most seven digits, as "226" or "0.3125".
std::string text_of(double value);

/// The numbers in order, runs of them as A-B, with `separator` between; after 20 runs the rest is
/// only counted (" and 7 more").
std::string number_ranges(const std::set<int>& numbers, const std::string& separator = ", ");

/// "slice 3" or "slices 0-46, 50".
std::string named_ranges(const std::string& name, const std::set<int>& numbers);

}  // namespace trocar::pipeline
