// SPDX-License-Identifier: Apache-2.0
#include "runtime/deformation/region_boundary.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;

/// A node within this distance, in steps, of the tool's outline lies on the tool. The distance is
/// not zero because crossings of the two outlines are rounded to the lattice
/// (runtime/hole_cutting/cut.h).
constexpr double kOnTool = 2;

/// If the sheet's outline meets the tool's at a small angle, the tip of the wedge between them is
/// too thin for well-shaped triangles. The tip then moves with the tool: nodes of the outline that
/// are nearer to the tool than this fraction of its circumradius are kTool.
constexpr double kWedgeDistance = 0.02;

bool is_near(LatticePoint p, double distance, const Ring& tool, const Circle& circle) {
  return (Vector2d(p.x, p.y) - circle.centre).norm() <= circle.radius + distance &&
         distance_to_outline(tool, p.x, p.y) <= distance;
}

BoundaryEdges boundary_edges(const SheetMesh& mesh) {
  BoundaryEdges out;
  out.next.assign(mesh.vertices.size(), kNoSlot);
  out.kind.assign(mesh.vertices.size(), NodeKind::kFree);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    if (mesh.triangles[t] == kFreeSlot) continue;
    for (std::size_t i = 0; i < 3; ++i) {
      if (mesh.across[t][i] == kNoSlot)
        out.next[mesh.triangles[t][i]] = mesh.triangles[t][(i + 1) % 3];
    }
  }
  return out;
}

}  // namespace

double distance_to_outline(const Ring& tool, double x, double y) noexcept {
  const Vector2d p(x, y);
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < tool.size(); ++k) {
    const Vector2d a(tool[k].x, tool[k].y);
    const LatticePoint to = tool[k + 1 == tool.size() ? 0 : k + 1];
    const Vector2d edge = Vector2d(to.x, to.y) - a;
    const double t = std::clamp((p - a).dot(edge) / edge.squaredNorm(), 0.0, 1.0);
    least = std::min(least, (a + t * edge - p).squaredNorm());
  }
  return std::sqrt(least);
}

BoundaryEdges classified_boundary(const SheetMesh& mesh, const std::vector<OuterEdge>& outer,
                                  const Ring& tool, const Circle& circle) {
  BoundaryEdges edges = boundary_edges(mesh);
  for (std::size_t v = 0; v < edges.next.size(); ++v) {
    if (edges.next[v] == kNoSlot) continue;
    const LatticePoint from = mesh.vertices[v], to = mesh.vertices[edges.next[v]];
    if (std::binary_search(outer.begin(), outer.end(), OuterEdge{from, to})) {
      edges.kind[v] = NodeKind::kBorder;
    } else if (is_near(from, kOnTool, tool, circle) && is_near(to, kOnTool, tool, circle)) {
      // The middle must be on the tool, too, to exclude an edge across one of the tool's corners.
      const double x = (static_cast<double>(from.x) + to.x) / 2;
      const double y = (static_cast<double>(from.y) + to.y) / 2;
      if (distance_to_outline(tool, x, y) <= kOnTool) edges.kind[v] = NodeKind::kTool;
    }
  }
  return edges;
}

std::vector<NodeKind> node_kinds(const SheetMesh& refined, const BoundaryEdges& before,
                                 const Ring& tool, const Circle& circle) {
  const BoundaryEdges after = boundary_edges(refined);
  std::vector<NodeKind> kind(refined.vertices.size(), NodeKind::kFree);
  const auto hold = [&](std::uint32_t v, NodeKind by) {
    if (by != NodeKind::kFree && kind[v] != NodeKind::kTool) kind[v] = by;
  };
  for (std::uint32_t v = 0; v < before.next.size(); ++v) {
    if (before.next[v] == kNoSlot) continue;
    std::uint32_t at = v;
    for (hold(at, before.kind[v]); at != before.next[v] && after.next[at] != kNoSlot;) {
      at = after.next[at];
      hold(at, before.kind[v]);
    }
  }
  const double near_tool = std::max(kOnTool, kWedgeDistance * circle.radius);
  for (std::size_t v = 0; v < kind.size(); ++v) {
    if (kind[v] == NodeKind::kFree && after.next[v] != kNoSlot &&
        is_near(refined.vertices[v], near_tool, tool, circle))
      kind[v] = NodeKind::kTool;
  }
  return kind;
}

}  // namespace trocar::runtime
