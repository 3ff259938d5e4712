// SPDX-License-Identifier: Apache-2.0
// The mesh that a force is computed on: the part of a sheet around the tool, with the tool's
// outline cut out exactly as the hole will be (the tool is rigid: under it nothing bends), and
// refined towards the tool, where the sheet is steepest. Made by a worker, thrown away afterwards.
//
// Laws (tests/runtime/deformation/deformation_region_test.cpp and properties_sheet_test.cpp test
// each):
//  1. With radius R, the mesh has every point of the sheet that is nearer than R to the tool's
//     circumscribed circle and connected with the tool through such points, less the tool.
//  2. Its sides lie on the tool (their nodes are kTool), on the sheet's outline (kFree, but for
//     ends on the tool or the ring) or face the rest of the sheet (kRing); no ring node is nearer
//     than R. Nodes of the outline within 2 % of the tool's circumradius from the tool are kTool as
//     well (the tip of a wedge between the two). All others are kFree. Infinite R: no ring. The
//     sides on the ring are the sheet's own: mesh and rest of the sheet fit together.
//  3. `borne` is the part of the sheet under the tool: its area is exactly what the cut removed.
//  4. Time in proportion to the region, not to the sheet.
//  5. Sheet and tool moved by lattice steps or turned by right angles give the same region, moved
//     and turned, to the bit (but where remesh/own_turn.h is undecided).
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "formats/base/result.h"
#include "formats/geometry/slice_mesh.h"
#include "runtime/cut/cut_workspace.h"
#include "runtime/deformation/network.h"
#include "runtime/mesh/sheet_edit.h"
#include "runtime/mesh/sheet_mesh.h"
#include "runtime/refine/local_refinement.h"

namespace trocar::runtime {

/// The size of the triangles: edges of `at_tool` circumradii along the tool, growing by `grade` per
/// distance. With a calibrated membrane (calibration.h) the defaults keep the stiffness under a
/// hexagon within 1 % of the exact one for lambda >= 1.5 circumradii at some 200 free nodes, and
/// mostly within 1.5 % at rims and holes (tests/runtime/deformation/deformation_accuracy_test.cpp).
struct Grading {
  bool graded = true;  ///< false: the sheet's own triangles and what the cut makes of them
  double at_tool = 0.33;
  double grade = 0.4;
  std::uint32_t max_new_vertices = 2000;
};

struct RegionOptions {
  double radius_m = std::numeric_limits<double>::infinity();  ///< R; > 0
  Grading grading;
};

/// What lies under the tool, borne by it directly: moments in lattice steps relative to `origin`.
struct Borne {
  double area_steps2 = 0;
  Eigen::Vector2d moment_steps3 = Eigen::Vector2d::Zero();  ///< area times its centroid
};

struct RegionMesh {
  SliceMesh mesh;              ///< valid; empty if the tool covers all that is there
  std::vector<NodeKind> kind;  ///< of each vertex
  LatticePoint origin;         ///< near the tool; what moments refer to
  Borne borne;
};

/// Kept from one region to the next, so that only the first ones allocate much. One thread at a
/// time.
struct RegionWorkspace {
  std::vector<std::uint32_t> queue;
  std::size_t vertex_slots = 0, triangle_slots = 0;  ///< that the rest has room for
  SheetEdit edit;
  CutWorkspace cut;
  std::optional<LocalRefinementWorkspace> refinement;
};

/// `sheet` is valid; `seeds` are slots in use that include every triangle with a point of the
/// tool in it (triangle_grid.h finds them); `tool` as for cut() (remesh/cut.h). A tool beside all
/// material gives an empty mesh and nothing borne. Errors: as cut().
Result<RegionMesh> make_region(const SheetMesh& sheet, std::span<const std::uint32_t> seeds,
                               const Ring& tool, const Lattice& lattice,
                               const RegionOptions& options, RegionWorkspace& workspace);

/// Those of `seeds` that have an area in common with the tool, each once or as often as given.
std::vector<std::uint32_t> seeds_under_tool(const SheetMesh& sheet,
                                            std::span<const std::uint32_t> seeds, const Ring& tool);

}  // namespace trocar::runtime
