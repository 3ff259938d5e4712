// SPDX-License-Identifier: GPL-3.0-or-later
// What the name of a file says: its kind, and its position in a list.
// Tests: tests/pipeline/read/readers_test.cpp
#pragma once

#include <filesystem>
#include <initializer_list>
#include <string>

namespace trocar::pipeline {

/// Whether the name ends with one of the endings, which are in lower case; the name's case does not
/// matter.
bool has_ending(const std::filesystem::path& file, std::initializer_list<const char*> endings);

bool is_nifti(const std::filesystem::path& file);
bool is_image(const std::filesystem::path& file);
bool is_dicomdir(const std::filesystem::path& file);
/// A DICOMDIR, or a file that an operating system leaves in folders (Thumbs.db, desktop.ini).
bool is_left_by_system(const std::filesystem::path& file);

/// Natural order: slice_2 before slice_10, since runs of digits compare as numbers.
bool natural_less(const std::string& a, const std::string& b);

}  // namespace trocar::pipeline
