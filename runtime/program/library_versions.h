// SPDX-License-Identifier: Apache-2.0
// The versions of Eigen, nlohmann-json and CLI11, as a part of the text of --version.
// Tests: tests/install/install_test.py
#pragma once

#include <string>

namespace trocar::runtime {

std::string library_versions();

}  // namespace trocar::runtime
