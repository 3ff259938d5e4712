// SPDX-License-Identifier: GPL-3.0-or-later
// Lists of whole numbers for people: "0-46, 50".
#pragma once

#include <set>
#include <string>

namespace trocar::pipeline {

/// The numbers in order, runs of them as A-B, with `separator` between; after 20 runs the rest is
/// only counted (" and 7 more").
std::string number_ranges(const std::set<int>& numbers, const std::string& separator = ", ");

/// "slice 3" or "slices 0-46, 50".
std::string named_ranges(const std::string& name, const std::set<int>& numbers);

}  // namespace trocar::pipeline
