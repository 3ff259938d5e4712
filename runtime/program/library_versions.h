// SPDX-License-Identifier: Apache-2.0
// The versions of the libraries that all programs of this folder use, as a text for --version.
// Tests: tests/install/install_test.py
#pragma once

#include <string>

namespace trocar::runtime {

std::string library_versions();

}  // namespace trocar::runtime
