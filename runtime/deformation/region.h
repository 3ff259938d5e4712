// SPDX-License-Identifier: Apache-2.0
// The mesh on which a force is computed: the part of a sheet around the tool, with the tool's outline
// cut out as for a puncture. (The tool is rigid, so the sheet under it does not bend.) The mesh is
// refined towards the tool, where the sheet is steepest. A worker thread makes the mesh to compute one
// response (response.h), which is the stiffness at one tool position.
//
// Contract (tests/runtime/deformation/deformation_region_test.cpp and
// tests/properties/properties_sheet_test.cpp test each point):
//  1. With radius R, the mesh contains every point of the sheet that fulfils three conditions: it is
//     nearer than R to the tool's circumscribed circle, it is connected with the tool through such
//     points, and it is not under the tool.
//  2. Each boundary edge lies on the tool, on the sheet's outline, or on the ring, which separates
//     the region from the rest of the sheet. Nodes on the tool are kTool, nodes on the ring are
//     kBorder, and all other nodes are kFree. Nodes of the sheet's outline whose distance from the
//     tool is less than 2 % of the tool's circumradius are kTool as well, because the gap between
//     outline and tool is a thin wedge there. No ring node is nearer to the circle than R. With
//     infinite R there is no ring. Edges on the ring are edges of the sheet, so that the mesh
//     conforms to the rest of the sheet.
//  3. `under_tool` is the material under the tool. Its area is exactly the area that cutting out
//     the tool removed.
//  4. The time is proportional to the size of the region, not to the size of the sheet.
//  5. If sheet and tool are moved by lattice steps or rotated by right angles, the region is moved
//     and rotated with them, and is otherwise the same to the bit. (This does not hold if the
//     moments of part and tool do not determine a unique canonical rotation, see
//     formats/geometry/canonical_rotation.h.)
// Tests: tests/runtime/deformation/deformation_region_test.cpp
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "formats/base/result.h"
#include "formats/geometry/slice_mesh.h"
#include "runtime/deformation/network.h"
#include "runtime/hole_cutting/cut_workspace.h"
#include "runtime/local_refinement/local_refinement.h"
#include "runtime/sheet_mesh/sheet_edit.h"
#include "runtime/sheet_mesh/sheet_mesh.h"

namespace trocar::runtime {

/// Size of the triangles. The edge length at the tool is `at_tool` times the tool's circumradius, and
/// grows by `grade` per unit of distance from the tool. With a calibrated membrane (calibration.h)
/// and a decay length of at least 1.5 circumradii, the defaults give about 200 free nodes. The
/// stiffness under a hexagon is then within 1 % of the exact one, and at edges and holes mostly
/// within 1.5 % (deformation_accuracy_test.cpp).
struct Grading {
  bool graded = true;  ///< false: no refinement; only the cut changes the sheet's triangles
  double at_tool = 0.33;
  double grade = 0.4;
  std::uint32_t max_new_vertices = 2000;
};

struct RegionOptions {
  double radius_m = std::numeric_limits<double>::infinity();  ///< R, positive
  Grading grading;
};

/// The part of the sheet under the tool. The Winkler foundation of this part acts on the tool
/// directly.
struct MaterialUnderTool {
  double area_steps2 = 0;
  /// Area times the vector from RegionMesh::origin to the centroid of the area.
  Eigen::Vector2d moment_steps3 = Eigen::Vector2d::Zero();
};

struct RegionMesh {
  SliceMesh mesh;              ///< a valid mesh; empty if the tool covers the whole sheet
  std::vector<NodeKind> kind;  ///< kind of each vertex
  LatticePoint origin;         ///< a point near the tool, to which moments refer
  MaterialUnderTool under_tool;
};

/// Scratch memory that is reused from one region to the next, so that only the first regions
/// allocate much. Only one thread may use it at a time.
struct RegionWorkspace {
  std::vector<std::uint32_t> queue;
  std::size_t vertex_slots = 0, triangle_slots = 0;  ///< capacity of the members below
  SheetEdit edit;
  CutWorkspace cut;
  std::optional<LocalRefinementWorkspace> refinement;
};

/// Makes the region of a tool position. Precondition: `sheet` is valid. `seeds`: triangle slots of
/// `sheet`, which must include every triangle that contains a point of the tool (triangle_grid.h
/// finds these triangles). Seeds next to the tool are ignored. `tool`: as for cut()
/// (runtime/hole_cutting/cut.h). If no part of the tool lies over material, mesh and `under_tool`
/// are empty. Errors: those of cut(); also kRefused if the tool has fewer than three corners, or if
/// the radius is not positive.
Result<RegionMesh> make_region(const SheetMesh& sheet, std::span<const std::uint32_t> seeds,
                               const Ring& tool, const Lattice& lattice,
                               const RegionOptions& options, RegionWorkspace& workspace);

/// Returns those of `seeds` that have an area in common with the tool, in the same order. A seed
/// that occurs several times in `seeds` is returned as many times.
std::vector<std::uint32_t> seeds_under_tool(const SheetMesh& sheet,
                                            std::span<const std::uint32_t> seeds, const Ring& tool);

}  // namespace trocar::runtime
