// SPDX-License-Identifier: GPL-3.0-or-later
// One slice from pixels to verified meshes of its materials.
// Tests: tests/pipeline/triangulation/meshing_test.cpp, tests/pipeline/scan/materials_test.cpp
#pragma once

#include <optional>
#include <set>
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
  /// Largest area of a triangle, in pixels of the slice. Replaces refinement.max_area_mm2.
  std::optional<double> max_area_px2;
  Lattice lattice;
  const SliceStack* hu = nullptr;  ///< the CT of a label map (open/labels_with_ct.h), if any
  /// Give the asset the HU of the slices, if the input is in HU or is a label map with its CT.
  bool hu_volume = true;
  /// Fit a field of HU to the mesh, for the same input as hu_volume.
  bool hu_field = false;
  /// Change of HU along an edge (graded_area.h), for input in HU; 0: areas are not graded.
  double grade_hu = 0;
};

struct StageTimes {
  double read_ms = 0, segment_ms = 0, contour_ms = 0, simplify_ms = 0, triangulate_ms = 0,
         refine_ms = 0, check_ms = 0, hu_ms = 0;
};

/// One material of a slice, with all of its data that the asset, the report and the pictures
/// contain.
struct MeshedMaterial {
  /// In a label map: the smallest of the material's labels, which identifies it in every slice.
  int first_label = 0;
  Pslg contours;  ///< at full resolution, without small rings
  Pslg pslg;      ///< the simplified contours
  SliceMesh cdt;  ///< constrained Delaunay triangulation of `pslg`, without the outside
  Refined refined;
  ProvedOutline outline;  ///< boundary of the refined mesh: `pslg` with its Steiner points
  MeshQuality quality;
  /// The mean HU of the pixels that are material, before small regions are dropped. Present for
  /// input in HU that is segmented by a threshold, and for a label map with its CT.
  std::optional<double> mean_hu;
  std::optional<HuField> hu;  ///< field over refined.mesh, with MeshOptions::hu_field
  /// Two-sided Hausdorff distance between `contours` and `pslg`, ring by ring, or border by border
  /// if there are several materials. If areas are kept (SimplificationMethod::kArea), it is the
  /// distance between `contours` and `outline`, which includes the points of refinement.
  double simplification_error_mm = 0;
  double area_mm2 = 0;
  int holes = 0;
};

struct MeshedSlice {
  bool all_material = false;  ///< whether every pixel is material
  /// The materials of the slice; at least one entry, whose mesh is empty if nothing is material. In
  /// a label map: the materials with a mesh, ascending by `first_label`, whose outlines have passed
  /// check_shared_borders().
  std::vector<MeshedMaterial> materials;
  std::set<int> labels;         ///< the wanted labels that occur in the slice
  std::size_t not_numbers = 0;  ///< Image::not_numbers, including that of the CT of a label map
  ValueTally values;            ///< statistics of input in HU, or with material chosen by labels
  double max_area_bound_mm2 = 0;
  std::optional<Image> hu;  ///< the cropped HU of all pixels, with MeshOptions::hu_volume
  StageTimes times;

  double area_mm2() const;
};

/// Errors: kRefused if the pixels are too fine for the lattice, or the image is too large for it.
Result<void> check_lattice(const SliceStack& stack, int slice, const Lattice& lattice);

/// Meshes one slice. Every PSLG has passed check_pslg(), and every mesh check_delaunay_mesh()
/// (formats/geometry/mesh_validity.h). Several materials share one network of borders
/// (contour/label_borders.h) and have passed check_shared_borders()
/// (formats/geometry/shared_borders.h). Errors: those of stack.read() and check_lattice(); kRefused
/// if there are too many materials; kUsage if several materials have options that only one material
/// can have; kBug if an outline or mesh failed its check.
Result<MeshedSlice> mesh_slice(const SliceStack& stack, int slice, const MeshOptions& options);

}  // namespace trocar::pipeline
