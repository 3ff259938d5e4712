// SPDX-License-Identifier: Apache-2.0
#include "runtime/hole_cutting/patch_proof.h"

namespace trocar::runtime {
namespace {

using Segment = ProofSpace::Segment;

// Proves statement 2 if the triangle beyond edge i is a new one. `apex` receives the apex
// of that triangle.
bool mutual(const Patch& patch, std::uint32_t t, std::uint32_t i, std::uint32_t& apex) {
  const std::uint32_t u = patch.across[t][i];
  const std::uint32_t from = patch.triangles[t][i], to = patch.triangles[t][next_corner(i)];
  for (std::uint32_t j = 0; j < 3; ++j) {
    if (patch.triangles[u][j] != to || patch.triangles[u][next_corner(j)] != from) continue;
    apex = patch.triangles[u][previous_corner(j)];
    return patch.across[u][j] == t;
  }
  return false;
}

// Proves statement 2 if the triangle beyond the edge is a kept one.
bool takes_kept_edge(const SheetMesh& mesh, std::uint32_t kept, LatticePoint from, LatticePoint to,
                     ProofSpace& space) {
  for (std::uint32_t j = 0; j < 3; ++j) {
    if (mesh.vertices[mesh.triangles[kept][j]] != to ||
        mesh.vertices[mesh.triangles[kept][next_corner(j)]] != from)
      continue;
    if (!space.kept_edge_at.contains(pair_key(kept, j))) return false;
    std::uint32_t& used = *space.kept_edge_at.insert(pair_key(kept, j), 0);
    return used++ == 0;
  }
  return false;
}

bool list_cavity_boundary(const Cavity& cavity, const Overlay& overlay, ProofSpace& space) {
  space.kept_edge_at.clear();
  space.boundary_at.clear();
  for (const CavityBoundaryEdge& e : cavity.boundary) {
    if (e.kept != kNoSlot) {
      if (space.kept_edge_at.insert(pair_key(e.kept, e.kept_edge), 0) == nullptr) return false;
    } else {
      const std::uint64_t key =
          pair_key(overlay.boundary_point[e.from], overlay.boundary_point[e.to]);
      if (space.boundary_at.insert(key, 0) == nullptr) return false;
    }
  }
  return true;
}

// Lists the boundary edges of kept triangles: edges shared with the cavity beyond which
// there is no new triangle, and the old boundary near the new boundary edges.
bool list_kept_boundary(const SheetMesh& mesh, const TriangleGrid& grid, const Cavity& cavity,
                        ProofSpace& space) {
  bool fits = true;
  for (const CavityBoundaryEdge& e : cavity.boundary) {
    if (e.kept != kNoSlot && space.kept_edge_at.find(pair_key(e.kept, e.kept_edge)) == 0)
      fits = fits && push_within(space.old, {mesh.vertices[cavity.boundary_vertices[e.to]],
                                             mesh.vertices[cavity.boundary_vertices[e.from]]});
  }
  LatticeBox box{space.fresh.front().a, space.fresh.front().a};
  for (const Segment& s : space.fresh)
    box = box_around(std::array<LatticePoint, 4>{box.low, box.high, s.a, s.b});
  const auto list_boundary = [&](std::uint32_t t) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      if (mesh.across[t][i] != kNoSlot || cavity.contains(t)) continue;
      const Triangle& v = mesh.triangles[t];
      fits =
          fits && push_within(space.old, {mesh.vertices[v[i]], mesh.vertices[v[next_corner(i)]]});
    }
  };
  if (contains(cavity.tool_box, box)) {
    for (const std::uint32_t t : cavity.near_tool)
      list_boundary(t);
  } else {
    grid.for_each(mesh, box, list_boundary);
  }
  return fits;
}

bool any_crossing(const ProofSpace& space) {
  for (std::size_t i = 0; i < space.fresh.size(); ++i) {
    const Segment& s = space.fresh[i];
    const LatticeBox box = box_around(s.a, s.b);
    const auto crosses = [&](const Segment& t) {
      return !apart(box, box_around(t.a, t.b)) && segments_cross(s.a, s.b, t.a, t.b);
    };
    for (std::size_t j = i + 1; j < space.fresh.size(); ++j) {
      if (crosses(space.fresh[j])) return true;
    }
    for (const Segment& t : space.old) {
      if (crosses(t)) return true;
    }
  }
  return false;
}

std::int64_t doubled_area_removed(const SheetMesh& mesh, const Cavity& cavity,
                                  const Overlay& overlay, const Patch& patch) {
  std::int64_t sum = 0;
  for (const std::uint32_t t : cavity.triangles) {
    const auto [a, b, c] = corners(mesh, t);
    sum += orient2d(a, b, c);
  }
  for (const Triangle& t : patch.triangles)
    sum -= orient2d(overlay.points[t[0]], overlay.points[t[1]], overlay.points[t[2]]);
  return sum;
}

// Proves statements 1 to 3, and lists the new boundary edges. Returns the violated
// statement, or null.
const char* find_defect(const SheetMesh& mesh, const Overlay& overlay, const Patch& patch,
                        ProofSpace& space, bool& full) {
  for (std::uint32_t t = 0; t < patch.triangles.size() && !full; ++t) {
    const std::array<LatticePoint, 3> p = {overlay.points[patch.triangles[t][0]],
                                           overlay.points[patch.triangles[t][1]],
                                           overlay.points[patch.triangles[t][2]]};
    if (orient2d(p[0], p[1], p[2]) <= 0) return "a new triangle is not counter-clockwise";
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t j = next_corner(i);
      if (patch.across[t][i] != kNoSlot) {
        std::uint32_t apex = 0;
        if (!mutual(patch, t, i, apex)) return "an edge of two new triangles is not mutual";
        if (t < patch.across[t][i] && in_circle(p[0], p[1], p[2], overlay.points[apex]) > 0)
          return "the patch is not constrained Delaunay";
      } else if (patch.kept[t][i] != kNoSlot) {
        if (!takes_kept_edge(mesh, patch.kept[t][i], p[i], p[j], space))
          return "a new triangle does not match the kept triangle at its edge";
      } else {
        const bool was_there =
            space.boundary_at.contains(pair_key(patch.triangles[t][i], patch.triangles[t][j]));
        full = full || !push_within(was_there ? space.old : space.fresh, {p[i], p[j]});
      }
    }
  }
  return nullptr;
}

std::int64_t doubled_area(const HoleOutline& hole) {
  std::int64_t sum = 0;
  for (std::size_t r = 0; r < hole.rings(); ++r) {
    const std::span<const LatticePoint> ring = hole.ring(r);
    for (std::size_t i = 1; i + 1 < ring.size(); ++i)
      sum += orient2d(ring[0], ring[i], ring[i + 1]);
  }
  return sum;
}

}  // namespace

void ProofSpace::allocate(std::size_t max_edges) {
  reserve_touched(fresh, max_edges);
  reserve_touched(old, max_edges);
  kept_edge_at.allocate(max_edges);
  boundary_at.allocate(max_edges);
}

Proof prove(const SheetMesh& mesh, const TriangleGrid& grid, const Cavity& cavity,
            const Overlay& overlay, const Patch& patch, const HoleOutline& hole,
            ProofSpace& space) noexcept {
  Proof proof;
  space.fresh.clear();
  space.old.clear();
  proof.capacity_exceeded = !list_cavity_boundary(cavity, overlay, space);
  if (proof.capacity_exceeded) return proof;
  proof.bug = find_defect(mesh, overlay, patch, space, proof.capacity_exceeded);
  if (proof.capacity_exceeded || proof.bug != nullptr) return proof;
  if (!space.fresh.empty()) {
    proof.capacity_exceeded = !list_kept_boundary(mesh, grid, cavity, space);
    if (proof.capacity_exceeded) return proof;
    if (any_crossing(space)) proof.bug = "edges of the new boundary cross";
  }
  proof.doubled_area_removed = doubled_area_removed(mesh, cavity, overlay, patch);
  if (doubled_area(hole) != proof.doubled_area_removed)
    proof.bug = "the hole's area is not the area that the sheet has lost";
  return proof;
}

}  // namespace trocar::runtime
