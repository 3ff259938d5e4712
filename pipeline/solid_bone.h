// SPDX-License-Identifier: GPL-3.0-or-later
// Solid bone from a threshold: what a segmentation calls material, without specks, with its
// enclosed inside filled, and only the pieces that are wanted. A volume of the whole scan is kept
// (a byte a voxel), so that a slice's material does not depend on which slices are meshed.
//
// The steps, in their order; each is left out where its option is not given:
//  1. min_volume: pieces of less are dropped (before filling: specks would close gaps).
//  2. fill, close: a voxel is filled if it is enclosed (plane_flood.h) in at least two of the three
//     directions of slices. What is enclosed in one direction only, as the spinal canal, stays
//     open. Input in HU is never filled below kAir_HU.
//  3. mask: what is farther than kMaskMargin_mm from the wanted labels of a label map is dropped.
//  4. seeds: only what is connected to the first seed and nearer to it, along paths in the
//  material,
//     than to any other seed stays.
//  5. largest: only the N pieces of the largest volume stay.
// A piece is a set of voxels connected by faces, edges or corners.
#pragma once

#include <Eigen/Core>
#include <array>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/contour/segmentation.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

inline constexpr float kAir_HU = -200;
inline constexpr double kMaskMargin_mm = 1.5;
/// A seed farther than this from any material is refused.
inline constexpr double kSeedReach_mm = 10;

struct SolidOptions {
  double close_mm = 0;             ///< radius of the disc: gaps of up to twice this count as closed
  std::optional<double> fill_mm2;  ///< largest patch that is filled in a plane; infinite: any
  double min_volume_mm3 = 0;
  int largest = 0;                            ///< 0: all
  std::vector<Eigen::Vector3d> seeds_lps_mm;  ///< patient coordinates
  std::string mask_file;                      ///< a NIfTI label map on the scan's grid
  std::set<int> mask_labels;
  bool any() const {
    return fill_mm2 || min_volume_mm3 > 0 || largest > 0 || !seeds_lps_mm.empty() ||
           !mask_file.empty();
  }
};

/// Which voxels of a scan are material.
class SolidBone {
 public:
  /// Reads all slices, several at the same time. Errors: those of reading; (refused) slices that
  /// are not parallel or not in ascending order, a mask on another grid, a seed that is not near
  /// any material, nothing left. O(voxels log voxels) with seeds, else O(voxels).
  static Result<SolidBone> make(const SliceStack& stack, const Segmentation& segmentation,
                                SliceAxis axis, const SolidOptions& options);

  /// Material of the pixel, in the whole slice.
  bool inside(int slice, int x, int y) const {
    return material_[(static_cast<std::size_t>(slice) * height_ + y) * width_ + x] != 0;
  }
  /// Makes a slice's field agree: values on the wrong side of the iso-value are mirrored at it, so
  /// that the outline passes half-way between a changed pixel and an equal neighbour; elsewhere it
  /// stays where it was. (offset_x, offset_y): of a cropped field in its slice. Returns the mean of
  /// the material's values before; none if there is none.
  std::optional<double> apply(int slice, int offset_x, int offset_y, Field& field) const;

  /// For the report.
  double filled_mm3() const { return filled_mm3_; }
  double dropped_mm3() const { return dropped_mm3_; }

 private:
  int width_ = 0, height_ = 0;
  std::vector<std::uint8_t> material_;
  double filled_mm3_ = 0, dropped_mm3_ = 0;
};

}  // namespace trocar::pipeline
