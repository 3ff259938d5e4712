// SPDX-License-Identifier: GPL-3.0-or-later
// NIfTI: headers, and volumes as stacks of slices along any axis.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/read/volume_file.h"

namespace trocar::pipeline {

// Reads headers of NIfTI-1 and -2, and checks the sizes in them before anything is allocated. The
// library libnifti2 only interprets a header in memory; it never opens the file.

struct NiftiHeader {
  /// Number of voxels along each axis of the array. The first index varies fastest in the file.
  std::array<std::int64_t, 3> n{};
  std::int64_t volumes = 1;  ///< number of volumes in the file
  int datatype = 0;          ///< one of the codes NIFTI_TYPE_... for real numbers
  int bytes_per_voxel = 0;
  bool swapped = false;             ///< true: voxels do not have the host's byte order
  std::int64_t data_start = 0;      ///< offset of the wanted volume in the (unpacked) file, bytes
  std::int64_t data_end = 0;        ///< end of the last volume in the (unpacked) file, bytes
  double slope = 1, intercept = 0;  ///< value = slope * stored + intercept
  /// False if the file does not state all sides of a voxel. The caller must then scale the first
  /// three columns of T_lps_voxel, whose lengths are meaningless.
  bool has_voxel_size = true;
  bool states_qform = false;  ///< the file states a qform, whether or not it is used
  Eigen::Matrix4d T_lps_voxel = Eigen::Matrix4d::Identity();  ///< maps voxel indices to LPS, mm
  /// The sides of a voxel according to pixdim in mm, without signs. A side that the file does not
  /// state is zero or not finite. std::nullopt if T_lps_voxel does not come from the sform.
  std::optional<std::array<double, 3>> pixdim_beside_sform_mm;

  std::int64_t data_bytes() const { return n[0] * n[1] * n[2] * bytes_per_voxel; }
};

inline constexpr std::size_t kNiftiHeadBytes = 540;

/// A file with more volumes is refused.
inline constexpr std::int64_t kMaxVolumes = 1 << 20;

/// Moves header.data_start, the offset of the first volume, to the wanted volume, and sets data_end.
/// Errors: kUsage if the file has several volumes and `volume` is missing, or if there is no volume
/// of that number; kRefused if the volumes have more than 2^60 bytes.
Result<void> choose_volume(const std::string& file, std::optional<int> volume, NiftiHeader& header);

// A NIfTI file can place its array in the patient twice: by its sform, which trocar-mesh uses, and
// by its qform. If the two differ, one of them is wrong: programs that use the other show the scan
// mirrored, rotated or elsewhere.

// Opens a NIfTI volume as a stack of slices along one of its axes.

/// Opens the file with slices along options.axis, or with axial slices if that is not set. With
/// `header_only`, reads the header only, for example to list the file; read() of the stack returns
/// an error. Errors: those of parse_nifti_header(), VolumeFile::open() and open_array(). Warnings:
/// those of parse_nifti_header() and open_array().
Result<std::unique_ptr<SliceStack>> open_nifti(const std::filesystem::path& file,
                                               const OpenOptions& options,
                                               bool header_only = false);

/// The stack of an array that a file of volumes holds, along options.axis or, if that is not set,
/// with axial slices. `open` opens the voxels; empty: read() of the stack returns an error.
/// Errors: those of `open` and of open_voxels(); kUsage if the header states no voxel size and
/// options.spacing_mm is missing. Warnings: `warnings`, no_modality, spacing_ignored.
Result<std::unique_ptr<SliceStack>> open_array(const std::string& file, NiftiHeader header,
                                               const OpenOptions& options,
                                               std::vector<Warning> warnings,
                                               const std::function<Result<VolumeFile>()>& open);

// Slices a stack along another axis of its volume.

/// Reads all slices of a stack, writes the voxels to a temporary file, and returns a stack of these
/// voxels with slices along `axis` (open_voxels()). With `as_labels`, the voxels are those of
/// SliceStack::read_labels(). `where` names the input in messages. Errors:
/// kRefused if the slices are tilted or not evenly spaced, if there is only one slice, or if there
/// is no space for the temporary file; those of SliceStack::read() and open_voxels().
Result<std::unique_ptr<SliceStack>> resliced(std::unique_ptr<SliceStack> stack, SliceAxis axis,
                                             const std::string& where, bool as_labels);

}  // namespace trocar::pipeline
