// SPDX-License-Identifier: Apache-2.0
// The HU of a scan, as volumes of samples. A volume has at most one HuPlane for each slice. The
// samples of a HuPlane lie in the plane of the slice itself, so that tilt and uneven spacing need
// no resampling. A volume covers either the material and a margin around the material, or
// everything. asset.md has the layout in the file.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "formats/base/result.h"
#include "formats/mesh/lattice.h"
#include "formats/mesh/slice_mesh.h"

namespace trocar {

/// The grid of samples, the same in all planes of a volume.
struct HuGrid {
  Eigen::Vector2d origin_mm = Eigen::Vector2d::Zero();  ///< position of sample (0, 0) in the plane
  Eigen::Vector2d pitch_mm = Eigen::Vector2d::Ones();   ///< distances of columns (x) and rows (y)
  int columns = 0, rows = 0;
  int step_hu = 8;  ///< stored HU are multiples of this step
  /// Samples are stored up to this distance from the material, in lattice steps. A negative value
  /// means that all samples are stored.
  std::int32_t margin_steps = -1;

  bool covers_everything() const { return margin_steps < 0; }
};

/// The samples of one slice.
class HuPlane {
 public:
  int index = 0;                                              ///< AssetSlice::index of the slice
  Eigen::Affine3d T_lps_plane = Eigen::Affine3d::Identity();  ///< AssetSlice::T_lps_plane
  Eigen::Vector2d origin_mm = Eigen::Vector2d::Zero();        ///< position of the first sample
  Eigen::Vector2d pitch_mm = Eigen::Vector2d::Ones();
  int first_column = 0, first_row = 0;  ///< the first sample's column and row in the grid
  int columns = 0, rows = 0;
  std::vector<float> hu;  ///< HU row by row; NaN where no sample is stored

  /// Bilinear interpolation of the four samples around the point (x, y) of the slice plane. Samples
  /// that are not stored have no weight. NaN if none of the four is stored. Does not allocate.
  float at(double x_mm, double y_mm) const noexcept;
  /// The mean of at() over a disc, taken at the 19 disc_points(). Points without a value are
  /// ignored. NaN if no point has a value. Does not allocate; takes less than a microsecond.
  float mean(double x_mm, double y_mm, double radius_mm) const noexcept;
};

struct HuVolume {
  HuGrid grid;
  std::vector<HuPlane> planes;  ///< ascending by index

  /// The plane of a slice, or null. O(log planes).
  const HuPlane* find(int index) const noexcept;
  /// HU at a position in the patient's frame (LPS, mm). The HU are interpolated bilinearly in each
  /// of the two planes around the position, and linearly between these planes along their normals.
  /// If only one of the two planes has a value at the position, the result is this value. If
  /// neither plane has a value, the result is NaN. Beyond the outermost planes, the result is the
  /// value of the nearest plane. Precondition: along their normal the planes are in the order of
  /// their indices, or in the reverse order. O(log planes).
  float at(const Eigen::Vector3d& p_lps_mm) const noexcept;
};

/// 19 points of the disc of radius 1, in rings of 1, 6 and 12 points. Each point represents the
/// same area.
const std::array<Eigen::Vector2d, 19>& disc_points() noexcept;

// Compresses the HU of one slice. The slice's outlines determine which samples are stored, so the
// file need not list the stored samples. asset.md specifies the bytes. Internal to formats/, except
// for the functions that encode.
//
// Contract:
//  1. A sample is stored if its distance from the material is at most HuGrid::margin_steps, the
//     margin. This is decided exactly, on the lattice. If the margin is negative, all samples of
//     the grid are stored.
//  2. decode_hu_plane() restores what encode_hu_plane() stored. It refuses bytes with fewer or more
//     samples than the outlines require, and values out of range. Its memory and time are bounded
//     by the number of edges and the number of samples in the box around outlines and margin. The
//     box has at most kMaxHuSamples samples.

/// Largest number of samples in the box of one plane.
inline constexpr std::int64_t kMaxHuSamples = std::int64_t{1} << 24;
inline constexpr int kMaxHuSide = 1 << 15;  ///< largest number of columns or rows of a grid
/// The largest |HU| that is stored, in units of HuGrid::step_hu; larger values are clamped.
inline constexpr std::int64_t kMaxHuSteps = std::int64_t{1} << 30;
/// The largest margin, lattice steps.
inline constexpr std::int32_t kMaxHuMargin = 1 << 20;

/// The largest number of samples that the boxes of all planes of an asset may have together.
/// Samples that are not stored take memory (4 bytes), but no bytes of the file, so the limit keeps a
/// damaged or hostile file of a few megabytes from taking much more than 1 GiB. It grows with the
/// size of the file.
std::uint64_t max_hu_samples(std::uint64_t file_bytes);

/// Checks the numbers of a grid. Errors: kRefused if a number is out of range; the message does not
/// contain the file's name.
Result<void> check_hu_grid(const HuGrid& grid, const Lattice& lattice);

/// The outlines of a slice, one for each material. Materials may touch, but do not overlap.
using Outlines = std::span<const Pslg* const>;

/// The set of samples that are stored: a box of the grid, and a flag for each sample in the box.
struct HuMask {
  int first_column = 0, first_row = 0, columns = 0, rows = 0;
  std::vector<char> is_stored;  ///< one flag for each sample, row by row; not 0: stored
};
/// Determines the samples of a slice that are stored. Errors: kRefused if the box has more than
/// kMaxHuSamples samples, or if too many edges are close together: finding the stored samples must
/// take fewer than 1024 steps of computation for each edge plus 1024 for each sample.
Result<HuMask> hu_mask(const HuGrid& grid, const Lattice& lattice, Outlines outlines);

/// Encodes the HU of the stored samples of a mask; value(column, row) must return the HU of
/// a sample of the grid. HU are rounded to multiples of the grid's step. Each rounding error
/// is carried over to the samples that follow (Floyd and Steinberg), so the mean of
/// neighbouring samples is more exact than a single sample. If all HU are multiples of the
/// step, no HU is changed.
std::vector<std::uint8_t> encode_hu_plane(const HuGrid& grid, const HuMask& mask,
                                          const std::function<float(int column, int row)>& value);

/// Decodes a plane, except its `index` and `T_lps_plane`. Errors: kRefused if the bytes are damaged
/// or do not fit the outlines; the message does not contain the file's name.
Result<HuPlane> decode_hu_plane(std::span<const std::uint8_t> bytes, const HuGrid& grid,
                                const Lattice& lattice, Outlines outlines);

}  // namespace trocar
