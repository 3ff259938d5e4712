// SPDX-License-Identifier: Apache-2.0
// A text for --version: the versions of the libraries that all programs of this folder use.
// Tests: tests/install/install_test.py
#pragma once

#include <string>

namespace trocar::runtime {

std::string library_versions();

}  // namespace trocar::runtime
