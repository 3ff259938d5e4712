// SPDX-License-Identifier: GPL-3.0-or-later
// One slice from pixels to a verified mesh: the stages in their order.
#pragma once

#include <optional>
#include <set>
#include <vector>

#include "formats/base/result.h"
#include "formats/geometry/proved_outline.h"
#include "pipeline/contour/contour.h"
#include "pipeline/contour/segmentation.h"
#include "pipeline/contour/simplification.h"
#include "pipeline/hu_field.h"
#include "pipeline/label_guess.h"
#include "pipeline/mesh/mesh_quality.h"
#include "pipeline/mesh/refinement.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/solid_bone.h"

namespace trocar::pipeline {

struct Crop {
  int x0 = 0, x1 = 0, y0 = 0, y1 = 0;  ///< pixels, both ends included
};

struct MeshOptions {
  Segmentation segmentation = Threshold{};
  ContourKind contour = ContourKind::kSubpixel;
  SimplificationOptions simplification;
  RefinementOptions refinement;
  std::optional<double> max_area_px2;  ///< overrides refinement.max_area_mm2, in the slice's pixels
  double min_region_mm2 = 1;
  Lattice lattice;
  std::optional<Crop> crop;
  const SliceStack* hu = nullptr;    ///< the CT beside a label map (read/labels_with_ct.h), if any
  const SolidBone* solid = nullptr;  ///< which voxels are material, if not the segmentation alone
  bool hu_field = true;              ///< of input in HU
  double grade_hu = 0;  ///< graded_area.h's HU along an edge, for input in HU; 0: not graded
};

struct StageTimes {
  double read_ms = 0, segment_ms = 0, contour_ms = 0, simplify_ms = 0, triangulate_ms = 0,
         refine_ms = 0, check_ms = 0, hu_ms = 0;
};

/// What the asset, the report and the pictures need of one material of a slice.
struct MeshedMaterial {
  /// Of a label map: the smallest of the material's labels, which names it in every slice.
  int first_label = 0;
  Pslg contours;  ///< full resolution, small rings dropped
  Pslg pslg;      ///< simplified
  SliceMesh cdt;  ///< constrained Delaunay, outside removed
  Refined refined;
  ProvedOutline outline;  ///< the refined mesh's boundary: the PSLG with its Steiner points
  MeshQuality quality;
  /// Of the pixels that are material, before small regions are dropped; only for input in HU that
  /// is segmented by a threshold, and for a label map with its CT beside it.
  std::optional<double> mean_hu;
  std::optional<HuField> hu;  ///< over refined.mesh; only for input in HU, or with its CT
  /// Two-sided Hausdorff distance between `contours` and `pslg`; where areas are kept
  /// (SimplificationMethod::kArea) and `outline`, with the points of refinement. Ring by ring; of
  /// several materials, border by border.
  double simplification_error_mm = 0;
  double area_mm2 = 0;
  int holes = 0;
};

struct MeshedSlice {
  bool all_material = false;  ///< every pixel
  /// At least one, which is empty if there is no material. Of a label map those with a mesh,
  /// ascending by `first_label`: their outlines pass check_shared_borders().
  std::vector<MeshedMaterial> materials;
  std::set<int> labels;  ///< the wanted labels that occur in the slice
  ValueTally values;     ///< of input in HU, or whose material is chosen by labels
  double max_area_bound_mm2 = 0;
  StageTimes times;

  double area_mm2() const;
};

/// The slice's values within the crop, if there is one. Errors: those of stack.read().
Result<Image> read_cropped(const SliceStack& stack, int slice, const std::optional<Crop>& crop);

/// Errors (refused): pixels too fine for the lattice, or the image too large for it.
Result<void> check_lattice(const SliceStack& stack, int slice, const Lattice& lattice);

struct Segmented {
  Field field;
  std::optional<double> solid_mean;  ///< of SolidBone::apply()
};

/// The stages of mesh_slice() up to the contours. `image` is that of read_cropped().
Segmented segment_slice(const SliceStack& stack, int slice, const MeshOptions& options,
                        Image image);
Pslg contours_of(const SliceStack& stack, int slice, const MeshOptions& options,
                 const Field& field);

/// Every PSLG has passed check_pslg(), and every mesh check_delaunay_mesh()
/// (formats/geometry/mesh_validity.h); several materials share one network of borders
/// (contour/label_network.h) and have passed check_shared_borders()
/// (formats/geometry/shared_borders.h). Errors: those of stack.read(); (refused) pixels too fine
/// for the lattice, the image too large for it, or too many materials; (usage) options that only
/// one material can have; (bug) one of these checks failed.
Result<MeshedSlice> mesh_slice(const SliceStack& stack, int slice, const MeshOptions& options);

}  // namespace trocar::pipeline
