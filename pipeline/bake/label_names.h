// SPDX-License-Identifier: GPL-3.0-or-later
// The names of the labels of a label map.
#pragma once

#include <cstddef>
#include <map>
#include <set>
#include <string>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// A name has 1 to kMaxNameBytes bytes of UTF-8. All its characters can be printed, and its first
/// and last character are not spaces.
inline constexpr std::size_t kMaxNameBytes = 64;

/// The names of labels from 1 to kMaxLabel; 0 is the background.
class LabelNames {
 public:
  /// Reads names. `what` is the argument of --names: a built-in table (verse, totalsegmentator) or
  /// a JSON file {"20": "L1", ...}. Errors: kRefused if the file cannot be read, is larger than 1
  /// MiB or is not a JSON object with entries; if a key is not a label or a name is not valid; or
  /// if a label or name occurs twice.
  static Result<LabelNames> named(const std::string& what);
  /// Is `what` the name of a built-in table?
  static bool is_table(const std::string& what) {
    return what == "verse" || what == "totalsegmentator";
  }

  /// Adds names that the input itself contains: a label without a name gets its name in `of_input`.
  /// A name that another label already has is skipped. Characters that a name cannot have are
  /// replaced by "?", and bytes beyond kMaxNameBytes are left out.
  void add_defaults(const std::map<int, std::string>& of_input);

  /// The name of a label, or "label 20" if it has none.
  std::string name_of(int label) const;

  /// Lists labels for a message: "labels 20-24" if none of them has a name, otherwise "labels 20
  /// (L1), 22 (L3)". A list with names ends after eight labels with the number of the rest.
  std::string list(const std::set<int>& labels) const;

 private:
  static Result<LabelNames> of_file(const std::string& file);
  bool add(int label, const std::string& name);  // returns false if the name is in use
  std::map<int, std::string> names_;
  std::set<std::string> used_;
};

}  // namespace trocar::pipeline
