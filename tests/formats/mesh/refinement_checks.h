// SPDX-License-Identifier: Apache-2.0
// The contract of a local refinement, which holds for every sheet and all options.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "formats/mesh/local_refinement.h"
#include "formats/mesh/mesh_validity.h"
#include "tests/support/check_sheet_mesh.h"
#include "tests/support/delaunay_fixture.h"

namespace trocar::runtime {

/// Wanted length of edges, in lattice steps. It grows linearly with the distance from a disc.
struct GradedSize {
  LatticePoint centre;                                         ///< centre of the disc
  double radius = 0;                                           ///< radius of the disc, steps
  double at_radius = std::numeric_limits<double>::infinity();  ///< wanted length in the disc
  double growth = 0;  ///< increase of the wanted length per step of distance from the disc
  double largest = std::numeric_limits<double>::infinity();  ///< largest wanted length
  double operator()(double x, double y) const noexcept {
    const double dx = x - centre.x, dy = y - centre.y;
    const double beyond = std::sqrt(dx * dx + dy * dy) - radius;
    return std::min(at_radius + growth * std::max(beyond, 0.0), largest);
  }
};

// ---- measures that do not use the code under test ----

inline double angle_deg(LatticePoint at, LatticePoint p, LatticePoint q) {
  const double px = p.x - at.x, py = p.y - at.y, qx = q.x - at.x, qy = q.y - at.y;
  return std::abs(std::atan2(px * qy - py * qx, px * qx + py * qy)) * 180 / std::numbers::pi;
}

inline double smallest_angle_deg(const std::array<LatticePoint, 3>& v) {
  return std::min(
      {angle_deg(v[0], v[1], v[2]), angle_deg(v[1], v[2], v[0]), angle_deg(v[2], v[0], v[1])});
}

inline double longest_edge(const std::array<LatticePoint, 3>& v) {
  return static_cast<double>(
      std::max({length(v[0], v[1]), length(v[1], v[2]), length(v[2], v[0])}));
}

struct BoundaryEdge {
  LatticePoint from, to, apex;
  bool is_obtuse() const { return diametral_dot(from, to, apex) < 0; }
};

inline std::vector<BoundaryEdge> boundary(const SheetMesh& mesh) {
  std::vector<BoundaryEdge> out;
  for (const std::uint32_t t : all_triangles(mesh)) {
    const std::array<LatticePoint, 3> v = corners(mesh, t);
    for (std::size_t i = 0; i < 3; ++i) {
      if (mesh.across[t][i] == kNoSlot) out.push_back({v[i], v[(i + 1) % 3], v[(i + 2) % 3]});
    }
  }
  return out;
}

inline bool lies_on(LatticePoint p, const BoundaryEdge& s) {
  return orient2d(s.from, s.to, p) == 0 && diametral_dot(s.from, s.to, p) <= 0;
}

struct Counts {
  std::uint32_t triangles = 0, sharp = 0, surely_sharp = 0, obtuse = 0;
};

inline Counts counts(const SheetMesh& mesh, double min_angle_deg) {
  Counts out;
  for (const std::uint32_t t : all_triangles(mesh)) {
    const double angle = smallest_angle_deg(corners(mesh, t));
    ++out.triangles;
    out.sharp += angle < min_angle_deg + 1e-6 ? 1 : 0;
    out.surely_sharp += angle < min_angle_deg - 1e-6 ? 1 : 0;
  }
  for (const BoundaryEdge& s : boundary(mesh))
    out.obtuse += s.is_obtuse() ? 1 : 0;
  return out;
}

// Can a boundary edge be the reason why triangle v is still sharp: does the point that would remove
// it lie in the diametral circle of such an edge, or beyond one? With a tolerance of a few steps
// for rounding. Triangles with shorter edges are not refined.
inline bool is_outline_near(const std::array<LatticePoint, 3>& v, double min_angle_deg,
                            const std::vector<BoundaryEdge>& edges) {
  std::size_t k = 0;
  for (std::size_t i = 1; i < 3; ++i) {
    if (distance2(v[i], v[(i + 1) % 3]) < distance2(v[k], v[(k + 1) % 3])) k = i;
  }
  const LatticePoint p = v[k], q = v[(k + 1) % 3], r = v[(k + 2) % 3];
  const auto base = static_cast<double>(length(p, q));
  if (base < 4) return true;  // the lattice is the reason
  const double beta = angle_deg(r, p, q) * std::numbers::pi / 180;
  const double theta = min_angle_deg * std::numbers::pi / 180;
  // The circumcentre sees pq under 2 beta, the off-centre under theta.
  const double high = std::min(0.5 * base / std::tan(beta), 0.5 * base / std::tan(theta / 2));
  const double x = 0.5 * (p.x + q.x) - high / base * (q.y - p.y);
  const double y = 0.5 * (p.y + q.y) + high / base * (q.x - p.x);
  const double cx = (v[0].x + v[1].x + v[2].x) / 3.0, cy = (v[0].y + v[1].y + v[2].y) / 3.0;
  const double slack = 3 + 0.4 * high * std::min(1.0, 4 / base);
  for (const BoundaryEdge& s : edges) {
    const double mx = 0.5 * (s.from.x + s.to.x), my = 0.5 * (s.from.y + s.to.y);
    if (std::hypot(x - mx, y - my) < 0.5 * static_cast<double>(length(s.from, s.to)) + slack)
      return true;
    const auto side_of = [&s](double px, double py) {
      return (s.to.x - s.from.x) * (py - s.from.y) - (s.to.y - s.from.y) * (px - s.from.x);
    };
    const auto ray_of = [&](LatticePoint e) {
      return (x - cx) * (e.y - cy) - (y - cy) * (e.x - cx);
    };
    if (side_of(cx, cy) * side_of(x, y) <= 0 && ray_of(s.from) * ray_of(s.to) <= 0) return true;
  }
  return false;
}

// ---- the contract ----

inline LocalRefinementResult refine_and_check(SheetMesh& mesh,
                                              const std::vector<std::uint32_t>& seeds,
                                              const LocalRefinementOptions& options,
                                              const std::string& where) {
  SCOPED_TRACE(where);
  const SheetMesh before = mesh;
  const bool was_delaunay = is_constrained_delaunay(to_slice_mesh(before));
  SheetEdit edit(mesh);
  edit.begin(mesh);
  LocalRefinementWorkspace workspace(mesh);
  const LocalRefinementResult result = refine_locally(mesh, edit, seeds, options, workspace);

  // 1
  const Result<void> valid = check_sheet_mesh(mesh);
  EXPECT_TRUE(valid) << valid.error().message;
  EXPECT_TRUE(!was_delaunay || is_constrained_delaunay(to_slice_mesh(mesh)));
  // 2
  const std::int64_t lost = doubled_area(to_slice_mesh(before)) - doubled_area(to_slice_mesh(mesh));
  EXPECT_EQ(lost, result.doubled_area_lost);
  EXPECT_GE(lost, 0);
  const std::vector<BoundaryEdge> old_edges = boundary(before);
  if (!options.split_outline) {
    EXPECT_EQ(lost, 0);
    for (const BoundaryEdge& s : boundary(mesh)) {
      // 6
      EXPECT_TRUE(std::any_of(old_edges.begin(), old_edges.end(), [&s](const BoundaryEdge& o) {
        return lies_on(s.from, o) && lies_on(s.to, o) && (o.is_obtuse() || !s.is_obtuse());
      }));
    }
  }
  // 3
  EXPECT_LE(result.vertices_added, options.max_new_vertices);
  EXPECT_EQ(mesh.vertices_in_use() + result.vertices_removed,
            before.vertices_in_use() + result.vertices_added);
  SheetMesh replica = before;
  edit.change().copy_to(mesh, replica);
  EXPECT_TRUE(same(replica, mesh)) << "a slot was written and not listed";
  // 5
  SheetMesh again = before;
  edit.begin(again);
  refine_locally(again, edit, seeds, options, workspace);
  EXPECT_TRUE(same(again, mesh)) << "the second run differs";
  return result;
}

// The same with all triangles as seeds, and the counts.
inline void refine_all_and_check(SheetMesh& mesh, const LocalRefinementOptions& options,
                                 const std::string& where) {
  const LocalRefinementResult result = refine_and_check(mesh, all_triangles(mesh), options, where);
  const Counts now = counts(mesh, options.min_angle_deg);
  EXPECT_EQ(result.inspected, now.triangles) << where;
  EXPECT_LE(result.sharp, now.sharp) << where;
  EXPECT_GE(result.sharp, now.surely_sharp) << where;
  EXPECT_EQ(result.obtuse_edges, now.obtuse) << where;
  EXPECT_TRUE(result.outcome != LocalRefinementOutcome::kDone ||
              result.sharp + result.obtuse_edges == 0)
      << where;
  if (result.outcome != LocalRefinementOutcome::kDone &&
      result.outcome != LocalRefinementOutcome::kLimitedByOutline)
    return;
  // Each sharp triangle that is left has a known reason.
  EXPECT_EQ(result.sharp, result.sharp_at_outline + result.sharp_at_lattice) << where;
  const std::vector<BoundaryEdge> edges = boundary(mesh);
  for (const std::uint32_t t : all_triangles(mesh)) {
    const std::array<LatticePoint, 3> v = corners(mesh, t);
    if (smallest_angle_deg(v) >= options.min_angle_deg - 1e-6) continue;
    EXPECT_TRUE(is_outline_near(v, options.min_angle_deg, edges))
        << where << ": triangle " << t << " at " << v[0].x << ' ' << v[0].y << ", " << v[1].x << ' '
        << v[1].y << ", " << v[2].x << ' ' << v[2].y;
  }
}

}  // namespace trocar::runtime
