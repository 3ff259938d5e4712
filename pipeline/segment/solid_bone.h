// SPDX-License-Identifier: GPL-3.0-or-later
// Makes solid bone from the material of a segmentation: removes specks, fills the enclosed
// interior, and keeps only the wanted components. The result is a volume of the whole scan (one
// byte for each voxel), so that a slice's material does not depend on which slices are meshed.
//
// A table (scanner_table.h) is removed first. Then these steps follow. A step is skipped if its
// option is not given.
//  1. min_volume: components smaller than this volume are removed. This is done before step 2,
//     because a speck in a gap of the bone could make the gap so narrow that it counts as closed.
//     With or without min_volume, another step follows if `column` is given and the material is
//     given by a threshold of at least kMinBone_HU. This step removes soft tissue whose values are
//     above the threshold, such as vessels with contrast medium (soft_regions.h), but no voxels of
//     at least 556 HU. With min_volume, small components are then removed once more.
//  2. fill, close: a voxel is filled if it is enclosed (plane_flood.h) in at least two of the three
//     planes of voxels through it, or lies in a closed cavity (cavities.h), such as a shaft that the
//     end of the scan cuts. Canals (canals.h) along the patient's long axis stay open. A closed
//     cavity is no canal if at least half of it is fat (below -30 HU), or if it is at least 60 mm
//     long and its wall has no gap. A cavity with more than 10 % of air is no closed cavity; and
//     soft tissue that step 1 removed is not filled. If the material is given by a threshold in HU,
//     voxels below kAir_HU are never filled.
//     With `column`, only material near the longest canal is kept (kColumn_mm, kColumnCore_mm).
//  3. mask: material farther than kMaskMargin_mm from the wanted labels of a label map is removed.
//  4. seeds: only material that is connected to the first seed and nearer to it than to any other
//     seed is kept. Distances are lengths of paths in the material (nearest_seed.h).
//  5. largest: only the N components of the largest volume are kept.
// A component is a set of voxels connected by faces, edges or corners.
#pragma once

#include <Eigen/Core>
#include <array>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/segment/scanner_table.h"
#include "pipeline/segment/segmentation.h"

namespace trocar::pipeline {

inline constexpr float kAir_HU = -200;
inline constexpr double kMaskMargin_mm = 1.5;
/// The option `column` measures distances from the middle of the spinal canal, in planes
/// perpendicular to the patient's long axis. It first removes the material beyond kColumn_mm, so
/// that ribs are cut off there. Then it keeps the components that come within kColumnCore_mm.
inline constexpr double kColumn_mm = 75, kColumnCore_mm = 20;
/// A seed farther than this from any material is refused.
inline constexpr double kMaxSeedDistance_mm = 10;

struct SolidOptions {
  /// A gap in the bone counts as closed if it is at most twice as wide as this distance. (The
  /// distance is the radius of a disc. Regions that the disc cannot enter from outside are
  /// enclosed: find_enclosed() in plane_flood.h.)
  double close_mm = 0;
  /// Largest area that is filled in a plane, or infinite. No value: nothing is filled.
  std::optional<double> fill_mm2;
  double min_volume_mm3 = 0;
  bool column = false;                        ///< keep the spinal column alone; needs fill_mm2
  int largest = 0;                            ///< number of components that are kept; 0: all
  std::vector<Eigen::Vector3d> seeds_lps_mm;  ///< patient coordinates (LPS)
  std::string mask_file;                      ///< a NIfTI or NRRD label map on the scan's grid
  std::set<int> mask_labels;
  bool any() const {
    return fill_mm2 || min_volume_mm3 > 0 || largest > 0 || !seeds_lps_mm.empty() ||
           !mask_file.empty();
  }
};

/// The error if `fill_mm2` is set and there are several materials.
Error fill_of_several_error();

/// The material of a scan, voxel by voxel.
class SolidBone {
 public:
  /// Reads all slices on several threads. Errors: those of reading; kUsage if `fill_mm2` is set,
  /// all labels are wanted and the scan has several; kRefused if the slices are not parallel or not
  /// in ascending order, the mask is unusable or on another grid, a seed is not near any material,
  /// `column` is set but there is no canal, or nothing is left. O(voxels log voxels) with seeds,
  /// otherwise O(voxels).
  static Result<SolidBone> make(const SliceStack& stack, const Segmentation& segmentation,
                                std::optional<SliceAxis> axis, const SolidOptions& options,
                                const ScannerTable* table = nullptr);

  /// Returns true if pixel (x, y) of the uncropped slice is material.
  bool inside(int slice, int x, int y) const {
    return material_[(static_cast<std::size_t>(slice) * height_ + y) * width_ + x] != 0;
  }
  /// Changes a slice's field so that exactly the material voxels have values of material. A value
  /// on the wrong side of the iso-value is mirrored: it gets the same distance from the iso-value
  /// on the other side. Its pixel is marked in Field::changed. Between two pixels that are not
  /// marked, the border stays as it was. Beside a marked pixel it is a smooth curve (contour.h). If
  /// the field is cropped, (offset_x, offset_y) is the slice's pixel at which it begins. Returns
  /// the mean of the original values over the material; no value if nothing is material.
  std::optional<double> apply(int slice, int offset_x, int offset_y, Field& field) const;

  /// The label of the filled voxels if `fill_mm2` is set, all labels are wanted and the scan has a
  /// label. Otherwise 0.
  int filled_label() const { return filled_label_; }

  /// Warnings: contrast_filled if filling is wanted, the threshold is at least kMinBone_HU, and
  /// there is soft tissue above the threshold (soft_regions.h); cavity_cut if a closed cavity that
  /// the end of the scan cuts stays open because it may be a canal.
  const std::vector<Warning>& warnings() const { return warnings_; }
  /// Volumes that were added to the material and removed from it, for the report.
  double filled_mm3() const { return filled_mm3_; }
  double dropped_mm3() const { return dropped_mm3_; }

 private:
  int width_ = 0, height_ = 0, filled_label_ = 0;
  std::vector<std::uint8_t> material_;
  double filled_mm3_ = 0, dropped_mm3_ = 0;
  std::vector<Warning> warnings_;
};

}  // namespace trocar::pipeline
