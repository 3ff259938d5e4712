// SPDX-License-Identifier: GPL-3.0-or-later
// Finds the files in a folder and its sub-folders, and determines which of them form the scan.
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

/// Limits of a search. No study reaches them, but a folder given by mistake (a home folder, a disk)
/// does, so the mistake is soon reported.
struct SearchLimits {
  int depth = 16;                ///< deeper sub-folders are left out with a warning
  std::size_t entries = 200000;  ///< largest number of files and folders; more are refused
};

/// The regular files of a folder and its sub-folders, in natural order of their paths. Hidden files
/// and broken links are left out. Links to folders are followed, but every folder is searched only
/// once. Errors (refused): the folder cannot be read; too many entries. Warnings: folder_left_out.
Result<std::vector<std::filesystem::path>> files_below(const std::filesystem::path& folder,
                                                       std::vector<Warning>& warnings,
                                                       const SearchLimits& limits = {});

struct ScanFolder {
  enum class Kind { kNothing, kDicom, kVolume, kImages };

  std::filesystem::path folder;
  std::string where;                           ///< `folder` with a slash at its end, for messages
  std::vector<DicomFile> dicom;                ///< all files that are neither volumes nor images
  std::vector<std::filesystem::path> volumes;  ///< NIfTI files, recognised by their names
  /// The image files of each folder, recognised by their names. If `folder` itself has images, they
  /// come first.
  std::vector<std::vector<std::filesystem::path>> images;
  bool has_own_images() const;

  /// The kind of files that form the scan. DICOM slices take precedence over volumes, and volumes
  /// over images, because other files beside the slices were usually made from them. Localisers and
  /// screen captures do not count as slices.
  Kind kind() const;
  /// The files that are left out because of kind(), such as "2 images (a.png, b.png)"; empty if
  /// there are none.
  std::string left_out() const;
};

/// Finds the files and reads the headers of all DICOM files, with `spacing_mm` and `any_modality`
/// of the options. Errors (refused): those of files_below(); a file that may be DICOM cannot be
/// read; the folder is empty.
Result<ScanFolder> search_folder(const std::filesystem::path& folder, DicomExtent extent,
                                 const OpenOptions& options, std::vector<Warning>& warnings);

/// Checks the permission to read the file. Errors (refused): there is none.
Result<void> check_readable(const std::filesystem::path& file);

}  // namespace trocar::pipeline
