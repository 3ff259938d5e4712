// SPDX-License-Identifier: Apache-2.0
// The section "assumed" of a device description. It names values of the file that nobody has
// measured, each with a reason. Include this header in .cpp files only, because a public header
// must not include nlohmann/json.
#pragma once

#include <nlohmann/json.hpp>

#include "formats/base/strict_json.h"

namespace trocar {

/// Checks the section `assumed`. Adds an error to `errors` for each key that is not a JSON pointer
/// to a value of `document`, and for each value that is not a text (the reason).
void check_assumed(const nlohmann::json& assumed, const nlohmann::json& document,
                   JsonErrors& errors);

}  // namespace trocar
