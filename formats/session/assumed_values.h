// SPDX-License-Identifier: Apache-2.0
// The section "assumed" of a device description: it names values of the file that nobody has measured, each with a
// reason. Include it in .cpp files only, like strict_json.h.
// Tests: tests/formats/session/device_description_test.cpp
#pragma once

#include <nlohmann/json.hpp>

#include "formats/base/strict_json.h"

namespace trocar {

/// Checks that `assumed` maps JSON pointers to values of `document` to texts; adds an error if not.
void check_assumed(const nlohmann::json& assumed, const nlohmann::json& document,
                   JsonErrors& errors);

}  // namespace trocar
