// SPDX-License-Identifier: Apache-2.0
// Suggestions for misspelt names, such as: "--treshold": did you mean --threshold?
// Tests: tests/formats/base/file_io_test.cpp
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace trocar {

/// The candidate with the smallest edit distance (Levenshtein) to `name`. Empty if all distances
/// exceed a third of the name's length (or 1, if the name is shorter than three bytes), or if the
/// name has more than 64 bytes.
std::string nearest_name(std::string_view name, const std::vector<std::string>& candidates);

/// ", did you mean X?", or an empty text.
std::string did_you_mean(std::string_view name, const std::vector<std::string>& candidates);

}  // namespace trocar
