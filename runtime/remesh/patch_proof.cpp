// SPDX-License-Identifier: Apache-2.0
#include "runtime/remesh/patch_proof.h"

namespace trocar::runtime {
namespace {

using Segment = ProofSpace::Segment;

LatticePoint corner(const Overlay& overlay, const Patch& patch, std::size_t t, std::size_t i) {
  return overlay.points[patch.triangles[t][i % 3]];
}

// Law 2, towards another new triangle; the corner of that one beyond the side.
bool mutual(const Patch& patch, std::uint32_t t, std::size_t i, std::uint32_t& apex) {
  const std::uint32_t u = patch.across[t][i];
  const std::uint32_t from = patch.triangles[t][i], to = patch.triangles[t][(i + 1) % 3];
  for (std::size_t j = 0; j < 3; ++j) {
    if (patch.triangles[u][j] != to || patch.triangles[u][(j + 1) % 3] != from) continue;
    apex = patch.triangles[u][(j + 2) % 3];
    return patch.across[u][j] == t;
  }
  return false;
}

// Law 2, towards a triangle that stays.
bool takes_rim_edge(const SheetMesh& mesh, std::uint32_t kept, LatticePoint from, LatticePoint to,
                    ProofSpace& space) {
  for (std::uint32_t j = 0; j < 3; ++j) {
    if (mesh.vertices[mesh.triangles[kept][j]] != to ||
        mesh.vertices[mesh.triangles[kept][(j + 1) % 3]] != from)
      continue;
    if (!space.rim_at.contains(pair_key(kept, j))) return false;
    std::uint32_t& used = *space.rim_at.insert(pair_key(kept, j), 0);
    return used++ == 0;
  }
  return false;
}

bool list_rim(const SheetMesh& mesh, const Cavity& cavity, const Overlay& overlay,
              ProofSpace& space) {
  space.rim_at.clear();
  space.boundary_at.clear();
  for (const RimEdge& e : cavity.rim) {
    if (e.kept != kNone) {
      if (space.rim_at.insert(pair_key(e.kept, e.kept_side), 0) == nullptr) return false;
    } else {
      const std::uint32_t from = overlay.point_at.find(Overlay::key(mesh.vertices[e.from]));
      const std::uint32_t to = overlay.point_at.find(Overlay::key(mesh.vertices[e.to]));
      if (space.boundary_at.insert(pair_key(from, to), 0) == nullptr) return false;
    }
  }
  return true;
}

// The boundary to be of the triangles that stay near the new boundary edges.
bool list_kept_boundary(const SheetMesh& mesh, const TriangleGrid& grid, const Cavity& cavity,
                        ProofSpace& space) {
  LatticeBox box{space.fresh.front().a, space.fresh.front().a};
  for (const Segment& s : space.fresh) {
    const std::array<LatticePoint, 4> all = {box.lowest, box.highest, s.a, s.b};
    box = box_around(all);
  }
  bool fits = true;
  grid.for_each(mesh, box, [&](std::uint32_t t) {
    const std::array<std::uint32_t, 3>& across = mesh.across[t];
    for (std::uint32_t i = 0; i < 3; ++i) {
      // A shared rim edge that no new triangle has taken is laid bare.
      if (across[i] != kNone && space.rim_at.find(pair_key(t, i)) != 0) continue;
      if (cavity.contains(t)) return;
      const Triangle& v = mesh.triangles[t];
      fits = fits && push_within(space.old, {mesh.vertices[v[i]], mesh.vertices[v[(i + 1) % 3]]});
    }
  });
  return fits;
}

bool any_crossing(const ProofSpace& space) {
  for (std::size_t i = 0; i < space.fresh.size(); ++i) {
    const Segment& s = space.fresh[i];
    const LatticeBox box = box_around(std::array<LatticePoint, 2>{s.a, s.b});
    const auto crosses = [&](const Segment& t) {
      return !apart(box, box_around(std::array<LatticePoint, 2>{t.a, t.b})) &&
             segments_cross(s.a, s.b, t.a, t.b);
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

}  // namespace

void ProofSpace::allocate(std::size_t max_edges) {
  reserve_touched(fresh, max_edges);
  reserve_touched(old, max_edges);
  rim_at.allocate(max_edges);
  boundary_at.allocate(max_edges);
}

std::int64_t doubled_area_removed(const SheetMesh& mesh, const Cavity& cavity,
                                  const Overlay& overlay, const Patch& patch) noexcept {
  std::int64_t sum = 0;
  for (const std::uint32_t t : cavity.triangles) {
    const auto [a, b, c] = corners(mesh, t);
    sum += orient2d(a, b, c);
  }
  for (const Triangle& t : patch.triangles)
    sum -= orient2d(overlay.points[t[0]], overlay.points[t[1]], overlay.points[t[2]]);
  return sum;
}

const char* disprove(const SheetMesh& mesh, const TriangleGrid& grid, const Cavity& cavity,
                     const Overlay& overlay, const Patch& patch, const HoleOutline& hole,
                     ProofSpace& space, bool& full) noexcept {
  space.fresh.clear();
  space.old.clear();
  full = !list_rim(mesh, cavity, overlay, space);
  for (std::uint32_t t = 0; t < patch.triangles.size() && !full; ++t) {
    const LatticePoint a = corner(overlay, patch, t, 0), b = corner(overlay, patch, t, 1),
                       c = corner(overlay, patch, t, 2);
    if (orient2d(a, b, c) <= 0) return "a new triangle is not counter-clockwise";
    for (std::uint32_t i = 0; i < 3; ++i) {
      const LatticePoint from = corner(overlay, patch, t, i), to = corner(overlay, patch, t, i + 1);
      if (patch.across[t][i] != kNone) {
        std::uint32_t apex = 0;
        if (!mutual(patch, t, i, apex)) return "a side of two new triangles is not mutual";
        if (in_circle(a, b, c, overlay.points[apex]) > 0)
          return "the patch is not constrained Delaunay";
      } else if (patch.kept[t][i] != kNone) {
        if (!takes_rim_edge(mesh, patch.kept[t][i], from, to, space))
          return "a new triangle does not fit on the one that stays beside it";
      } else {
        const bool was_there = space.boundary_at.contains(
            pair_key(patch.triangles[t][i], patch.triangles[t][(i + 1) % 3]));
        full = full || !push_within(was_there ? space.old : space.fresh, {from, to});
      }
    }
  }
  if (!full && !space.fresh.empty()) {
    full = !list_kept_boundary(mesh, grid, cavity, space);
    if (!full && any_crossing(space)) return "edges of the new boundary cross";
  }
  std::int64_t of_hole = 0;
  for (std::size_t r = 0; r < hole.rings(); ++r) {
    const std::span<const LatticePoint> ring = hole.ring(r);
    for (std::size_t i = 1; i + 1 < ring.size(); ++i)
      of_hole += orient2d(ring[0], ring[i], ring[i + 1]);
  }
  if (of_hole != doubled_area_removed(mesh, cavity, overlay, patch))
    return "the hole's area is not what the sheet has lost";
  return nullptr;
}

}  // namespace trocar::runtime
