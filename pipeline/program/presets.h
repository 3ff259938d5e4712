// SPDX-License-Identifier: GPL-3.0-or-later
// Presets of trocar-mesh. A preset is a list of options, which `--explain` prints. An option of a
// preset can also be given explicitly with another value.
// Tests: tests/pipeline/program/parameters_test.cpp
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
  /// Names with --, and values.
  std::vector<std::pair<std::string_view, std::string_view>> options;
};

std::span<const Preset> presets();

/// The words of a command line, with those options of its `--preset` added that it does not give
/// itself. The words are unchanged if no preset has the given name.
std::vector<std::string> with_preset_options(const std::vector<std::string>& words);

/// The options and the meaning of the preset `name`, or of all presets if `name` is empty. Errors:
/// kUsage if there is no such preset.
Result<std::string> explain_presets(const std::string& name);

}  // namespace trocar::pipeline
