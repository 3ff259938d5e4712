// SPDX-License-Identifier: Apache-2.0
#include "runtime/program/library_versions.h"

#include <Eigen/Core>
#include <nlohmann/json_fwd.hpp>

#include "formats/base/command_line.h"

namespace trocar::runtime {

std::string library_versions() {
  return "Eigen " + std::to_string(EIGEN_WORLD_VERSION) + "." +
         std::to_string(EIGEN_MAJOR_VERSION) + "." + std::to_string(EIGEN_MINOR_VERSION) +
         ", nlohmann-json " + std::to_string(NLOHMANN_JSON_VERSION_MAJOR) + "." +
         std::to_string(NLOHMANN_JSON_VERSION_MINOR) + "." +
         std::to_string(NLOHMANN_JSON_VERSION_PATCH) + ", " + command_line_library();
}

}  // namespace trocar::runtime
