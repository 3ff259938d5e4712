// SPDX-License-Identifier: GPL-3.0-or-later
// The mesh during refinement: flat arrays, and insertion of a point by its cavity (Bowyer; Watson,
// 1981).
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <tuple>
#include <utility>
#include <vector>

#include "formats/geometry/triangle_edge.h"
#include "pipeline/mesh/rim_view.h"
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
  Circumcircle(LatticePoint a, LatticePoint b, LatticePoint c) {
    const std::int64_t bx = std::int64_t{b.x} - a.x, by = std::int64_t{b.y} - a.y;
    const std::int64_t cx = std::int64_t{c.x} - a.x, cy = std::int64_t{c.y} - a.y;
    if (!(is_in_reach(bx, by) && is_in_reach(cx, cy))) return;
    origin_ = a;
    const std::int64_t b2 = bx * bx + by * by, c2 = cx * cx + cy * cy;
    x_ = b2 * cy - c2 * by;
    y_ = c2 * bx - b2 * cx;
    area2_ = bx * cy - by * cx;
  }

  /// Do 64 bits suffice for contains(p)?
  bool is_near(LatticePoint p) const {
    return is_in_reach(std::int64_t{p.x} - origin_.x, std::int64_t{p.y} - origin_.y);
  }
  /// Does p, for which is_near(), lie strictly inside? 1 or 0 (else either), without a comparison
  /// that a compiler might turn into a branch.
  std::uint32_t contains(LatticePoint p) const {
    const auto dx = static_cast<std::uint64_t>(std::int64_t{p.x} - origin_.x),
               dy = static_cast<std::uint64_t>(std::int64_t{p.y} - origin_.y);
    const std::uint64_t outside =
        (dx * dx + dy * dy) * static_cast<std::uint64_t>(area2_) -
        (dx * static_cast<std::uint64_t>(x_) + dy * static_cast<std::uint64_t>(y_));
    return static_cast<std::uint32_t>(outside >> 63);
  }

 private:
  // With differences below M: |x|, |y| < 4 M^3, area2 < 2 M^2, so all sums stay below 12 M^4 <
  // 2^63.
  static constexpr std::int64_t kReach = 1 << 14;
  static bool is_in_reach(std::int64_t x, std::int64_t y) {
    return (static_cast<std::uint64_t>(x + kReach) | static_cast<std::uint64_t>(y + kReach)) <
           2 * kReach;
  }

  std::int64_t x_ = 0, y_ = 0, area2_ = 0;
  // Beyond the lattice, so that no point is near, where a triangle is too large.
  LatticePoint origin_{std::numeric_limits<std::int32_t>::max(),
                       std::numeric_limits<std::int32_t>::max()};
};

/// One cache line.
struct alignas(64) WorkingTriangle {
  Circumcircle circle;
  std::array<std::uint32_t, 3> v{};       ///< counter-clockwise
  std::array<std::uint32_t, 3> beyond{};  ///< EdgeId, or kOutline | segment
  std::uint32_t visit = 0;                ///< the last search that saw it
  std::uint32_t generation : 31 = 0;      ///< grows when it is replaced
  std::uint32_t is_bad : 1 = 0;           ///< to be improved
};

/// The triangles that the star of a new point replaces, and the rim around them.
class InsertionCavity {
 public:
  struct Rim {
    std::uint32_t a, b;    ///< the cavity is on the left
    std::uint32_t beyond;  ///< EdgeId, or kOutline | segment
    EdgeId inside;         ///< of the cavity's triangle
    bool is_outline() const { return (beyond & kOutline) != 0; }
  };

  std::span<const Rim> rim() const { return {rim_.data(), edges_}; }
  /// The same edges from `origin`, in pairs.
  std::span<const RimPair> pairs() const { return {pairs_.data(), (edges_ + 1) / 2}; }
  std::span<RimPair> pairs() { return {pairs_.data(), (edges_ + 1) / 2}; }
  std::uint32_t size() const { return triangles_; }
  std::uint32_t triangle(std::uint32_t k) const { return triangle_of(entries_[k]); }
  int bad_triangles() const { return bad_; }

  LatticePoint origin;

 private:
  friend class RefinementMesh;

  std::size_t room() const { return rim_.size(); }
  [[gnu::noinline]] void make_room() {
    const std::size_t room = 2 * rim_.size() + 64;
    entries_.resize(room), sides_.resize(room), rim_.resize(room), pairs_.resize(room / 2);
  }

  std::uint32_t triangles_ = 0, edges_ = 0;
  int bad_ = 0;
  std::vector<EdgeId> entries_;       // by triangle: the edge by which it was reached
  std::vector<std::uint64_t> sides_;  // of the rim: what is beyond, and the inside edge
  std::vector<Rim> rim_;
  std::vector<RimPair> pairs_;
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
    const WorkingTriangle& tri = triangles[t];
    return tri.circle.is_near(p) ? tri.circle.contains(p) != 0 : far_circle_contains(tri, p);
  }

  static constexpr std::uint32_t kNone = 0xffffffff;
  /// The triangle that contains p, looked for along a way from `start`; kNone if the outline is in
  /// the way.
  std::uint32_t find(std::uint32_t start, LatticePoint p) const {
    std::uint32_t t = start;
    for (int step = 0; step < 64; ++step) {
      const WorkingTriangle& tri = triangles[t];
      std::uint32_t i = 0;
      while (i < 3 && orient2d(points[tri.v[i]], points[tri.v[next_corner(i)]], p) >= 0)
        ++i;
      if (i == 3) return t;
      if ((tri.beyond[i] & kOutline) != 0) return kNone;
      t = triangle_of(tri.beyond[i]);
    }
    return kNone;
  }

  /// `start`, and all triangles connected with it whose circumcircles contain p; and the edges
  /// around them, without `except`. p lies in `start` or in its circumcircle. Whether a neighbour
  /// belongs to it cannot be predicted, so nothing here branches on that.
  [[gnu::noinline]] void find_cavity(std::uint32_t start, LatticePoint p, EdgeId except,
                                     InsertionCavity& cavity) {
    // What is found is written before it is known whether it counts, so there is always room for
    // the edges of one triangle more.
    constexpr std::size_t kMargin = 3;
    if (cavity.room() < kMargin + 1) cavity.make_room();
    const std::uint32_t visit = ++visits_;
    WorkingTriangle* const all = triangles.data();
    EdgeId* entries = cavity.entries_.data();
    std::uint64_t* sides = cavity.sides_.data();
    std::size_t reached = 1, edges = 0;
    const auto look_beyond = [&](std::uint32_t t, std::uint32_t i) {
      const std::uint32_t beyond = all[t].beyond[i];
      const std::uint32_t is_outline = beyond >> 31, outline_mask = -is_outline;
      WorkingTriangle& next = all[(t & outline_mask) | (triangle_of(beyond) & ~outline_mask)];
      std::uint32_t is_in = next.circle.contains(p);
      if (!next.circle.is_near(p)) [[unlikely]]
        is_in = far_circle_contains(next, p) ? 1 : 0;
      is_in &= ~is_outline;
      const std::uint32_t is_new = is_in & static_cast<std::uint32_t>(next.visit != visit);
      entries[reached] = beyond;
      sides[edges] = std::uint64_t{beyond} << 32 | edge_id(t, i);
      reached += is_new;
      edges += is_in ^ 1;
      next.visit = visit;  // also where it is not in the cavity: that is found again
    };
    all[start].visit = visit;
    entries[0] = edge_id(start, 0);
    int bad = all[start].is_bad;
    for (std::uint32_t i = 0; i < 3; ++i) {
      if (edge_id(start, i) != except) look_beyond(start, i);
    }
    for (std::size_t k = 1; k < reached; ++k) {
      if (std::max(reached, edges) + kMargin > cavity.room()) [[unlikely]] {
        cavity.make_room();
        entries = cavity.entries_.data();
        sides = cavity.sides_.data();
      }
      const std::uint32_t t = triangle_of(entries[k]), from = index_of(entries[k]);
      bad += all[t].is_bad;
      look_beyond(t, (from - 1) >> 31);  // 1 if from is 0, else 0
      look_beyond(t, 2 - (from >> 1));   // 1 if from is 2, else 2
    }
    cavity.triangles_ = static_cast<std::uint32_t>(reached);
    cavity.edges_ = static_cast<std::uint32_t>(edges);
    cavity.bad_ = bad;
    cavity.origin = p;
    if (edges == 0) return;
    if (except == kNoEdge) {
      list_rim<false>(except, cavity);
    } else {
      list_rim<true>(except, cavity);
    }
  }

  /// Replaces the cavity by the star of a new vertex p that lies to the left of all edges of the
  /// rim. The rim is a closed loop, or, where p splits an edge on the outline, open at that edge
  /// (`split`, else kNoEdge). Edge k of the rim becomes edge 0 of triangle fresh[k]. False, and
  /// nothing done, if the rim is not one loop.
  bool fill_cavity(const InsertionCavity& cavity, LatticePoint p, EdgeId split,
                   std::vector<std::uint32_t>& fresh) {
    const std::span<const InsertionCavity::Rim> rim = cavity.rim();
    // A loop around n triangles has n + 2 edges, an open one n + 1.
    if (rim.size() != cavity.size() + (split == kNoEdge ? 2 : 1)) return false;
    constexpr std::uint32_t kEnd = 0xffffffff;
    std::uint32_t open = 0;
    if (split != kNoEdge) {
      open = beyond(split);
      star_[ends(split).first] = kEnd;
    }
    const auto v = static_cast<std::uint32_t>(points.size());
    points.push_back(p);
    star_.push_back(0);
    const std::size_t n = rim.size(), kept = cavity.size();
    fresh.resize(n);
    const auto made = static_cast<std::uint32_t>(triangles.size());
    if (n > kept) triangles.resize(made + (n - kept));
    for (std::uint32_t k = 0; k < std::min(n, kept); ++k)
      fresh[k] = cavity.triangle(k);
    for (std::size_t k = kept; k < n; ++k)
      fresh[k] = made + static_cast<std::uint32_t>(k - kept);
    const std::uint32_t* const numbers = fresh.data();
    const LatticePoint* const at = points.data();
    WorkingTriangle* const all = triangles.data();
    std::uint32_t* const star = star_.data();
    // No edge of the rim on the outline has a neighbour to be told: a place of no meaning is told.
    std::uint32_t nowhere = 0;
    for (std::size_t k = 0; k < n; ++k) {
      const InsertionCavity::Rim& r = rim[k];
      const std::uint32_t t = numbers[k];
      WorkingTriangle& tri = all[t];
      tri.circle = {at[r.a], at[r.b], p};
      tri.v = {r.a, r.b, v};
      tri.beyond = {r.beyond, open, open};
      ++tri.generation;
      star[r.a] = t;
      std::uint32_t* const told =
          r.is_outline() ? &nowhere : &all[triangle_of(r.beyond)].beyond[index_of(r.beyond)];
      *told = edge_id(t, 0);
    }
    for (std::size_t k = 0; k < n; ++k) {
      const std::uint32_t next = star[rim[k].b];  // the one that starts where this one ends
      if (next == kEnd) continue;
      all[numbers[k]].beyond[1] = edge_id(next, 2);
      all[next].beyond[2] = edge_id(numbers[k], 1);
    }
    return true;
  }

 private:
  // From the sides that were found. `split`: the edge of the outline that is to be split, or
  // kNoEdge.
  template <bool kIsSplit>
  [[gnu::always_inline]] void list_rim(EdgeId split, InsertionCavity& cavity) const {
    const std::uint32_t n = cavity.edges_;
    std::uint32_t from = 0, to = 0;
    if (kIsSplit) std::tie(from, to) = ends(split);
    const LatticePoint* const at = points.data();
    const WorkingTriangle* const all = triangles.data();
    const LatticePoint o = cavity.origin;
    std::uint64_t* const sides = cavity.sides_.data();
    InsertionCavity::Rim* rim = cavity.rim_.data();
    RimPair* pair = cavity.pairs_.data();
    sides[n] = sides[n - 1];
    for (std::uint32_t k = 0; k < n; k += 2, rim += 2, ++pair) {
      for (std::uint32_t i = 0; i < 2; ++i) {
        const std::uint64_t side = sides[k + i];
        const std::uint32_t corner = index_of(static_cast<EdgeId>(side));
        const WorkingTriangle& tri = all[triangle_of(static_cast<EdgeId>(side))];
        rim[i].a = tri.v[corner];
        rim[i].b = tri.v[next_corner(corner)];
        rim[i].beyond = static_cast<std::uint32_t>(side >> 32);
        rim[i].inside = static_cast<EdgeId>(side);
      }
      set_pair(at[rim[0].a], at[rim[1].a], o, pair->ax, pair->ay);
      set_pair(at[rim[0].b], at[rim[1].b], o, pair->bx, pair->by);
      pair->is_edge = PairMask{-1, -1};
      pair->is_outline = PairMask{static_cast<std::int64_t>(sides[k]),
                                  static_cast<std::int64_t>(sides[k + 1])} < 0;
      if (kIsSplit) {
        pair->is_before =
            PairMask{-std::int64_t{rim[0].b == from}, -std::int64_t{rim[1].b == from}};
        pair->is_after = PairMask{-std::int64_t{rim[0].a == to}, -std::int64_t{rim[1].a == to}};
      }
    }
    if ((n & 1) != 0) {
      --pair;
      const PairMask first{-1, 0};
      pair->is_edge = first;
      pair->is_outline &= first;
      if (kIsSplit) pair->is_before &= first, pair->is_after &= first;
    }
  }

  [[gnu::noinline]] bool far_circle_contains(const WorkingTriangle& t, LatticePoint p) const {
    return in_circle(points[t.v[0]], points[t.v[1]], points[t.v[2]], p) > 0;
  }

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
