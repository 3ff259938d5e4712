// SPDX-License-Identifier: GPL-3.0-or-later
// NIfTI-1 and -2 headers, checked before anything is allocated. libnifti2 swaps and interprets
// them; it is never given the file itself.
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
  std::array<std::int64_t, 3> n{};  ///< voxels along the array's axes, the first fastest
  std::int64_t volumes = 1;         ///< number of such volumes in the file
  int datatype = 0;                 ///< NIFTI_TYPE_... code; one real number for each voxel
  int bytes_per_voxel = 0;
  bool swapped = false;  ///< whether the bytes of voxels are in the other order than the host's
  std::int64_t data_start = 0;  ///< byte offset in the (unpacked) file
  double slope = 1, intercept = 0;
  bool has_voxel_size = true;  ///< if not, the columns of T_lps_voxel have length 1
  Eigen::Matrix4d T_lps_voxel = Eigen::Matrix4d::Identity();  ///< mm
  /// The voxel's sides by pixdim in mm, without signs, if T_lps_voxel is the sform. A side that the
  /// file does not state is zero or not finite.
  std::optional<std::array<double, 3>> pixdim_beside_sform_mm;

  std::int64_t data_bytes() const { return n[0] * n[1] * n[2] * bytes_per_voxel; }
};

/// Parses the first bytes of a file (NIfTI-1 needs 348, NIfTI-2 540). `file` is named in messages.
/// In a file of more than three dimensions `volume` counts along the others, the fourth fastest.
/// Errors (refused): not NIfTI, a pair of files, not a real scalar type, sides or offset out of
/// range, an affine that is not finite; (usage) several volumes and no `volume`, or one beyond the
/// last. Warnings: no_orientation.
Result<NiftiHeader> parse_nifti_header(const std::vector<std::uint8_t>& head,
                                       const std::string& file, std::optional<int> volume,
                                       std::vector<Warning>& warnings);

inline constexpr std::size_t kNiftiHeadBytes = 540;

}  // namespace trocar::pipeline
