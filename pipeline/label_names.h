// SPDX-License-Identifier: GPL-3.0-or-later
// What the labels of a label map are called.
#pragma once

#include <cstddef>
#include <map>
#include <set>
#include <string>
#include <string_view>

#include "formats/base/result.h"

namespace trocar::pipeline {

/// A name is 1 to 64 bytes of UTF-8 without control or format characters, and does not begin or end
/// with a space.
inline constexpr std::size_t kMaxNameBytes = 64;
/// Labels with names are 1 to this; 0 is the background.
inline constexpr int kMaxLabel = 999'999'999;

class LabelNames {
 public:
  /// `what` of --names: a table (verse, totalsegmentator) or a JSON file {"20": "L1", ...}.
  /// Errors (refused): no such file, larger than 1 MiB, not JSON, a key that is not a label, a name
  /// that is none, a label or a name that is there twice.
  static Result<LabelNames> named(const std::string& what);
  static bool is_table(const std::string& what);

  /// The names that the input itself gives, for labels without one. Names that are there already
  /// are left out; what cannot be shown in a name becomes ?.
  void add_defaults(const std::map<int, std::string>& of_input);

  /// "label 20" for a label without a name.
  std::string name_of(int label) const;

  /// In a message: "labels 20-24", or with names "labels 20 (L1), 22 (L3)", the first eight of
  /// them.
  std::string list(const std::set<int>& labels) const;

 private:
  static Result<LabelNames> of_file(const std::string& file);
  bool add(int label, const std::string& name);  // false: the name is there already
  std::map<int, std::string> names_;
  std::set<std::string> used_;
};

}  // namespace trocar::pipeline
