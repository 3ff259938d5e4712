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
  std::optional<double>
      max_area_px2;  ///< overrides refinement.max_area_mm2; in pixels of the slice
  Lattice lattice;
  const SliceStack* hu = nullptr;  ///< the CT of a label map (open/labels_with_ct.h), if any
  bool hu_volume = true;  ///< whether the asset gets the HU, for input in HU or with its CT
  bool hu_field = false;  ///< whether to fit a field of HU to the mesh, likewise
  double grade_hu =
      0;  ///< change of HU along an edge (graded_area.h), for input in HU; 0: not graded
};

struct StageTimes {
  double read_ms = 0, segment_ms = 0, contour_ms = 0, simplify_ms = 0, triangulate_ms = 0,
         refine_ms = 0, check_ms = 0, hu_ms = 0;
};

/// One material of a slice, with all data of it that the asset, the report and the
/// pictures contain.
struct MeshedMaterial {
  /// In a label map the smallest of the material's labels, which identifies it in every slice.
  int first_label = 0;
  Pslg contours;  ///< full resolution, small rings dropped
  Pslg pslg;      ///< simplified
  SliceMesh cdt;  ///< constrained Delaunay, outside removed
  Refined refined;
  ProvedOutline outline;  ///< the refined mesh's boundary: the PSLG with its Steiner points
  MeshQuality quality;
  /// The mean HU of the pixels that are material, before small regions are dropped. It is given for
  /// input in HU that is segmented by a threshold, and for a label map with its CT.
  std::optional<double> mean_hu;
  std::optional<HuField> hu;  ///< field over refined.mesh, for input in HU or with its CT
  /// Two-sided Hausdorff distance between `contours` and `pslg`, ring by ring, or border by border
  /// if there are several materials. If areas are kept (SimplificationMethod::kArea), it is the
  /// distance between `contours` and `outline`, which includes the points of refinement.
  double simplification_error_mm = 0;
  double area_mm2 = 0;
  int holes = 0;
};

struct MeshedSlice {
  bool all_material = false;  ///< whether every pixel is material
  /// At least one entry, whose mesh is empty if nothing is material. In a label map the materials
  /// with a mesh, ascending by `first_label`; their outlines pass check_shared_borders().
  std::vector<MeshedMaterial> materials;
  std::set<int> labels;         ///< the wanted labels that occur in the slice
  std::size_t not_numbers = 0;  ///< Image::not_numbers, of the CT of a label map, too
  ValueTally values;            ///< statistics of input in HU, or with material chosen by labels
  double max_area_bound_mm2 = 0;
  std::optional<Image> hu;  ///< the cropped HU of all pixels, with MeshOptions::hu_volume
  StageTimes times;

  double area_mm2() const;
};

/// Errors (refused): pixels too fine for the lattice, or the image too large for it.
Result<void> check_lattice(const SliceStack& stack, int slice, const Lattice& lattice);

/// Every PSLG has passed check_pslg(), and every mesh check_delaunay_mesh()
/// (formats/geometry/mesh_validity.h). Several materials share one network of borders
/// (contour/label_borders.h) and have passed check_shared_borders()
/// (formats/geometry/shared_borders.h). Errors: those of stack.read(); (refused) pixels too fine
/// for the lattice, the image too large for it, or too many materials; (usage) options that only
/// one material can have; (bug) one of these checks failed.
Result<MeshedSlice> mesh_slice(const SliceStack& stack, int slice, const MeshOptions& options);

}  // namespace trocar::pipeline
