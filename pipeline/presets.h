// SPDX-License-Identifier: GPL-3.0-or-later
// Presets of trocar-mesh. A preset is a list of options: what it does can be read (`--explain`),
// and any of them can be given beside it with another value.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "formats/base/result.h"

namespace trocar::pipeline {

struct Preset {
  std::string_view name, words;
  std::vector<std::pair<std::string_view, std::string_view>> options;  ///< name with --, value
};

std::span<const Preset> presets();

/// The words of a command line with the options of its `--preset` after them, without those that
/// the command line gives itself. Unchanged if there is no preset of that name.
std::vector<std::string> with_preset_options(const std::vector<std::string>& words);

/// `name` as a line of options with its meaning; all presets if `name` is empty. Errors (usage): no
/// such preset.
Result<std::string> explain_presets(const std::string& name);

}  // namespace trocar::pipeline
