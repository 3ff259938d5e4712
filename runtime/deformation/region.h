// SPDX-License-Identifier: Apache-2.0
// Makes a region: the mesh of the part of a sheet around the tool. A worker thread makes a region
// to compute the stiffness at one tool position (response.h). The tool's outline is cut out of the
// mesh as for a puncture, because the tool is rigid and the sheet under the tool does not bend. The
// mesh is refined towards the tool, where the sheet is steepest.
//
// Contract (tests/runtime/deformation/deformation_region_test.cpp and
// tests/properties/properties_sheet_test.cpp test each point):
//  1. With radius R, the mesh contains every point of the sheet that meets three conditions. The
//     point is nearer than R to the tool's circle (circle_around(), part.h). It is connected with
//     the tool through such points. And it is not under the tool.
//  2. The ring is the border between the region and the rest of the sheet. Each boundary edge of
//     the mesh lies on the tool, on the ring, or on the sheet's outline. Nodes on the tool are
//     kTool, nodes on the ring are kBorder, and all other nodes are kFree (NodeKind). A node of
//     the sheet's outline is kTool as well if it is nearer to the tool than 2 lattice steps or 2 %
//     of the tool's circumradius, because the gap between outline and tool is a thin wedge there.
//     No ring node is nearer to the circle than R. With infinite R there is no ring. Edges on the
//     ring are whole edges of the sheet, so there is no gap between the region's mesh and the rest
//     of the sheet.
//  3. `under_tool` is the material under the tool. Its area is exactly the area that was removed
//     when the tool was cut out.
//  4. The time is proportional to the size of the region, not to the size of the sheet.
//  5. If sheet and tool are moved by lattice steps or rotated by right angles, the region is
//     moved and rotated with them, and is otherwise the same to the bit. This does not hold if
//     the tool and the sheet around it have no unique canonical rotation, for example because
//     they are symmetric (formats/geometry/canonical_rotation.h).
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

/// Size of the triangles. At the tool, the edge length is `at_tool` times the tool's circumradius.
/// At the distance d from the tool, the edge length is larger by `grade` times d. If the membrane
/// is calibrated (calibration.h) and the decay length is at least 1.5 circumradii, the defaults
/// give about 200 free nodes. The stiffness under a hexagon then differs by at most 1 % from the
/// exact stiffness. If the hexagon is near an edge or a hole of the sheet, the difference is mostly
/// at most 1.5 % (deformation_accuracy_test.cpp).
struct Grading {
  bool graded = true;  ///< if false, no refinement: only the cut changes the sheet's triangles
  double at_tool = 0.33;
  double grade = 0.4;
  std::uint32_t max_new_vertices = 2000;  ///< largest number of vertices that refinement adds
};

struct RegionOptions {
  double radius_m = std::numeric_limits<double>::infinity();  ///< R, positive
  Grading grading;
};

/// The part of the sheet under the tool. This part moves with the tool, so its Winkler foundation
/// acts on the tool directly.
struct MaterialUnderTool {
  double area_steps2 = 0;
  /// First moment of the area: the area times the vector from RegionMesh::origin to its centroid.
  Eigen::Vector2d moment_steps3 = Eigen::Vector2d::Zero();
};

struct RegionMesh {
  SliceMesh mesh;              ///< valid; empty if the tool misses or covers the sheet
  std::vector<NodeKind> kind;  ///< kind of each vertex
  LatticePoint origin;         ///< point near the tool's centre, to which moments refer
  MaterialUnderTool under_tool;
};

/// Scratch memory that is reused from one region to the next, so that later regions allocate
/// little. Only one thread at a time may use a workspace.
struct RegionWorkspace {
  std::vector<std::uint32_t> queue;                  ///< slots of triangles
  std::size_t vertex_slots = 0, triangle_slots = 0;  ///< capacity of the three members below
  SheetEdit edit;
  CutWorkspace cut;
  std::optional<LocalRefinementWorkspace> refinement;
};

/// Makes the region of a tool position. Preconditions: `sheet` is valid, and `seeds` includes the
/// slots of all triangles that contain a point of the tool (triangle_grid.h finds these triangles).
/// Seeds that do not overlap the tool are ignored. `tool`: as for cut()
/// (runtime/hole_cutting/cut.h). If no part of the tool lies over material, the mesh is empty, and
/// the area of `under_tool` is 0. Errors: those of cut(); also kRefused if the tool has fewer than
/// three corners, or if the radius is not positive.
Result<RegionMesh> make_region(const SheetMesh& sheet, std::span<const std::uint32_t> seeds,
                               const Ring& tool, const Lattice& lattice,
                               const RegionOptions& options, RegionWorkspace& workspace);

/// Returns the seeds whose triangles have an area in common with the tool, in the same order. A
/// seed that occurs several times in `seeds` is returned as many times.
std::vector<std::uint32_t> seeds_under_tool(const SheetMesh& sheet,
                                            std::span<const std::uint32_t> seeds, const Ring& tool);

}  // namespace trocar::runtime
