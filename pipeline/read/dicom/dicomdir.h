// SPDX-License-Identifier: GPL-3.0-or-later
// Reads which images a DICOMDIR names.
// Tests: tests/e2e/studies_e2e_test.py
#pragma once

#include <filesystem>
#include <vector>

namespace trocar::pipeline {

/// The paths of the images that a DICOMDIR names, relative to its folder. Empty if it cannot be
/// read.
std::vector<std::filesystem::path> images_of_dicomdir(const std::filesystem::path& dicomdir);

}  // namespace trocar::pipeline
