// SPDX-License-Identifier: Apache-2.0
// Suggestions for misspelt names: "--treshold": did you mean --threshold?
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace trocar {

/// The candidate with the smallest edit distance (Levenshtein) to `name`; empty if all are farther
/// than a third of the name's length (at least 1) or the name has more than 64 bytes.
std::string nearest_name(std::string_view name, const std::vector<std::string>& candidates);

/// ", did you mean X?" or nothing.
std::string did_you_mean(std::string_view name, const std::vector<std::string>& candidates);

}  // namespace trocar
