// SPDX-License-Identifier: GPL-3.0-or-later
// The files in a folder and its sub-folders, and which of them are the scan.
// Tests: tests/e2e/studies_e2e_test.py
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/dicom/dicom_headers.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// More than a study has, so that a wrong folder (a home, a disk) is reported soon.
struct SearchLimits {
  int depth = 16;                ///< deeper sub-folders are left out with a warning
  std::size_t entries = 200000;  ///< limit of files and folders; more are refused
};

/// The regular files of a folder and its sub-folders, in natural order of their paths. Hidden files
/// and broken links are left out. Links to folders are followed; every folder is searched once.
/// Errors (refused): the folder cannot be read; too many entries. Warnings: folder_left_out.
Result<std::vector<std::filesystem::path>> files_below(const std::filesystem::path& folder,
                                                       std::vector<Warning>& warnings,
                                                       const SearchLimits& limits = {});

struct ScanFolder {
  enum class Kind { kNothing, kDicom, kVolume, kImages };

  std::filesystem::path folder;
  std::string where;                           ///< `folder` with a slash behind it, for messages
  std::vector<DicomFile> dicom;                ///< all files that are neither volumes nor images
  std::vector<std::filesystem::path> volumes;  ///< NIfTI, by their names
  /// The image files of each folder, by their names. If `folder` itself has images, they come
  /// first.
  std::vector<std::vector<std::filesystem::path>> images;
  bool has_own_images() const;

  /// DICOM slices take precedence over volumes, and volumes over images, because other files in a
  /// folder of slices were made from these. Localisers and screen captures alone do not count.
  Kind kind() const;
  /// The files that kind() passes over, as in "2 images (a.png, b.png)"; empty if there are none.
  std::string left_out() const;
};

/// Reads the headers of all DICOM files, with `spacing_mm` and `any_modality` of the options.
/// Errors (refused): those of files_below(); a file that may be DICOM cannot be read; an empty
/// folder.
Result<ScanFolder> search_folder(const std::filesystem::path& folder, DicomExtent extent,
                                 const OpenOptions& options, std::vector<Warning>& warnings);

/// Errors (refused): no permission to read the file.
Result<void> check_readable(const std::filesystem::path& file);

}  // namespace trocar::pipeline
