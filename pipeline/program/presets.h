// SPDX-License-Identifier: GPL-3.0-or-later
// Presets of trocar-mesh. A preset is a named list of options with values, which `--explain`
// prints. If the command line gives an option of the preset too, the command line's value counts.
#pragma once

#include <set>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "formats/base/result.h"

namespace trocar::pipeline {

struct Preset {
  std::string_view name, words;  ///< words: what the preset is for
  /// The name of each option, such as "--threshold", and the option's value.
  std::vector<std::pair<std::string_view, std::string_view>> options;
};

std::span<const Preset> presets();

/// Returns the words of a command line together with the options of its `--preset`. An option that
/// the command line gives itself is not added. If the command line gives `--max-area`, the preset's
/// `--max-area-px` is not added either, because both limit the area of triangles. If no preset has
/// the name that `--preset` gives, nothing is added.
std::vector<std::string> with_preset_options(const std::vector<std::string>& words);

/// The names of the options that with_preset_options() adds to the words, such as "--close".
std::set<std::string> added_by_preset(const std::vector<std::string>& words);

/// A text with the options and the purpose of the preset `name`, or of all presets if `name` is
/// empty. Errors: kUsage if there is no such preset.
Result<std::string> explain_presets(const std::string& name);

}  // namespace trocar::pipeline
