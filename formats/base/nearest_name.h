// SPDX-License-Identifier: Apache-2.0
// Suggestions for misspelt names, such as: "--treshold": did you mean --threshold?
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace trocar {

/// Returns the candidate with the smallest edit distance (Levenshtein) to `name`. Returns an empty
/// text if this distance is larger than 1 and also larger than a third of the length of `name`.
/// Also returns an empty text if `name` has more than 64 bytes.
std::string nearest_name(std::string_view name, const std::vector<std::string>& candidates);

/// Returns ", did you mean X?", where X is the result of nearest_name(). Returns an empty text if
/// that result is empty.
std::string did_you_mean(std::string_view name, const std::vector<std::string>& candidates);

}  // namespace trocar
