// SPDX-License-Identifier: GPL-3.0-or-later
// The key of an action. An action is everything that determines the bytes of a scan's outputs: the
// program, the parameters and the input files.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "pipeline/farm/scan_files.h"

namespace trocar::farm {

/// The action as a JSON object: "schema", "program", "parameters", and one array for each role
/// (NamedFile::of). `program` is the digest of the program. The array of a role has the digests of
/// those files in `wanted` that have this role, in their order. Precondition: `files` has the
/// digest of every wanted file.
nlohmann::json action_of(const std::string& program, const nlohmann::json& parameters,
                         const std::vector<NamedFile>& wanted, const std::vector<ScanFile>& files);

/// SHA-256 of the action as compact JSON with sorted keys.
std::string key_of(const nlohmann::json& action);

}  // namespace trocar::farm
