// SPDX-License-Identifier: GPL-3.0-or-later
// Finds the files in a folder and its sub-folders, and determines which of them form the scan.
#pragma once

#include <cstddef>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/dicom/dicom_headers.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Limits of a search. No study reaches them, but a folder given by mistake does, for example a
/// home folder or a disk.
struct SearchLimits {
  int depth = 16;                ///< sub-folders below this depth are left out with a warning
  std::size_t entries = 200000;  ///< a folder with more files and folders than this is refused
  /// True: if a sub-folder or a file cannot be reached, the search fails with a temporary error
  /// (Error::is_temporary). Sub-folders below `depth` are still left out.
  bool must_reach_all = false;
};

/// The regular files of a folder and its sub-folders, in natural order of their paths ("s2" before
/// "s10"), and links that lead nowhere. Hidden files and folders are left out. Links to folders are
/// followed, but every folder is searched only once. Errors: kRefused if `folder` or a sub-folder
/// cannot be read, or if there are too many entries; the first is temporary if the storage does not
/// answer, and for sub-folders also with SearchLimits::must_reach_all. Warnings: folder_left_out for
/// a sub-folder that lies too deep, or that belongs to the file system (lost+found).
Result<std::vector<std::filesystem::path>> files_below(const std::filesystem::path& folder,
                                                       std::vector<Warning>& warnings,
                                                       const SearchLimits& limits = {});

/// The files of a folder and its sub-folders, sorted by kind.
struct ScanFolder {
  enum class Kind { kNothing, kDicom, kVolume, kImages };

  std::filesystem::path folder;
  std::string where;                           ///< `folder` with a slash at its end, for messages
  std::vector<DicomFile> dicom;                ///< files in neither list below, DICOM or not
  std::vector<std::filesystem::path> volumes;  ///< NIfTI and NRRD files, by their names
  /// The image files, recognised by their names; one list for each folder that has images. If
  /// `folder` itself has images, its list comes first.
  std::vector<std::vector<std::filesystem::path>> images;
  bool has_own_images() const;

  /// The kind of files that form the scan: kDicom if there are DICOM slices, otherwise kVolume if
  /// there are volumes, otherwise kImages if there are images, otherwise kNothing. The reason for
  /// this order is that volumes and images which lie beside DICOM slices were usually made from the
  /// slices. Localisers and screen captures do not count as slices, unless the folder has neither
  /// volumes nor images.
  Kind kind() const;
  /// A text that names the files left out because of kind(), such as "2 images (a.png, b.png)", or
  /// only counts them; empty if no file is left out.
  std::string left_out(bool with_names = true) const;
};

/// Finds the files below `folder` and reads the headers of all DICOM files. `extent` says whether
/// their pixel data must be complete. Only `spacing_mm` and `any_modality` of the options are used.
/// Errors: those of files_below(); kRefused if the folder is empty; those of check_readable() for a
/// file that may be DICOM; the message counts the files. Warnings: not_read for unreadable files
/// with other names; missing_file for images that a DICOMDIR names and the folder lacks.
Result<ScanFolder> search_folder(const std::filesystem::path& folder, DicomExtent extent,
                                 const OpenOptions& options, std::vector<Warning>& warnings);

/// Checks that the file can be read. Errors: kRefused if it cannot, for example because a link leads
/// nowhere; temporary (Error::is_temporary) if the storage does not answer.
Result<void> check_readable(const std::filesystem::path& file);

/// If the file is a DICOMDIR (the file that viewers open), it stands for the folder that contains
/// it, and the function returns this folder. Otherwise the function returns std::nullopt.
std::optional<std::filesystem::path> folder_of_dicomdir(const std::filesystem::path& file);

// Lists the scans in a folder from their headers alone (`trocar-mesh list`). If two slices have the
// same position, their pixels are read too, to find out whether the slices are copies.

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
