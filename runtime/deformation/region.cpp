// SPDX-License-Identifier: Apache-2.0
#include "runtime/deformation/region.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "runtime/deformation/part.h"
#include "runtime/remesh/cavity.h"
#include "runtime/remesh/cut.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;

Vector2d relative(LatticePoint p, LatticePoint origin) {
  return {static_cast<double>(std::int64_t{p.x} - origin.x),
          static_cast<double>(std::int64_t{p.y} - origin.y)};
}

/// First moment of the mesh's area about `origin`, in steps^3.
Vector2d moment(const SliceMesh& mesh, LatticePoint origin) {
  Vector2d sum = Vector2d::Zero();
  for (const Triangle& t : mesh.triangles) {
    const LatticePoint &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
    sum += static_cast<double>(orient2d(a, b, c)) / 6 *
           (relative(a, origin) + relative(b, origin) + relative(c, origin));
  }
  return sum;
}

/// From a place to the tool's outline, in steps.
double distance_to(const Ring& tool, double x, double y) {
  const Vector2d p(x, y);
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < tool.size(); ++k) {
    const Vector2d a(tool[k].x, tool[k].y);
    const LatticePoint to = tool[k + 1 == tool.size() ? 0 : k + 1];
    const Vector2d side = Vector2d(to.x, to.y) - a;
    const double t = std::clamp((p - a).dot(side) / side.squaredNorm(), 0.0, 1.0);
    least = std::min(least, (a + t * side - p).squaredNorm());
  }
  return std::sqrt(least);
}

/// How far off the tool's outline, in steps, a node may lie that is held by it: where the outline
/// crosses the sheet's own, both are bent to the lattice (cut.h, law 3).
constexpr double kOnTool = 2;

bool on_tool(LatticePoint p, const Ring& tool) {
  return distance_to(tool, p.x, p.y) <= kOnTool;
}

/// The boundary's sides, each with the vertex it starts from (there is one only, as a vertex has
/// one fan of triangles).
struct BoundarySides {
  std::vector<std::uint32_t> next;  ///< by vertex slot; kNone: not on the boundary
  std::vector<NodeKind> kind;       ///< of the side
};

BoundarySides boundary_sides(const SheetMesh& mesh) {
  BoundarySides out;
  out.next.assign(mesh.vertices.size(), kNone);
  out.kind.assign(mesh.vertices.size(), NodeKind::kFree);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    for (std::size_t i = 0; i < 3; ++i) {
      if (mesh.triangles[t] != kFreeSlot && mesh.across[t][i] == kNone)
        out.next[mesh.triangles[t][i]] = mesh.triangles[t][(i + 1) % 3];
    }
  }
  return out;
}

/// What holds each side: the tool if the side runs along it, the ring if it faces the rest of the
/// sheet.
BoundarySides classified_sides(const SheetMesh& mesh, const std::vector<OuterSide>& outer,
                               const Ring& tool, const Circle& circle) {
  BoundarySides sides = boundary_sides(mesh);
  for (std::size_t v = 0; v < sides.next.size(); ++v) {
    if (sides.next[v] == kNone) continue;
    const LatticePoint from = mesh.vertices[v], to = mesh.vertices[sides.next[v]];
    const Vector2d middle = (Vector2d(from.x, from.y) + Vector2d(to.x, to.y)) / 2;
    if (std::binary_search(outer.begin(), outer.end(), OuterSide{from, to})) {
      sides.kind[v] = NodeKind::kRing;
    } else if ((middle - circle.centre).norm() <= circle.radius + kOnTool && on_tool(from, tool) &&
               on_tool(to, tool) && distance_to(tool, middle.x(), middle.y()) <= kOnTool) {
      sides.kind[v] = NodeKind::kTool;
    }
  }
  return sides;
}

/// The kinds of the nodes by slot, from those of the sides before the mesh was refined: the sides
/// into which one was split are of its kind. A node between two kinds is held rather than free,
/// and by the tool rather than by the ring.
std::vector<NodeKind> node_kinds(const SheetMesh& refined, const BoundarySides& before) {
  const BoundarySides after = boundary_sides(refined);
  std::vector<NodeKind> kind(refined.vertices.size(), NodeKind::kFree);
  const auto hold = [&](std::uint32_t v, NodeKind by) {
    if (by != NodeKind::kFree && kind[v] != NodeKind::kTool) kind[v] = by;
  };
  for (std::uint32_t v = 0; v < before.next.size(); ++v) {
    if (before.next[v] == kNone) continue;
    std::uint32_t at = v;
    for (hold(at, before.kind[v]); at != before.next[v] && after.next[at] != kNone;) {
      at = after.next[at];
      hold(at, before.kind[v]);
    }
  }
  return kind;
}

/// Where the sheet's outline meets the tool's at a small angle, the tip of the wedge between them
/// is thinner than any mesh of good triangles. It goes with the tool, to which it clings on one
/// side: nodes of the outline that are this near to the tool, in circumradii, are held by it.
constexpr double kClings = 0.02;

void hold_wedges(const SheetMesh& mesh, const Ring& tool, const Circle& circle,
                 std::vector<NodeKind>& kind) {
  const double near = std::max(kOnTool, kClings * circle.radius);
  const BoundarySides sides = boundary_sides(mesh);
  for (std::size_t v = 0; v < kind.size(); ++v) {
    if (kind[v] != NodeKind::kFree || sides.next[v] == kNone) continue;
    const Vector2d p(mesh.vertices[v].x, mesh.vertices[v].y);
    if ((p - circle.centre).norm() <= circle.radius + near &&
        distance_to(tool, p.x(), p.y()) <= near)
      kind[v] = NodeKind::kTool;
  }
}

/// The tool cut out of the part: the one place that knows how. Errors: as cut().
Result<CutResult> cut_tool(const SliceMesh& part, const Ring& tool) {
  return cut(part, tool);
}

/// Room in `workspace` for meshes of so many vertices, and of twice the triangles.
void make_room(const SheetMesh& mesh, RegionWorkspace& workspace) {
  if (workspace.refinement && mesh.vertices.size() <= workspace.slots) return;
  workspace.slots = mesh.vertices.size();
  workspace.edit = SheetEdit(mesh);
  workspace.refinement.emplace(workspace.slots, 2 * workspace.slots);
}

/// Triangles small where the sheet is steep, and no spring negative. The ring's sides stay as they
/// are: the region still fits into the rest of its sheet.
void refine(SheetMesh& mesh, const BoundarySides& sides, const Ring& tool, double circumradius,
            const Grading& grading, RegionWorkspace& workspace) {
  make_room(mesh, workspace);
  workspace.edit.begin(mesh);
  std::vector<std::uint32_t>& seeds = workspace.queue;
  seeds.clear();
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    if (mesh.in_use(t)) seeds.push_back(t);
  }
  const double at_tool = grading.at_tool * circumradius;
  const auto size = [&](double x, double y) {
    return at_tool + grading.grade * distance_to(tool, x, y);
  };
  LocalRefinementOptions options;
  options.size = size;
  options.max_new_vertices = grading.max_new_vertices;
  options.split_outline = true;
  const auto is_ring = [&](std::uint32_t from, std::uint32_t to) {
    return sides.kind[from] == NodeKind::kRing && sides.next[from] == to;
  };
  options.keep_side = is_ring;
  refine_locally(mesh, workspace.edit, seeds, options, *workspace.refinement);
}

}  // namespace

Result<RegionMesh> make_region(const SheetMesh& sheet, std::span<const std::uint32_t> seeds,
                               const Ring& tool, const Lattice& lattice,
                               const RegionOptions& options, RegionWorkspace& workspace) {
  if (tool.size() < 3) return refused("a tool has at least three corners");
  if (!(options.radius_m > 0)) return refused("a region's radius must be positive");
  RegionMesh region;
  const Circle circle = circle_around(tool);
  region.origin = {static_cast<std::int32_t>(std::lround(circle.centre.x())),
                   static_cast<std::int32_t>(std::lround(circle.centre.y()))};

  const std::vector<std::uint32_t> under = seeds_under_tool(sheet, seeds, tool);
  if (under.empty()) return region;
  const SheetPart part =
      part_around(sheet, under, circle, options.radius_m / lattice.step_m(), workspace.queue);
  const auto without_tool = cut_tool(part.mesh, tool);
  if (!without_tool) return without_tool.error();
  region.borne.area_steps2 = static_cast<double>(without_tool->doubled_area_removed) / 2;
  region.borne.moment_steps3 =
      moment(part.mesh, region.origin) - moment(without_tool->mesh, region.origin);

  const std::size_t spare = options.grading.graded ? options.grading.max_new_vertices : 0;
  auto mesh = make_sheet_mesh(without_tool->mesh, spare, 2 * spare);
  if (!mesh) return mesh.error();
  const BoundarySides sides = classified_sides(*mesh, part.outer, tool, circle);
  if (options.grading.graded) refine(*mesh, sides, tool, circle.radius, options.grading, workspace);
  region.mesh = to_slice_mesh(*mesh);
  // Vertices keep their order, so the kinds only have to close up.
  std::vector<NodeKind> by_slot = node_kinds(*mesh, sides);
  hold_wedges(*mesh, tool, circle, by_slot);
  region.kind.reserve(region.mesh.vertices.size());
  std::vector<std::uint8_t> used(mesh->vertices.size(), 1);
  for (std::uint32_t v : mesh->free_vertices)
    used[v] = 0;
  for (std::size_t v = 0; v < used.size(); ++v) {
    if (used[v] != 0) region.kind.push_back(by_slot[v]);
  }
  return region;
}

std::vector<std::uint32_t> seeds_under_tool(const SheetMesh& sheet,
                                            std::span<const std::uint32_t> seeds,
                                            const Ring& tool) {
  std::vector<std::uint32_t> out;
  for (std::uint32_t t : seeds) {
    if (t < sheet.triangles.size() && sheet.in_use(t) &&
        contact(corners(sheet, t), tool) == Contact::kOverlaps)
      out.push_back(t);
  }
  return out;
}

std::vector<std::uint32_t> find_seeds(const SheetMesh& sheet, const Ring& tool) {
  std::vector<std::uint32_t> seeds;
  if (tool.empty()) return seeds;
  const auto box = [](auto first, auto last) {
    LatticePoint low = *first, high = *first;
    for (auto p = first; p != last; ++p) {
      low = {std::min(low.x, p->x), std::min(low.y, p->y)};
      high = {std::max(high.x, p->x), std::max(high.y, p->y)};
    }
    return std::pair(low, high);
  };
  const auto [low, high] = box(tool.begin(), tool.end());
  for (std::uint32_t t = 0; t < sheet.triangles.size(); ++t) {
    if (!sheet.in_use(t)) continue;
    const std::array<LatticePoint, 3> p = corners(sheet, t);
    const auto [own_low, own_high] = box(p.begin(), p.end());
    if (own_low.x <= high.x && own_low.y <= high.y && own_high.x >= low.x && own_high.y >= low.y)
      seeds.push_back(t);
  }
  return seeds;
}

RegionPart part_within(const RegionMesh& region, const Ring& tool, const Lattice& lattice,
                       double radius_m) {
  RegionPart out;
  out.region.origin = region.origin;
  out.region.borne = region.borne;
  const auto sheet = make_sheet_mesh(region.mesh, 0, 0);
  if (!sheet) return out;  // never: the mesh is valid
  std::vector<std::uint32_t> seeds, queue;
  for (std::uint32_t t = 0; t < region.mesh.triangles.size(); ++t) {
    for (std::uint32_t v : region.mesh.triangles[t]) {
      if (region.kind[v] != NodeKind::kTool) continue;
      seeds.push_back(t);
      break;
    }
  }
  SheetPart part =
      part_around(*sheet, seeds, circle_around(tool), radius_m / lattice.step_m(), queue);
  out.region.mesh = std::move(part.mesh);
  out.parent = std::move(part.parent);
  for (std::uint32_t v : out.parent)
    out.region.kind.push_back(region.kind[v]);
  for (std::size_t v = 0; v < out.parent.size(); ++v) {
    const LatticePoint p = out.region.mesh.vertices[v];
    const auto at = std::lower_bound(part.outer.begin(), part.outer.end(), p,
                                     [](const OuterSide& s, LatticePoint q) { return s.from < q; });
    if (at != part.outer.end() && at->from == p && out.region.kind[v] == NodeKind::kFree)
      out.region.kind[v] = NodeKind::kRing;
  }
  return out;
}

}  // namespace trocar::runtime
