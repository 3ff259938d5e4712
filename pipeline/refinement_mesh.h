// SPDX-License-Identifier: GPL-3.0-or-later
// The mesh while it is refined: flat arrays, and insertion of a point by its cavity (Bowyer;
// Watson, 1981).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "formats/slice_mesh.h"
#include "pipeline/mesh_adjacency.h"

namespace trocar::pipeline {

/// Beyond a side on the outline lies, instead of a triangle, this flag and the input segment's
/// number.
inline constexpr std::uint32_t kOutline = 0x80000000;

struct WorkingTriangle {
  std::array<std::uint32_t, 3> v;       ///< counter-clockwise
  std::array<std::uint32_t, 3> beyond;  ///< side i is opposite v[i]
};

struct Side {
  std::uint32_t triangle, side;
};

/// Triangles that a point replaces, and their common border.
struct Cavity {
  struct Rim {
    std::uint32_t a, b;    ///< the cavity is on the left
    std::uint32_t beyond;  ///< triangle, or kOutline | segment
    Side from;             ///< inside
    bool is_outline() const { return (beyond & kOutline) != 0; }
  };
  std::vector<std::uint32_t> triangles;
  std::vector<Rim> rim;
};

/// A triangle's circumcircle for many questions: the determinant of in_circle(), expanded by the
/// point asked for. Exact; 64 bits do where all differences are below kReach, which nearly all are.
class Circle {
 public:
  Circle() = default;
  Circle(LatticePoint a, LatticePoint b, LatticePoint c) : origin_(a) {
    const std::int64_t bx = std::int64_t{b.x} - a.x, by = std::int64_t{b.y} - a.y;
    const std::int64_t cx = std::int64_t{c.x} - a.x, cy = std::int64_t{c.y} - a.y;
    if (!(is_in_reach(bx, by) && is_in_reach(cx, cy))) return;
    const std::int64_t b2 = bx * bx + by * by, c2 = cx * cx + cy * cy;
    x_ = b2 * cy - c2 * by;
    y_ = c2 * bx - b2 * cx;
    area2_ = bx * cy - by * cx;
  }

  enum class Answer { kNo, kYes, kTooFar };
  /// Does p lie strictly inside?
  Answer holds(LatticePoint p) const {
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

constexpr std::uint32_t next_side(std::uint32_t i) {
  return i == 2 ? 0 : i + 1;
}
constexpr std::uint32_t previous_side(std::uint32_t i) {
  return i == 0 ? 2 : i - 1;
}

class RefinementMesh {
 public:
  std::vector<LatticePoint> points;
  std::vector<WorkingTriangle> triangles;
  std::vector<std::uint32_t> stamps;  ///< by triangle; grows when it is replaced

  /// Starts anew and keeps the memory. Sides on the outline are numbered by `segment(a, b)`.
  template <typename Segment>
  void assign(const SliceMesh& mesh, Segment segment) {
    points.assign(mesh.vertices.begin(), mesh.vertices.end());
    triangles.clear();
    const Neighbours beyond = neighbours(mesh);
    for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
      triangles.push_back({mesh.triangles[t], beyond[t]});
      WorkingTriangle& tri = triangles.back();
      for (std::uint32_t i = 0; i < 3; ++i) {
        if (tri.beyond[i] == kNoTriangle)
          tri.beyond[i] = kOutline | segment(tri.v[next_side(i)], tri.v[previous_side(i)]);
      }
    }
    circles_.clear();
    for (const WorkingTriangle& t : triangles)
      circles_.push_back(circle(t));
    stamps.assign(triangles.size(), 0);
    visit_.assign(triangles.size(), 0);
    visits_ = 0;
    star_.assign(points.size(), kNoTriangle);
  }

  bool is_outline(Side s) const { return (triangles[s.triangle].beyond[s.side] & kOutline) != 0; }
  std::uint32_t segment(Side s) const { return triangles[s.triangle].beyond[s.side] ^ kOutline; }
  std::pair<std::uint32_t, std::uint32_t> ends(Side s) const {
    const WorkingTriangle& t = triangles[s.triangle];
    return {t.v[next_side(s.side)], t.v[previous_side(s.side)]};
  }
  std::uint32_t apex(Side s) const { return triangles[s.triangle].v[s.side]; }

  /// in_circle() of a triangle.
  bool circumcircle_holds(std::uint32_t t, LatticePoint p) const {
    const Circle::Answer answer = circles_[t].holds(p);
    if (answer != Circle::Answer::kTooFar) return answer == Circle::Answer::kYes;
    const std::array<std::uint32_t, 3>& v = triangles[t].v;
    return in_circle(points[v[0]], points[v[1]], points[v[2]], p) > 0;
  }

  /// All triangles whose circumcircles hold p and that p sees through `start`, which it is in or
  /// near.
  void find_cavity(std::uint32_t start, LatticePoint p, Cavity& cavity) {
    find_cavity(start, p, cavity, [](const Cavity::Rim&) { return true; });
  }

  /// The same, but stops and gives false where `is_welcome` of an edge of the rim does.
  template <typename IsWelcome>
  bool find_cavity(std::uint32_t start, LatticePoint p, Cavity& cavity, IsWelcome is_welcome) {
    cavity.triangles.assign(1, start);
    cavity.rim.clear();
    visit_[start] = ++visits_;
    for (std::size_t k = 0; k < cavity.triangles.size(); ++k) {
      const std::uint32_t t = cavity.triangles[k];
      const WorkingTriangle& tri = triangles[t];
      for (std::uint32_t i = 0; i < 3; ++i) {
        const std::uint32_t n = tri.beyond[i];
        if ((n & kOutline) == 0) {
          if (visit_[n] == visits_) continue;
          if (circumcircle_holds(n, p)) {
            visit_[n] = visits_;
            cavity.triangles.push_back(n);
            continue;
          }
        }
        cavity.rim.push_back({tri.v[next_side(i)], tri.v[previous_side(i)], n, {t, i}});
        if (!is_welcome(cavity.rim.back())) return false;
      }
    }
    return true;
  }

  /// Replaces the cavity by the star of a new vertex p, and gives its triangles. The rim is a
  /// closed loop, or, where p splits a side on the outline, open at that side (`split`: its
  /// `beyond`; else 0). Changes nothing and gives false if a triangle of the star would not be
  /// positive.
  bool fill_cavity(const Cavity& cavity, LatticePoint p, std::uint32_t split,
                   std::vector<std::uint32_t>& fresh) {
    const std::vector<Cavity::Rim>& rim = cavity.rim;
    for (const Cavity::Rim& r : rim) {
      if (orient2d(points[r.a], points[r.b], p) <= 0) return false;
    }
    // A loop around n triangles has n + 2 edges, an open one n + 1.
    if (rim.size() != cavity.triangles.size() + (split == 0 ? 2 : 1)) return false;
    const auto v = static_cast<std::uint32_t>(points.size());
    points.push_back(p);
    star_.push_back(kNoTriangle);
    fresh.assign(cavity.triangles.begin(), cavity.triangles.end());
    while (fresh.size() < rim.size()) {
      fresh.push_back(static_cast<std::uint32_t>(triangles.size()));
      triangles.emplace_back();
      circles_.emplace_back();
      stamps.push_back(0);
      visit_.push_back(0);
    }
    // The rim speaks of triangles about to be overwritten: look from outside in first.
    for (std::size_t k = 0; k < rim.size(); ++k) {
      star_[rim[k].b] = kNoTriangle;
      if (rim[k].is_outline()) continue;
      WorkingTriangle& out = triangles[rim[k].beyond];
      for (std::uint32_t i = 0; i < 3; ++i) {
        if (out.v[next_side(i)] == rim[k].b && out.v[previous_side(i)] == rim[k].a)
          out.beyond[i] = fresh[k];
      }
    }
    const std::uint32_t open = split == 0 ? kNoTriangle : split;
    for (std::size_t k = 0; k < rim.size(); ++k) {
      triangles[fresh[k]] = {{v, rim[k].a, rim[k].b}, {rim[k].beyond, open, open}};
      circles_[fresh[k]] = circle(triangles[fresh[k]]);
      ++stamps[fresh[k]];
      star_[rim[k].a] = fresh[k];
    }
    for (std::size_t k = 0; k < rim.size(); ++k) {
      const std::uint32_t next = star_[rim[k].b];  // the one that starts where this one ends
      if (next == kNoTriangle) continue;
      triangles[fresh[k]].beyond[1] = next;
      triangles[next].beyond[2] = fresh[k];
    }
    return true;
  }

 private:
  Circle circle(const WorkingTriangle& t) const {
    return {points[t.v[0]], points[t.v[1]], points[t.v[2]]};
  }

  std::vector<Circle> circles_;       // by triangle
  std::vector<std::uint32_t> visit_;  // by triangle: the last search that took it
  std::uint32_t visits_ = 0;
  std::vector<std::uint32_t> star_;  // by vertex; scratch of fill_cavity
};

}  // namespace trocar::pipeline
