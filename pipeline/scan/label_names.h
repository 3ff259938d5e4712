// SPDX-License-Identifier: GPL-3.0-or-later
// The names of the labels of a label map.
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
/// Labels 1 to kMaxLabel can have names; 0 is the background.
inline constexpr int kMaxLabel = 999'999'999;

class LabelNames {
 public:
  /// Reads the names that the argument of --names gives: a table (verse, totalsegmentator) or a
  /// JSON file {"20": "L1", ...}. Errors: kRefused if there is no such file, it is larger than 1
  /// MiB or not JSON, a key is not a label, a name is invalid, or a label or name occurs twice.
  static Result<LabelNames> named(const std::string& what);
  /// Is the argument of --names the name of a table?
  static bool is_table(const std::string& what);

  /// Adds the names that the input itself gives to labels that have no name yet. A name that is
  /// already in use is skipped, and characters that a name cannot have are replaced by "?".
  void add_defaults(const std::map<int, std::string>& of_input);

  /// The name of a label, or "label 20" if it has none.
  std::string name_of(int label) const;

  /// Lists labels for a message: "labels 20-24" or, if they have names, "labels 20 (L1), 22 (L3)".
  /// If labels have names, only the first eight are listed.
  std::string list(const std::set<int>& labels) const;

 private:
  static Result<LabelNames> of_file(const std::string& file);
  bool add(int label, const std::string& name);  // returns false if the name is in use
  std::map<int, std::string> names_;
  std::set<std::string> used_;
};

}  // namespace trocar::pipeline
