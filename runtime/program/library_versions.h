// SPDX-License-Identifier: Apache-2.0
// States the versions of Eigen, nlohmann-json and CLI11 in one text, which --version prints.
#pragma once

#include <string>

namespace trocar::runtime {

std::string library_versions();

}  // namespace trocar::runtime
