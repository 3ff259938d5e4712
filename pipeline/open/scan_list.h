// SPDX-License-Identifier: GPL-3.0-or-later
// The scans in a folder, from their headers alone (`trocar-mesh list`). Pixels are read only of
// slices at one position, which may be copies.
// Tests: tests/e2e/studies_e2e_test.py
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// `schema`, `program`, `folder` (its name), `other_files` (how many are no scans), `why` (the scan
/// that is taken of the folder is, or null) and `scans[]`: first the DICOM series by number, then
/// NIfTI files, then folders of images. A scan has `kind` ("dicom", "nifti", "images"), `path` (in
/// the folder), `slices`, `width_px`, `height_px`, `spacing_mm` (x, y, z), `evenly_spaced`,
/// `tilt_deg`, `usable`, `problem` (why it is not), `taken` (by meshing the folder without
/// --series); a series also `uid`, `study_uid`, `study_date`, `number`, `description`, `kernel`,
/// `modality`, `image_type`, `localiser`, `files`; a segmentation `segments` (`label`, `name`), and
/// is usable with --labels. What is not known is null. No pixels are read. A file is listed as the
/// only one of a folder. Errors (refused): no such folder, nothing in it.
Result<nlohmann::json> list_scans(const std::filesystem::path& folder,
                                  std::vector<Warning>& warnings);

/// The same for people. `folder` is what was listed.
std::string scan_table(const nlohmann::json& list, const std::string& folder);

/// Errors (refused): no scan of the list is usable.
Result<void> check_any_usable(const nlohmann::json& list, const std::string& folder);

}  // namespace trocar::pipeline
