// SPDX-License-Identifier: GPL-3.0-or-later
// The key of an action: what its outputs are a function of.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "pipeline/farm/scan_files.h"

namespace trocar::farm {

/// {"schema", "program", "parameters", and the digests of the `wanted` files under what they are,
/// in their order}. All of these must have digests in `files`.
nlohmann::json action_of(const std::string& program, const nlohmann::json& parameters,
                         const std::vector<NamedFile>& wanted, const std::vector<ScanFile>& files);

/// SHA-256 of the action as compact JSON with sorted keys.
std::string key_of(const nlohmann::json& action);

}  // namespace trocar::farm
