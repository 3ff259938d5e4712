// SPDX-License-Identifier: GPL-3.0-or-later
// The mesh during refinement: flat arrays, and insertion of a point by its cavity (Bowyer; Watson,
// 1981).
#pragma once

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "formats/geometry/triangle_edge.h"
#include "pipeline/mesh/triangulation.h"

namespace trocar::pipeline {

/// For an edge on the outline, `beyond` is this flag and the input segment's number instead of an
/// EdgeId.
inline constexpr std::uint32_t kOutline = 0x80000000;

/// A triangle's circumcircle, for many points: the determinant of in_circle(), expanded by the
/// point. Exact; 64 bits suffice where all differences are below kReach, which nearly all are.
class Circumcircle {
 public:
  Circumcircle() = default;
  Circumcircle(LatticePoint a, LatticePoint b, LatticePoint c) : origin_(a) {
    const std::int64_t bx = std::int64_t{b.x} - a.x, by = std::int64_t{b.y} - a.y;
    const std::int64_t cx = std::int64_t{c.x} - a.x, cy = std::int64_t{c.y} - a.y;
    if (!(is_in_reach(bx, by) && is_in_reach(cx, cy))) return;
    const std::int64_t b2 = bx * bx + by * by, c2 = cx * cx + cy * cy;
    x_ = b2 * cy - c2 * by;
    y_ = c2 * bx - b2 * cx;
    area2_ = bx * cy - by * cx;
  }

  enum class Answer { kNo, kYes, kTooFar };
  /// Does p lie strictly inside? kTooFar: 64 bits do not suffice.
  Answer contains(LatticePoint p) const {
    const std::int64_t dx = std::int64_t{p.x} - origin_.x, dy = std::int64_t{p.y} - origin_.y;
    if (area2_ == 0 || !is_in_reach(dx, dy)) return Answer::kTooFar;
    return dx * x_ + dy * y_ > (dx * dx + dy * dy) * area2_ ? Answer::kYes : Answer::kNo;
  }

 private:
  // With differences below M: |x|, |y| < 4 M^3, area2 < 2 M^2, so all sums stay below 12 M^4 <
  // 2^63.
  static constexpr std::int64_t kReach = 1 << 14;
  static bool is_in_reach(std::int64_t x, std::int64_t y) {
    return static_cast<std::uint64_t>(x + kReach) < 2 * kReach &&
           static_cast<std::uint64_t>(y + kReach) < 2 * kReach;
  }

  std::int64_t x_ = 0, y_ = 0, area2_ = 0;
  LatticePoint origin_;
};

/// One cache line.
struct alignas(64) WorkingTriangle {
  Circumcircle circle;
  std::array<std::uint32_t, 3> v{};       ///< counter-clockwise
  std::array<std::uint32_t, 3> beyond{};  ///< EdgeId, or kOutline | segment
  std::uint32_t visit = 0;                ///< the last search that took it
  std::uint32_t generation : 31 = 0;      ///< grows when it is replaced
  std::uint32_t is_bad : 1 = 0;           ///< to be improved
};

/// The triangles that the star of a new point replaces, and the rim around them.
struct InsertionCavity {
  struct Rim {
    std::uint32_t a, b;    ///< the cavity is on the left
    std::uint32_t beyond;  ///< EdgeId, or kOutline | segment
    EdgeId inside;         ///< of the cavity's triangle
    // Of the triangle between the edge and the new point; filled in by the Refiner.
    double shortest2 = 0;
    bool is_bad = false;
    bool is_outline() const { return (beyond & kOutline) != 0; }
  };
  std::vector<std::uint32_t> triangles;
  std::vector<Rim> rim;
};

class RefinementMesh {
 public:
  std::vector<LatticePoint> points;
  std::vector<WorkingTriangle> triangles;

  /// Starts again and keeps the memory. `segment(a, b)` gives the number of the input segment that
  /// is the outline's edge from a to b.
  template <typename Segment>
  void assign(const Triangulation& from, Segment segment) {
    points.assign(from.mesh.vertices.begin(), from.mesh.vertices.end());
    triangles.resize(from.mesh.triangles.size());
    for (std::uint32_t t = 0; t < triangles.size(); ++t) {
      set(t, from.mesh.triangles[t], from.beyond[t]);
      triangles[t].visit = triangles[t].generation = triangles[t].is_bad = 0;
      for (std::uint32_t i = 0; i < 3; ++i) {
        if (from.beyond[t][i] == kNoEdge) {
          const auto [a, b] = ends(edge_id(t, i));
          triangles[t].beyond[i] = kOutline | segment(a, b);
        }
      }
    }
    visits_ = 0;
    star_.assign(points.size(), 0);
  }

  std::uint32_t beyond(EdgeId e) const { return triangles[triangle_of(e)].beyond[index_of(e)]; }
  std::pair<std::uint32_t, std::uint32_t> ends(EdgeId e) const {
    const WorkingTriangle& t = triangles[triangle_of(e)];
    return {t.v[index_of(e)], t.v[next_corner(index_of(e))]};
  }
  std::uint32_t apex(EdgeId e) const {
    return triangles[triangle_of(e)].v[previous_corner(index_of(e))];
  }

  /// Is p strictly inside the circumcircle of triangle t? Exact.
  bool circumcircle_contains(std::uint32_t t, LatticePoint p) const {
    const Circumcircle::Answer answer = triangles[t].circle.contains(p);
    if (answer != Circumcircle::Answer::kTooFar) return answer == Circumcircle::Answer::kYes;
    const std::array<std::uint32_t, 3>& v = triangles[t].v;
    return in_circle(points[v[0]], points[v[1]], points[v[2]], p) > 0;
  }

  /// `start`, and all triangles connected with it whose circumcircles contain p; and the edges
  /// around them, without `except`. p lies in `start` or in its circumcircle.
  [[gnu::noinline]] void find_cavity(std::uint32_t start, LatticePoint p, EdgeId except,
                                     InsertionCavity& cavity) {
    cavity.triangles.assign(1, start);
    cavity.rim.clear();
    const std::uint32_t visit = ++visits_;
    triangles[start].visit = visit;
    for (std::size_t k = 0; k < cavity.triangles.size(); ++k) {
      const std::uint32_t t = cavity.triangles[k];
      const WorkingTriangle& tri = triangles[t];
      for (std::uint32_t i = 0; i < 3; ++i) {
        const std::uint32_t beyond = tri.beyond[i];
        if ((beyond & kOutline) == 0) {
          const std::uint32_t n = triangle_of(beyond);
          if (triangles[n].visit == visit) continue;
          if (circumcircle_contains(n, p)) {
            triangles[n].visit = visit;
            cavity.triangles.push_back(n);
            continue;
          }
        }
        const EdgeId inside = edge_id(t, i);
        if (inside != except)
          cavity.rim.push_back({tri.v[i], tri.v[next_corner(i)], beyond, inside});
      }
    }
  }

  /// Replaces the cavity by the star of a new vertex p that lies to the left of all edges of the
  /// rim. The rim is a closed loop, or, where p splits an edge on the outline, open at that edge
  /// (`split`, else kNoEdge). Edge k of the rim becomes edge 0 of triangle fresh[k]. False, and
  /// nothing done, if the rim is not one loop.
  bool fill_cavity(const InsertionCavity& cavity, LatticePoint p, EdgeId split,
                   std::vector<std::uint32_t>& fresh) {
    const std::vector<InsertionCavity::Rim>& rim = cavity.rim;
    // A loop around n triangles has n + 2 edges, an open one n + 1.
    if (rim.size() != cavity.triangles.size() + (split == kNoEdge ? 2 : 1)) return false;
    constexpr std::uint32_t kEnd = 0xffffffff;
    std::uint32_t open = 0;
    if (split != kNoEdge) {
      open = beyond(split);
      star_[ends(split).first] = kEnd;
    }
    const auto v = static_cast<std::uint32_t>(points.size());
    points.push_back(p);
    star_.push_back(0);
    fresh.assign(cavity.triangles.begin(), cavity.triangles.end());
    while (fresh.size() < rim.size()) {
      fresh.push_back(static_cast<std::uint32_t>(triangles.size()));
      triangles.emplace_back();
    }
    for (std::size_t k = 0; k < rim.size(); ++k) {
      const InsertionCavity::Rim& r = rim[k];
      const std::uint32_t t = fresh[k];
      set(t, {r.a, r.b, v}, {r.beyond, open, open});
      ++triangles[t].generation;
      star_[r.a] = t;
      if (!r.is_outline())
        triangles[triangle_of(r.beyond)].beyond[index_of(r.beyond)] = edge_id(t, 0);
    }
    for (std::size_t k = 0; k < rim.size(); ++k) {
      const std::uint32_t next = star_[rim[k].b];  // the one that starts where this one ends
      if (next == kEnd) continue;
      triangles[fresh[k]].beyond[1] = edge_id(next, 2);
      triangles[next].beyond[2] = edge_id(fresh[k], 1);
    }
    return true;
  }

 private:
  void set(std::uint32_t t, const std::array<std::uint32_t, 3>& v,
           const std::array<std::uint32_t, 3>& beyond) {
    triangles[t].circle = {points[v[0]], points[v[1]], points[v[2]]};
    triangles[t].v = v;
    triangles[t].beyond = beyond;
  }

  std::uint32_t visits_ = 0;
  std::vector<std::uint32_t> star_;  // by vertex; scratch of fill_cavity
};

}  // namespace trocar::pipeline
