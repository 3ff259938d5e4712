// SPDX-License-Identifier: GPL-3.0-or-later
// Reads headers of NIfTI-1 and -2, and checks them before anything is allocated. libnifti2 swaps
// the bytes of a header and interprets it, but it never gets the file itself.
// Tests: tests/pipeline/read/readers_test.cpp
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/read/volume_file.h"

namespace trocar::pipeline {

struct NiftiHeader {
  /// Number of voxels along each axis of the array. The first index varies fastest in the file.
  std::array<std::int64_t, 3> n{};
  std::int64_t volumes = 1;  ///< number of volumes in the file
  int datatype = 0;          ///< NIFTI_TYPE_... code; one real number for each voxel
  int bytes_per_voxel = 0;
  bool swapped = false;         ///< true: voxels do not have the host's byte order
  std::int64_t data_start = 0;  ///< byte offset in the (unpacked) file
  double slope = 1, intercept = 0;
  bool has_voxel_size = true;  ///< false: the columns of T_lps_voxel have length 1
  Eigen::Matrix4d T_lps_voxel = Eigen::Matrix4d::Identity();  ///< mm
  /// If T_lps_voxel comes from the sform: the sides of a voxel according to pixdim in mm, without
  /// signs. A side that the file does not state is zero or not finite.
  std::optional<std::array<double, 3>> pixdim_beside_sform_mm;

  std::int64_t data_bytes() const { return n[0] * n[1] * n[2] * bytes_per_voxel; }
};

/// Parses the first bytes of a file (NIfTI-1 needs 348, NIfTI-2 540). Messages name `file`. If the
/// file has more than three dimensions, `volume` is the index of the wanted volume. It counts along
/// the further dimensions, of which the fourth varies fastest. Errors: kRefused if the file is not
/// NIfTI or is one of a pair of files, the voxels are not real scalars, sides or offset are out of
/// range, or the affine matrix is not finite; kUsage if the file has several volumes and `volume`
/// is missing, or if `volume` is beyond the last one. Warnings: no_orientation.
Result<NiftiHeader> parse_nifti_header(const std::vector<std::uint8_t>& head,
                                       const std::string& file, std::optional<int> volume,
                                       std::vector<Warning>& warnings);

inline constexpr std::size_t kNiftiHeadBytes = 540;

}  // namespace trocar::pipeline
