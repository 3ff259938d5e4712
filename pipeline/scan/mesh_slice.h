// SPDX-License-Identifier: GPL-3.0-or-later
// Turns the pixels of one slice into verified meshes of its materials.
#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "formats/geometry/proved_outline.h"
#include "pipeline/contour/contour.h"
#include "pipeline/contour/simplification.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/scan/hu_field.h"
#include "pipeline/segment/label_map_detection.h"
#include "pipeline/segment/slice_field.h"
#include "pipeline/triangulation/mesh_quality.h"
#include "pipeline/triangulation/refinement.h"

namespace trocar::pipeline {

struct MeshOptions : MaterialOptions {
  ContourKind contour = ContourKind::kSubpixel;
  SimplificationOptions simplification;
  RefinementOptions refinement;
  /// Largest area of a triangle as a multiple of a pixel's area. If set, it replaces
  /// refinement.max_area_mm2.
  std::optional<double> max_area_px2;
  Lattice lattice;
  const SliceStack* hu = nullptr;  ///< CT of a label map (open/labels_with_ct.h) or null
  /// Stores the HU of the slices in the asset. This has an effect only if the input is in HU or is
  /// a label map with its CT.
  bool hu_volume = true;
  /// Fits a field of HU to each mesh (hu_field.h). This option needs the same input as hu_volume.
  bool hu_field = false;
  /// Makes triangles smaller where HU change: GradedArea's `hu_per_edge` (graded_area.h). 0: off.
  /// Only for a scan in HU: check_ranges() of mesh_stack.h refuses it for other input.
  double grade_hu = 0;
};

/// The times in ms by stage: read, segment, contour, simplify, triangulate, refine, check and hu.
using StageTimes = std::map<std::string, double>;

/// One material of a slice, with all of its data that the asset, the report and the
/// pictures of --dump-stages need.
struct MeshedMaterial {
  /// In a label map: the smallest of the material's labels. It identifies the material
  /// in every slice.
  int first_label = 0;
  Pslg contours;  ///< at full resolution, without small rings
  Pslg pslg;      ///< the simplified contours
  SliceMesh cdt;  ///< constrained Delaunay triangulation of the inside of `pslg`
  Refined refined;
  ProvedOutline outline;  ///< boundary of the refined mesh: `pslg` with its Steiner points
  MeshQuality quality;
  /// The mean HU of the material's pixels. It includes small regions that are dropped later.
  /// There is a value for input in HU with a threshold, and for a label map with its CT.
  std::optional<double> mean_hu;
  std::optional<HuField> hu;  ///< field over refined.mesh, if MeshOptions::hu_field is set
  /// The largest two-sided Hausdorff distance between a ring of `contours` and its simplified ring
  /// in `pslg`. If the slice has several materials, the chains of their borders
  /// (contour/label_borders.h) are compared instead of rings. With SimplificationMethod::kArea,
  /// `contours` are compared with `outline` and not with `pslg`, because refinement moves the
  /// outline as well.
  double simplification_error_mm = 0;
  double area_mm2 = 0;
  int holes = 0;
};

/// Areas that the program has changed in a slice, in all materials together.
struct SliceChanges {
  AreaChange small;  ///< islands and holes below MaterialOptions::min_region_mm2
  /// Area between contours and outlines where these are more than half a pixel apart. (Rounding to
  /// the lattice moves points less: a pixel is at least kMinStepsPerPixel steps wide.)
  double moved_mm2 = 0;
  std::optional<AreaChange> solid;  ///< of SolidBone and ScannerTable; no value without SolidBone
};

struct MeshedSlice {
  bool all_material = false;  ///< whether every pixel is material
  /// The materials of the slice. There is at least one entry; if nothing is material,
  /// its mesh is empty. In a label map there is one entry for each material with a
  /// mesh, ascending by `first_label`. If there are several entries, their outlines
  /// have passed check_shared_borders().
  std::vector<MeshedMaterial> materials;
  std::set<int> labels;         ///< the wanted labels that occur in the slice
  std::size_t not_numbers = 0;  ///< number of NaN pixels in the slice and in the label map's CT
  ValueTally values;            ///< statistics of HU or labels; empty for other input
  /// The wanted bound on the area of triangles. If it would give too many triangles, refinement
  /// uses a larger bound (Refined::max_area_mm2).
  double max_area_bound_mm2 = 0;
  SliceChanges changes;
  std::optional<Image> hu;  ///< HU of all pixels in the crop, for MeshOptions::hu_volume
  StageTimes times;

  double area_mm2() const;
};

/// Checks that a slice fits the lattice. Errors: kRefused if pixels are narrower than
/// kMinStepsPerPixel lattice steps, or if the image with a margin of half a pixel is wider or
/// higher than kMaxAssetSpan lattice steps.
Result<void> check_lattice(const SliceStack& stack, int slice, const Lattice& lattice);

/// Meshes one slice. Every PSLG has passed check_pslg(), and every mesh check_delaunay_mesh()
/// (formats/geometry/mesh_validity.h). If the slice has several materials, two neighbours share
/// their border point by point (contour/label_borders.h), and the outlines have passed
/// check_shared_borders() (formats/geometry/shared_borders.h). Errors: those of stack.read() and
/// check_lattice(); kRefused if there are too many materials; kUsage if an option needs a single
/// material and there are several; kBug if an outline or mesh failed its check.
Result<MeshedSlice> mesh_slice(const SliceStack& stack, int slice, const MeshOptions& options);

}  // namespace trocar::pipeline
