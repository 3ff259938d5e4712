// SPDX-License-Identifier: GPL-3.0-or-later
// What a folder and its sub-folders hold, and what of it is the scan.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/dicom_headers.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// More than a study has: a wrong folder (a home, a disk) is told soon.
struct SearchLimits {
  int depth = 16;                ///< of sub-folders; deeper ones are left out with a warning
  std::size_t entries = 200000;  ///< files and folders; a folder with more is refused
};

/// The regular files of a folder and its sub-folders, in natural order of their paths. Left out:
/// what is hidden, broken links. Links to folders are followed; every folder is searched once.
/// Errors (refused): the folder cannot be read; too many entries. Warnings: folder_left_out.
Result<std::vector<std::filesystem::path>> files_below(const std::filesystem::path& folder,
                                                       std::vector<Warning>& warnings,
                                                       const SearchLimits& limits = {});

struct ScanFolder {
  enum class Kind { kNothing, kDicom, kVolume, kImages };

  std::filesystem::path folder;
  std::string where;                           ///< the same with a slash behind it
  std::vector<DicomFile> dicom;                ///< all files that are neither of the others
  std::vector<std::filesystem::path> volumes;  ///< NIfTI, by their names
  /// By folder, by their names. The first are those of the folder itself, if it has any.
  std::vector<std::vector<std::filesystem::path>> images;
  bool has_own_images() const;

  /// DICOM slices come before volumes, and these before images: what lies beside slices was made
  /// from them. Localisers and screen captures alone do not decide.
  Kind kind() const;
  /// As in "2 images (a.png, b.png)": what kind() passes over; empty if nothing.
  std::string left_out() const;
};

/// Reads the headers of all DICOM files, with `spacing_mm` and `any_modality` of the options.
/// Errors (refused): those of files_below(); a file that may be DICOM cannot be read; an empty
/// folder.
Result<ScanFolder> search_folder(const std::filesystem::path& folder, DicomExtent extent,
                                 const OpenOptions& options, std::vector<Warning>& warnings);

bool is_nifti(const std::filesystem::path& file);  ///< by its name
bool is_image(const std::filesystem::path& file);  ///< by its name
/// A DICOMDIR, by its name, or what a system leaves in folders (Thumbs.db, desktop.ini).
bool is_left_by_system(const std::filesystem::path& file);
bool is_dicomdir(const std::filesystem::path& file);  ///< by its name

/// slice_2 before slice_10: runs of digits compare as numbers.
bool natural_less(const std::string& a, const std::string& b);

/// Errors (refused): no permission to read the file.
Result<void> check_readable(const std::filesystem::path& file);

}  // namespace trocar::pipeline
