// SPDX-License-Identifier: Apache-2.0
// The mesh on which a force is computed: the part of a sheet around the tool, with the tool's
// outline cut out as for a puncture (the tool is rigid: the sheet under it does not bend), and
// refined towards the tool, where the sheet is steepest. A worker makes it for one response.
//
// Contract (tests/runtime/deformation/deformation_region_test.cpp and
// tests/properties/properties_sheet_test.cpp test each point):
//  1. With radius R, the mesh has every point of the sheet that is nearer than R to the tool's
//     circumscribed circle and connected with the tool through such points, less the tool.
//  2. Its boundary edges lie on the tool (their nodes are kTool), on the sheet's outline (kFree,
//     except for ends on the tool or the ring) or on the ring, towards the rest of the sheet
//     (kRing). No ring node is nearer than R. Nodes of the outline within 2 % of the tool's
//     circumradius from the tool are kTool as well (the tip of a wedge between the two). All others
//     are kFree. With infinite R there is no ring. Edges on the ring are edges of the sheet, so
//     that the mesh conforms to the rest of the sheet.
//  3. `under_tool` is the material under the tool: its area is exactly the area that the cut removed.
//  4. The time is proportional to the region, not to the sheet.
//  5. Sheet and tool moved by lattice steps or rotated by right angles give the same region, moved
//     and rotated, to the bit (unless the canonical rotation is undecided).
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

/// The size of the triangles: edges of `at_tool` circumradii along the tool, growing by `grade` per
/// unit of distance. With a calibrated membrane (calibration.h) and lambda >= 1.5 circumradii, the
/// defaults keep the stiffness under a hexagon within 1 % of the exact one with about 200 free
/// nodes, and mostly within 1.5 % at rims and holes (deformation_accuracy_test.cpp).
struct Grading {
  bool graded = true;  ///< false: the sheet's triangles, changed by the cut only
  double at_tool = 0.33;
  double grade = 0.4;
  std::uint32_t max_new_vertices = 2000;
};

struct RegionOptions {
  double radius_m = std::numeric_limits<double>::infinity();  ///< R; > 0
  Grading grading;
};

/// The part of the sheet under the tool. Its Winkler foundation acts on the tool directly. Relative to the
/// region's `origin`.
struct MaterialUnderTool {
  double area_steps2 = 0;
  Eigen::Vector2d moment_steps3 = Eigen::Vector2d::Zero();  ///< area times its centroid
};

struct RegionMesh {
  SliceMesh mesh;              ///< valid; empty if the tool covers the whole sheet
  std::vector<NodeKind> kind;  ///< kind of each vertex
  LatticePoint origin;         ///< near the tool; reference point of moments
  MaterialUnderTool under_tool;
};

/// Kept from one region to the next, so that only the first ones allocate much. For one thread at a
/// time.
struct RegionWorkspace {
  std::vector<std::uint32_t> queue;
  std::size_t vertex_slots = 0, triangle_slots = 0;  ///< capacity of the members below
  SheetEdit edit;
  CutWorkspace cut;
  std::optional<LocalRefinementWorkspace> refinement;
};

/// `sheet` must be valid. `seeds`: slots that include every triangle with a point of the tool in it
/// (triangle_grid.h finds them); others are ignored. `tool` as for cut() (runtime/hole_cutting/cut.h). A
/// tool beside all material gives an empty mesh and an empty `under_tool`. Errors: as cut().
Result<RegionMesh> make_region(const SheetMesh& sheet, std::span<const std::uint32_t> seeds,
                               const Ring& tool, const Lattice& lattice,
                               const RegionOptions& options, RegionWorkspace& workspace);

/// Those of `seeds` that share an area with the tool, in order; repeated seeds stay repeated.
std::vector<std::uint32_t> seeds_under_tool(const SheetMesh& sheet,
                                            std::span<const std::uint32_t> seeds, const Ring& tool);

}  // namespace trocar::runtime
