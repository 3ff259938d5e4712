// SPDX-License-Identifier: Apache-2.0
// Compresses the HU of one slice. Which samples are stored follows from the slice's outlines, so
// the set of samples is not stored itself. asset.md specifies the bytes. Internal to formats/,
// except for encode_hu_plane().
//
// Contract (tests/formats/asset/hu_volume_test.cpp):
//  1. A sample is stored if its distance from the material is at most the margin, decided in integers.
//  2. decode_hu_plane() restores what encode_hu_plane() stored. It refuses bytes that hold fewer or more
//     samples, or values out of range. Memory and time are bounded by the grid's box around the outlines,
//     which holds at most kMaxHuSamples.
// Tests: tests/formats/asset/hu_volume_test.cpp
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "formats/asset/hu_volume.h"
#include "formats/base/result.h"
#include "formats/geometry/lattice.h"
#include "formats/geometry/slice_mesh.h"

namespace trocar {

inline constexpr std::int64_t kMaxHuSamples = std::int64_t{1} << 24;  ///< in the box of one plane
inline constexpr int kMaxHuSide = 1 << 15;  ///< most columns or rows of a grid
/// The largest |HU| / step that is stored; larger ones are clamped.
inline constexpr std::int64_t kMaxHuSteps = std::int64_t{1} << 30;
/// The largest margin, lattice steps.
inline constexpr std::int32_t kMaxHuMargin = 1 << 20;

/// Errors, without the file's name: (refused) the grid's numbers are out of range.
Result<void> check_hu_grid(const HuGrid& grid, const Lattice& lattice);

/// The outlines of a slice, one for each material. Materials may touch, but do not overlap.
using Outlines = std::span<const Pslg* const>;

/// The samples that are stored: a box of the grid, and for each sample in it whether it is stored.
struct HuMask {
  int first_column = 0, first_row = 0, columns = 0, rows = 0;
  std::vector<char> is_stored;  ///< row by row
};
/// Errors: (refused) the box exceeds kMaxHuSamples, or so many edges are so near to each other that they
/// cannot be outlines.
Result<HuMask> hu_mask(const HuGrid& grid, const Lattice& lattice, Outlines outlines);

/// Encodes the HU `value(column, row)` of the samples of a mask. Rounding errors are carried over to
/// samples that follow (Floyd and Steinberg), so the mean of neighbouring samples is more exact than each
/// of them. HU that are multiples of the step are unchanged.
std::vector<std::uint8_t> encode_hu_plane(const HuGrid& grid, const HuMask& mask,
                                          const std::function<float(int column, int row)>& value);

/// The plane without index and T_lps_plane. Errors, without the file's name: (refused).
Result<HuPlane> decode_hu_plane(std::span<const std::uint8_t> bytes, const HuGrid& grid,
                                const Lattice& lattice, Outlines outlines);

}  // namespace trocar
