// SPDX-License-Identifier: GPL-3.0-or-later
// NRRD: headers, and volumes as stacks of slices.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/nifti.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

// Reads headers of NRRD files (teem.sourceforge.net/nrrd/format.html): lines of text, of which
// every number is checked before anything is allocated. The data follow the header, or are in a
// file of their own in the same folder (.nhdr).

struct NrrdHeader {
  /// The array. `data_start` and `data_end` are offsets in the unpacked data, which begin at
  /// `data_at` of the data's file; `volumes` is the size of a fourth axis.
  NiftiHeader array;
  std::int64_t data_at = 0;
  bool is_gzip = false;
  std::string data_file;  ///< name of the data's file in the header's folder; empty: the same file
  bool at_end = false;    ///< the data are the last bytes of their file (byte skip -1)
  /// The names of labels that 3D Slicer stores with a segmentation.
  std::map<int, std::string> label_names;
};

/// The first MiB of a file, or all if it has less. Errors: kRefused if it cannot be opened.
Result<std::string> nrrd_head(const std::filesystem::path& file);

/// Parses `head`, the result of nrrd_head(). `file` is the file's name in error messages, `volume` the number of the wanted volume.
///
/// Three axes must be spatial. A further axis is accepted if it is the slowest one, or if its size
/// is 1. Errors: kRefused if the file is not NRRD; if a field that is needed is missing, given twice
/// or not valid; if the encoding is neither raw nor gzip, the space neither LPS, RAS nor LAS; if a
/// voxel has several values; if the data are in several files or in another folder; kUsage as for
/// parse_nifti_header(). Warnings: no_orientation.
Result<NrrdHeader> parse_nrrd_header(std::string_view head, const std::string& file,
                                     std::optional<int> volume, std::vector<Warning>& warnings);

/// The data's file of an NRRD header, if it has one; std::nullopt if the data follow the header, or
/// if `file` is not a NRRD file that can be read.
std::optional<std::filesystem::path> nrrd_data_file(const std::filesystem::path& file);

// Opens a NRRD volume as a stack of slices along one of its axes.

/// As open_nifti(), for a NRRD file with its data, or a header whose data are in another file of
/// the same folder. Errors: those of parse_nrrd_header(), VolumeFile::open_part() and open_array().
/// Warnings: those of parse_nrrd_header() and open_array().
Result<std::unique_ptr<SliceStack>> open_nrrd(const std::filesystem::path& file,
                                              const OpenOptions& options, bool header_only = false);

/// Opens a NIfTI or NRRD file, whichever its name says, and sets SliceStack::files. Precondition:
/// is_volume(file).
Result<std::unique_ptr<SliceStack>> open_volume(const std::filesystem::path& file,
                                                const OpenOptions& options,
                                                bool header_only = false);

/// The files of a volume: the file itself and, if its data are in another file, that one.
std::vector<std::filesystem::path> files_of_volume(const std::filesystem::path& file);

}  // namespace trocar::pipeline
