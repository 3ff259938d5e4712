// SPDX-License-Identifier: GPL-3.0-or-later
// Lists the scans in a folder from their headers alone (`trocar-mesh list`). If two slices have the
// same position, their pixels are read too, to find out whether the slices are copies.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// The list as JSON:
///  - `schema`, `program`, `folder` (the folder's name)
///  - `other_files`: the number of files that belong to no scan
///  - `why`: the reason why the series with `taken` = true is chosen among several DICOM series;
///    null if there is only one series, or none is taken
///  - `scans[]`: first the DICOM series by number, then NIfTI and NRRD files, then folders of images
///
/// Each scan has `kind` ("dicom", "nifti", "nrrd", "images"), `path` (relative to the folder), `slices`,
/// `width_px`, `height_px`, `spacing_mm` (x, y, z), `evenly_spaced`, `tilt_deg` (of the gantry),
/// `usable`, `problem` (the reason why the scan is not usable) and `taken`. At most one scan has
/// `taken` = true. It is the scan that is meshed if the folder is given without --series. A DICOM
/// series also has `uid`, `study_uid`, `study_date`, `number`, `description`, `kernel`, `modality`,
/// `image_type`, `localiser` and `files`. A segmentation also has `segments` (`label`, `name`); it
/// is usable with --labels. A DICOM series with several volumes is one scan for each of them, with
/// `volume` (the index for --volume) and `volume_name`; none of them is taken. Values that are not known are null.
///
/// `folder` may also be a file. If the file is a DICOMDIR, the folder that contains it is listed.
/// For any other file, the list is that of a folder that contains only this file. Errors: kRefused
/// if `folder` does not exist, cannot be read, or contains no scan.
Result<nlohmann::json> list_scans(const std::filesystem::path& folder,
                                  std::vector<Warning>& warnings);

/// The list as a table for people. `folder` is the folder or file that was listed.
std::string scan_table(const nlohmann::json& list, const std::string& folder);

/// Checks that at least one scan of the list is usable. Errors: kRefused if none is.
Result<void> check_any_usable(const nlohmann::json& list, const std::string& folder);

}  // namespace trocar::pipeline
