// SPDX-License-Identifier: GPL-3.0-or-later
// Solid bone from the material of a segmentation, without soft tissue above the threshold.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/segment/components.h"
#include "pipeline/segment/scanner_table.h"
#include "pipeline/segment/segmentation.h"

namespace trocar::pipeline {

// Finds soft tissue whose HU exceed a threshold for bone: vessels and organs filled with
// contrast medium.
//
// The scan is averaged over blocks of about kBlock_mm. A block is material here if its mean is at
// least the threshold minus 30 HU, an allowance for noise. A region is a set of connected blocks
// that lie deeper than 7 mm below the surface of the material. A second pass searches the rest of
// the material for regions deeper than 4 mm. (Deep regions come first because a vessel and a bone
// that touch are separate at that depth.) The shell of a region is the material around it at the
// surface. A region is soft if its mean is below kMaxSoft_HU and above the mean of its shell. (Bone
// has a denser cortex in its shell. In the shell of a vessel, the HU fall off to those of the
// surrounding tissue.) Each block of material near a region belongs to the nearest region and is
// soft if this region is soft.

inline constexpr double kBlock_mm = 2;
inline constexpr double kMaxSoft_HU = 500;
/// A threshold below this value is not a threshold for bone, so no soft regions are searched for.
/// (Skin and muscle have 20 to 80 HU, so the body itself would be a soft region.)
inline constexpr double kMinBone_HU = 100;

/// Means of a scan's values over blocks of voxels.
class BlockMeans {
 public:
  explicit BlockMeans(const VoxelGrid& grid);
  /// Adds the slice with this index, in HU. Several threads may add different slices at
  /// the same time.
  void add(std::size_t slice, const Image& image);
  /// Computes the means. The caller calls this function once, after adding all slices.
  void finish();

  const VoxelGrid& grid() const { return blocks_; }
  const std::vector<float>& hu() const { return hu_; }
  /// The index of the block that contains voxel (x, y, z).
  std::size_t block(std::size_t x, std::size_t y, std::size_t z) const {
    const auto at = [this](std::size_t axis, std::size_t i) {
      return std::min(i / size_[axis], blocks_.count(axis) - 1);
    };
    return (at(2, z) * blocks_.count(1) + at(1, y)) * blocks_.count(0) + at(0, x);
  }

 private:
  std::array<std::size_t, 3> size_{};  // size of a block along each axis, in voxels
  std::array<std::size_t, 3> voxels_{};
  VoxelGrid blocks_;
  // The mean of each block. Until finish() averages over slices, each slice has its own plane of
  // blocks.
  std::vector<float> hu_;
};

struct SoftRegions {
  /// One value for each block: the highest HU that count as soft tissue, at least 1, or 0 if the
  /// block is in no soft region.
  std::vector<std::uint16_t> limit_HU;
  int count = 0;                   ///< number of soft regions
  double volume_mm3 = 0;           ///< volume of the blocks of all soft regions
  double low_HU = 0, high_HU = 0;  ///< least and largest mean among the soft regions
  bool touches_bone = false;       ///< a soft region is connected with more than 1 ml of bone
};

/// Finds the soft regions, given the threshold of bone. O(blocks + n), where n is the number of
/// blocks in the bounding boxes of all regions of at least 0.3 ml.
SoftRegions find_soft_regions(const BlockMeans& means, double threshold_HU);

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
//     above the threshold, such as vessels with contrast medium (find_soft_regions()), but no voxels of
//     at least 556 HU. With min_volume, small components are then removed once more.
//  2. fill, close: a voxel is filled if it is enclosed (components.h) in at least two of the three
//     planes of voxels through it, or lies in a closed cavity (canals.h), such as a shaft that the
//     end of the scan cuts. Canals (canals.h) along the patient's long axis stay open. A closed
//     cavity is no canal if at least half of it is fat (below -30 HU), or if it is at least 60 mm
//     long and its wall has no gap. A cavity with more than 10 % of air is no closed cavity; and
//     soft tissue that step 1 removed is not filled. If the material is given by a threshold in HU,
//     voxels below kAir_HU are never filled.
//     With `column`, only material near the longest canal is kept (kColumn_mm, kColumnCore_mm).
//  3. mask: material farther than kMaskMargin_mm from the wanted labels of a label map is removed.
//  4. seeds: only material that is connected to the first seed and nearer to it than to any other
//     seed is kept. Distances are lengths of paths in the material (components.h).
//  5. largest: only the N components of the largest volume are kept.
// A component is a set of voxels connected by faces, edges or corners.

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
  /// enclosed: find_enclosed() in components.h.)
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
  /// there is soft tissue above the threshold (find_soft_regions()); cavity_cut if a closed cavity that
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

// The field of one slice of a scan: its pixels within a crop, after segmentation. If wanted, the
// scanner's table is removed, and SolidBone adds and removes pixels.

struct Crop {
  int x0 = 0, x1 = 0, y0 = 0, y1 = 0;  ///< first and last column and row, both included
};

/// The choice of material in a scan.
struct MaterialOptions {
  Segmentation segmentation = Threshold{};
  std::optional<Crop> crop;
  const SolidBone* solid = nullptr;     ///< if not null, the voxels of `solid` are the material
  const ScannerTable* table = nullptr;  ///< table to remove, or null; `solid` must not contain it
  double min_region_mm2 = 1;  ///< islands below this area are dropped, holes below it are filled
};

/// Reads the values of a slice and, if `crop` has a value, crops them. Errors: those of
/// stack.read().
Result<Image> read_cropped(const SliceStack& stack, int slice, const std::optional<Crop>& crop);
/// The same for the pixels that the segmentation of `options` needs. Errors: those of
/// read_pixels().
Result<Pixels> read_cropped(const SliceStack& stack, int slice, const MaterialOptions& options);

struct SliceField {
  Field field;
  std::optional<double> solid_mean;  ///< result of SolidBone::apply(); no value without `solid`
};

/// The field of a slice. Precondition: `pixels` are the result of read_cropped() for this slice.
SliceField slice_field(const SliceStack& stack, int slice, const MaterialOptions& options,
                       Pixels pixels);

}  // namespace trocar::pipeline
