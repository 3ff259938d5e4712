// SPDX-License-Identifier: GPL-3.0-or-later
// Reads which images a DICOMDIR names.
#pragma once

#include <filesystem>
#include <vector>

namespace trocar::pipeline {

/// The paths of the images that a DICOMDIR names, relative to its folder. Empty if it cannot be
/// read.
std::vector<std::filesystem::path> images_of_dicomdir(const std::filesystem::path& dicomdir);

}  // namespace trocar::pipeline
