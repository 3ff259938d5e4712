// SPDX-License-Identifier: Apache-2.0
#include "runtime/deformation/region.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "formats/geometry/canonical_rotation.h"
#include "formats/geometry/lattice_offset.h"
#include "runtime/deformation/part.h"
#include "runtime/deformation/region_boundary.h"
#include "runtime/hole_cutting/cavity.h"
#include "runtime/hole_cutting/cut.h"
#include "runtime/sheet_mesh/triangle_grid.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;

/// Free slots for a cut without refinement. If they do not suffice, the cut is repeated with more.
constexpr std::size_t kSpareForCut = 64;
constexpr std::size_t kMaxSpare = std::size_t{1} << 20;

void move_by(LatticePoint by, std::vector<LatticePoint>& points) {
  for (LatticePoint& p : points)
    p = {p.x + by.x, p.y + by.y};
}

/// First moment of the mesh's area about `origin`, in steps^3.
Vector2d moment(const SheetMesh& mesh, LatticePoint origin) {
  Vector2d sum = Vector2d::Zero();
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    if (!mesh.in_use(t)) continue;
    const auto [a, b, c] = corners(mesh, t);
    sum += static_cast<double>(orient2d(a, b, c)) / 6 *
           (offset_in_steps(a, origin) + offset_in_steps(b, origin) + offset_in_steps(c, origin));
  }
  return sum;
}

/// Gives `work` the capacity for this mesh.
void ensure_capacity(const SheetMesh& mesh, RegionWorkspace& work) {
  if (work.refinement && mesh.vertices.size() <= work.vertex_slots &&
      mesh.triangles.size() <= work.triangle_slots)
    return;
  work.vertex_slots = std::max(work.vertex_slots, mesh.vertices.size());
  work.triangle_slots = std::max(work.triangle_slots, mesh.triangles.size());
  work.edit = SheetEdit(work.vertex_slots, work.triangle_slots);
  work.cut = CutWorkspace({work.triangle_slots, work.vertex_slots + kSpareForCut,
                           3 * work.triangle_slots + kSpareForCut});
  work.refinement.emplace(work.vertex_slots, work.triangle_slots);
}

/// Cuts the tool out of the part. If they do not overlap, the part is unchanged. Returns false if
/// there are too few free slots.
Result<bool> cut_tool(SheetMesh& mesh, const Ring& tool, RegionWorkspace& work,
                      MaterialUnderTool& under_tool) {
  work.edit.begin(mesh);
  const CutReport report = cut_in_place(mesh, TriangleGrid(mesh), tool, work.cut, work.edit);
  switch (report.outcome) {
    case CutOutcome::kCut:
    case CutOutcome::kNoOverlap:
      break;
    case CutOutcome::kInvalidTool:
      return refused("tool polygon: not simple, counter-clockwise and on the lattice, of 3 to " +
                     std::to_string(kMaxToolCorners) + " corners");
    case CutOutcome::kBug:
      return bug(std::string("region: ") + report.bug);
    case CutOutcome::kCapacity:
      return false;
  }
  under_tool.area_steps2 = static_cast<double>(report.doubled_area_removed) / 2;
  return true;
}

/// Refines towards the tool, and where possible until no spring is negative. Edges on the ring are
/// not split, so that the region still conforms to the rest of the sheet.
void refine(SheetMesh& mesh, const BoundaryEdges& edges, const Ring& tool, double circumradius,
            const Grading& grading, RegionWorkspace& work) {
  work.edit.begin(mesh);
  work.queue.clear();
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    if (mesh.in_use(t)) work.queue.push_back(t);
  }
  const double at_tool = grading.at_tool * circumradius;
  const auto size = [&](double x, double y) {
    return at_tool + grading.grade * distance_to_outline(tool, x, y);
  };
  const auto is_ring = [&](std::uint32_t from, std::uint32_t to) {
    return from < edges.next.size() && edges.kind[from] == NodeKind::kBorder &&
           edges.next[from] == to;
  };
  LocalRefinementOptions options;
  options.size = size;
  options.max_new_vertices = grading.max_new_vertices;
  options.split_outline = true;
  options.keep_edge = is_ring;
  refine_locally(mesh, work.edit, work.queue, options, *work.refinement);
}

/// Copies the vertices and triangles in use, in the order of their slots as in to_slice_mesh(),
/// with their kinds.
void compact(const SheetMesh& mesh, const std::vector<NodeKind>& by_slot, RegionMesh& region) {
  region.mesh = to_slice_mesh(mesh);
  std::vector<std::uint8_t> used(mesh.vertices.size(), 1);
  for (std::uint32_t v : mesh.free_vertices)
    used[v] = 0;
  region.kind.reserve(region.mesh.vertices.size());
  for (std::size_t v = 0; v < used.size(); ++v) {
    if (used[v] != 0) region.kind.push_back(by_slot[v]);
  }
}

}  // namespace

Result<RegionMesh> make_region(const SheetMesh& sheet, std::span<const std::uint32_t> seeds,
                               const Ring& tool_in_sheet, const Lattice& lattice,
                               const RegionOptions& options, RegionWorkspace& workspace) {
  if (tool_in_sheet.size() < 3) return refused("a tool has at least three corners");
  if (!(options.radius_m > 0)) return refused("a region's radius must be positive");
  RegionMesh region;
  const std::vector<std::uint32_t> under = seeds_under_tool(sheet, seeds, tool_in_sheet);
  SheetPart part;
  if (!under.empty())
    part = part_around(sheet, under, circle_around(tool_in_sheet),
                       options.radius_m / lattice.step_m(), workspace.queue);
  // Coordinates are now relative to the tool and in a canonical rotation by right angles.
  // So rounding depends neither on the position in the slice nor on the rotation of the
  // slice (contract 5).
  const CanonicalRotation rotation = rotation_by_moments([&](auto&& visit) {
    for (const LatticePoint p : part.mesh.vertices)
      visit(p);
    for (const LatticePoint p : tool_in_sheet)
      visit(p);
  });
  Ring tool;
  for (const LatticePoint p : tool_in_sheet)
    tool.push_back(rotation(p));
  const LatticePoint here = box_around(tool).low;
  move_by({-here.x, -here.y}, tool);
  const Circle circle = circle_around(tool);
  const LatticePoint middle{static_cast<std::int32_t>(std::lround(circle.centre.x())),
                            static_cast<std::int32_t>(std::lround(circle.centre.y()))};
  region.origin = rotation.back(LatticePoint{here.x + middle.x, here.y + middle.y});
  if (under.empty()) return region;

  const auto to_canonical = [&](LatticePoint p) {
    const LatticePoint q = rotation(p);
    return LatticePoint{q.x - here.x, q.y - here.y};
  };
  for (LatticePoint& p : part.mesh.vertices)
    p = to_canonical(p);
  for (OuterEdge& edge : part.outer)
    edge = {to_canonical(edge.from), to_canonical(edge.to)};
  std::sort(part.outer.begin(), part.outer.end());
  for (std::size_t spare = options.grading.graded ? kSpareForCut + options.grading.max_new_vertices
                                                  : kSpareForCut;
       spare <= kMaxSpare; spare *= 8) {
    SheetMesh mesh = to_sheet(part, spare, 2 * spare);
    ensure_capacity(mesh, workspace);
    region.under_tool.moment_steps3 = moment(mesh, middle);
    const auto done = cut_tool(mesh, tool, workspace, region.under_tool);
    if (!done) return done.error();
    if (!*done) continue;
    region.under_tool.moment_steps3 -= moment(mesh, middle);
    const BoundaryEdges edges = classified_boundary(mesh, part.outer, tool, circle);
    if (options.grading.graded)
      refine(mesh, edges, tool, circle.radius, options.grading, workspace);
    compact(mesh, node_kinds(mesh, edges, tool, circle), region);
    move_by(here, region.mesh.vertices);
    for (LatticePoint& p : region.mesh.vertices)
      p = rotation.back(p);
    region.under_tool.moment_steps3 = rotation.back(region.under_tool.moment_steps3);
    return region;
  }
  return bug("region: no capacity suffices for the cut");
}

std::vector<std::uint32_t> seeds_under_tool(const SheetMesh& sheet,
                                            std::span<const std::uint32_t> seeds,
                                            const Ring& tool) {
  std::vector<OutlineEdge> edges;
  for (std::size_t i = 0; i < tool.size(); ++i) {
    const std::array<LatticePoint, 2> ends{tool[i], tool[(i + 1) % tool.size()]};
    edges.push_back({ends[0], ends[1], box_around(ends)});
  }
  std::vector<std::uint32_t> out;
  for (std::uint32_t t : seeds) {
    if (t < sheet.triangles.size() && sheet.in_use(t) &&
        intersect_tool(corners(sheet, t), edges) == ToolIntersection::kOverlaps)
      out.push_back(t);
  }
  return out;
}

}  // namespace trocar::runtime
