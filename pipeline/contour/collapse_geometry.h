// SPDX-License-Identifier: GPL-3.0-or-later
// The geometry of one step of segment collapse (area_collapse.h). A step replaces the inner
// vertices of a path of the outline by one point that keeps the area. This header computes the
// point, rounds it to the lattice, and finds its position on the contour. It also defines the frame
// in which the steps are made.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "formats/mesh/canonical_rotation.h"
#include "formats/mesh/lattice.h"
#include "formats/mesh/predicates.h"
#include "formats/mesh/segment_grid.h"

namespace trocar::pipeline::collapse {

// The CentroidOffset of all vertices of an outline.
inline CentroidOffset centroid_offset(const Pslg& outline) {
  CentroidOffset out;
  for (const Ring& ring : outline.rings) {
    for (const LatticePoint p : ring)
      out.add(p);
  }
  return out;
}

// The frame of an outline: its canonical orientation, with the lower left corner of its box at the
// origin.
class CanonicalFrame {
 public:
  // Precondition: the outline has a vertex.
  explicit CanonicalFrame(const Pslg& outline) {
    const CentroidOffset offset = centroid_offset(outline);
    rotate_ = CanonicalRotation::of(offset.x(), offset.y());
    box_ = box_around(rotate_(offset.box().low), rotate_(offset.box().high));
  }

  // The outline's box after the rotation alone. Its lower left corner becomes the origin.
  const LatticeBox& box() const { return box_; }

  // Moves rings into the frame.
  void enter(std::vector<Ring>& rings) const {
    for (Ring& ring : rings) {
      for (LatticePoint& p : ring) {
        const LatticePoint r = rotate_(p);
        p = {r.x - box_.low.x, r.y - box_.low.y};
      }
    }
  }
  // The inverse of enter().
  void leave(std::vector<Ring>& rings) const {
    for (Ring& ring : rings) {
      for (LatticePoint& p : ring)
        p = rotate_.back(LatticePoint{p.x + box_.low.x, p.y + box_.low.y});
    }
  }

 private:
  CanonicalRotation rotate_;
  LatticeBox box_;
};

// Special values of a displacement (see Ideal): kNever if the collapse is not possible, kUnknown if
// the displacement has not been computed yet.
inline constexpr double kNever = std::numeric_limits<double>::infinity(), kUnknown = -1;

// Largest number of edges that one step replaces by two new edges.
inline constexpr std::size_t kMaxRun = 8;

// The edge bc of the outline with the vertex a before it and the vertex d after it. ia to id are
// the vertices' node numbers.
struct Span {
  std::uint32_t ia, ib, ic, id;
  LatticePoint a, b, c, d;
  std::int64_t abc = orient2d(a, b, c), acd = orient2d(a, c, d), bcd = orient2d(b, c, d);

  // Twice the area between the path a, b, c, d and the line from d to a.
  std::int64_t doubled() const { return abc + acd; }
};

// A point that keeps the area if it replaces the edge bc. `displacement` is the area, in squared
// lattice steps, that would pass from one side of the outline to the other; both directions are
// added. It is kNever if no point keeps the area.
struct Ideal {
  Point at;
  double displacement = kNever;
};

// The ideal point on the ray from `end` through `near`. There are two such rays:
//  - from a through b: end = a, near = b, far = c, other = d;
//  - from d through c: end = d, near = c, far = b, other = a.
// `area` is twice the signed area that the triangle a, ideal point, d must have. `cross` is twice
// the signed area of the triangle a, near, d.
inline Ideal ideal_on_ray(LatticePoint end, LatticePoint near, LatticePoint far, LatticePoint other,
                          double area, std::int64_t cross) {
  if (cross == 0) return {};
  const double t = area / static_cast<double>(cross);
  if (!(t > 0)) return {};
  const Point from = point(end), n = point(near);
  const Point e{from.x + t * (n.x - from.x), from.y + t * (n.y - from.y)};
  // The new edge from e to `other` crosses the edge near-far at x = near + u (far - near). The
  // triangles (e, near, x) and (x, far, other) pass to the other side of the outline, in opposite
  // directions. Their areas are equal.
  const Point f = point(far), o = point(other);
  const double at_near = (o.x - e.x) * (n.y - e.y) - (o.y - e.y) * (n.x - e.x),
               at_far = (o.x - e.x) * (f.y - e.y) - (o.y - e.y) * (f.x - e.x);
  const double u = at_near == at_far ? 0 : std::clamp(at_near / (at_near - at_far), 0.0, 1.0);
  return {e, std::abs(u * ((n.x - e.x) * (f.y - n.y) - (n.y - e.y) * (f.x - n.x)))};
}

// The ideal points on the two rays, the one with the smaller displacement first. `area` is as in
// ideal_on_ray().
inline std::array<Ideal, 2> ideals(const Span& s, double area) {
  if (s.abc == 0 && is_inside_segment(s.a, s.c, s.b)) return {Ideal{point(s.c), 0}, Ideal{}};
  if (s.bcd == 0 && is_inside_segment(s.b, s.d, s.c)) return {Ideal{point(s.b), 0}, Ideal{}};
  const Ideal on_ab = ideal_on_ray(s.a, s.b, s.c, s.d, area, s.abc + s.acd - s.bcd),
              on_dc = ideal_on_ray(s.d, s.c, s.b, s.a, area, s.acd);
  if (on_dc.displacement < on_ab.displacement) return {on_dc, on_ab};
  return {on_ab, on_dc};
}

// A path along a ring. The step replaces the path's inner nodes by the point e. `points` has the
// points of the path, followed by e.
struct Path {
  std::array<std::uint32_t, kMaxRun + 1> nodes;
  std::array<LatticePoint, kMaxRun + 2> points;
  std::size_t size;  // number of points of the path, without e

  LatticePoint a() const { return points[0]; }
  LatticePoint d() const { return points[size - 1]; }
  LatticePoint e() const { return points[size]; }
};

// The point that replaces the inner nodes of a path of more than three edges. It lies on a line
// that is perpendicular to a-d and passes through the vertex of the path farthest from a-d. The
// point's distance from a-d is chosen so that the step keeps the area of the ring and makes up for
// the error of earlier steps: `area_error` is twice the area that the ring lacks. The correction is
// at most the area of a triangle with the base a-d and a height of one lattice step. `base2` is the
// squared length of a-d.
struct RunIdeal {
  Point at;
  double area;           // twice the area between the path a, `at`, d and the line a-d
  std::int64_t doubled;  // twice the area between the present path and the line a-d
};
inline RunIdeal ideal_for_run(const Path& path, std::int64_t base2, std::int64_t area_error) {
  const LatticePoint a = path.a(), d = path.d();
  const std::size_t edges = path.size - 1;
  std::int64_t doubled = 0, farthest = 0;
  LatticePoint apex = path.points[edges / 2];
  for (std::size_t k = 1; k < edges; ++k) {
    doubled += orient2d(a, path.points[k], path.points[k + 1]);
    const std::int64_t off = std::abs(orient2d(a, path.points[k], d));
    if (off > farthest) farthest = off, apex = path.points[k];
  }
  const double base = std::sqrt(static_cast<double>(base2)),
               area = static_cast<double>(doubled) +
                      std::clamp(static_cast<double>(area_error), -base, base);
  const double offset =
      (static_cast<double>(orient2d(a, apex, d)) - area) / static_cast<double>(base2);
  return {{apex.x - offset * (d.y - a.y), apex.y + offset * (d.x - a.x)}, area, doubled};
}

// The winding number around p of the closed polygon through the path and e. Precondition: p lies on
// none of its edges.
inline int winding(const Path& path, LatticePoint p) {
  int out = 0;
  for (std::size_t i = 0; i <= path.size; ++i) {
    const LatticePoint from = path.points[i], to = path.points[i < path.size ? i + 1 : 0];
    if ((from.y <= p.y) == (to.y <= p.y)) continue;
    const std::int64_t side = orient2d(from, to, p);
    if (from.y <= p.y && side > 0) ++out;
    if (from.y > p.y && side < 0) --out;
  }
  return out;
}

// The same result as segments_cross(), but quick if cd lies to one side of ab, which is nearly
// always the case.
inline bool crosses(LatticePoint a, LatticePoint b, LatticePoint c, LatticePoint d) {
  const std::int64_t to_c = orient2d(a, b, c), to_d = orient2d(a, b, d);
  if ((to_c > 0 && to_d > 0) || (to_c < 0 && to_d < 0)) return false;
  return segments_cross(a, b, c, d);
}

// Returns true if the edge pq of the outline prevents the step: if pq crosses one of the new edges
// a-e and e-d, or if p lies between the path and the new edges. (The caller also passes the edge
// that starts at q, which tests q.) Precondition: pq is not an edge of the path, and `box` encloses
// the path and e. If `is_end` is true, p is the last point of an open contour, and q equals p.
inline bool meets(const Path& path, const LatticeBox& box, LatticePoint p, LatticePoint q,
                  bool is_end) {
  const LatticePoint a = path.a(), d = path.d(), e = path.e();
  const bool at_end = p == a || p == d;
  if (at_end && is_end) return false;
  // If an edge joins a and d, it belongs to another ring, which touches this one. The new edges
  // have the same ends, so they could pass to the other side of that edge without crossing it.
  if (at_end && (q == a || q == d)) return true;
  if (!at_end && !apart({p, p}, box)) {
    for (std::size_t k = 1; k <= path.size; ++k)
      if (p == path.points[k]) return true;
    if (winding(path, p) != 0) return true;
  }
  return crosses(a, e, p, q) || crosses(e, d, p, q);
}

// The lattice point nearest to p; no value if p is far outside the lattice.
inline std::optional<LatticePoint> nearest(Point p) {
  constexpr double kFar = 1 << 30;
  if (!(std::abs(p.x) < kFar && std::abs(p.y) < kFar)) return std::nullopt;
  return LatticePoint{static_cast<std::int32_t>(std::lrint(p.x)),
                      static_cast<std::int32_t>(std::lrint(p.y))};
}

// Chooses among `near` and the eight lattice points around it, except a and d. Returns the point e
// for which twice the signed area of the triangle a, e, d is nearest to `area`. If several are
// equally good, returns the one nearest to `ideal`.
inline LatticePoint rounded(LatticePoint a, LatticePoint d, LatticePoint near, Point ideal,
                            double area) {
  const std::int64_t per_x = std::int64_t{d.y} - a.y, per_y = std::int64_t{a.x} - d.x,
                     middle = orient2d(a, near, d);
  LatticePoint best = near;
  double least_off = std::numeric_limits<double>::infinity(), least2 = 0;
  for (std::int32_t dx = -1; dx <= 1; ++dx) {
    for (std::int32_t dy = -1; dy <= 1; ++dy) {
      const LatticePoint e{near.x + dx, near.y + dy};
      if (e == a || e == d) continue;
      const double off = std::abs(static_cast<double>(middle + dx * per_x + dy * per_y) - area);
      if (off > least_off) continue;
      const double x = e.x - ideal.x, y = e.y - ideal.y, away2 = x * x + y * y;
      if (off < least_off || away2 < least2) best = e, least_off = off, least2 = away2;
    }
  }
  return best;
}

// A position on a contour: on the edge from vertex k to the next, at the fraction t (0 <= t < 1).
struct ContourPosition {
  std::uint32_t k = 0;
  double t = 0;
};

// A vertex of the outline, linked to its neighbours. At first, node i is vertex i of the contours;
// the vertices are numbered ring by ring.
struct Node {
  LatticePoint p;
  std::uint32_t previous, next;
};
// The data of a node that are needed less often. They are not part of Node, so that more nodes fit
// into the processor's cache.
struct NodeState {
  // `ring` is the index of the ring and of its contour. k and t are a position on this contour,
  // within the tolerance of Node::p.
  std::uint32_t ring, k;
  double t = 0;
  double displacement = kUnknown;  // displacement if the edge to the next node collapses
  // The displacement of the node's valid entry in the queue of collapses; kNever if the node has no
  // valid entry. Entries of the node with another displacement are out of date and are ignored.
  double queued = kNever;
  ContourPosition position() const { return {k, t}; }
  void put(ContourPosition position) { k = position.k, t = position.t; }
};

// The part of a closed contour from one position to another. `contour` has n vertices, followed by
// a copy of the first one.
struct ContourPart {
  const LatticePoint* contour;
  std::uint32_t n;
  ContourPosition from, to;
};

// The number of edges from vertex `from` to vertex k along a closed contour with n vertices.
inline std::uint32_t along(std::uint32_t from, std::uint32_t k, std::uint32_t n) {
  return k >= from ? k - from : k + n - from;
}

// Returns the position nearest to e on `part`, the part of a contour that the edges a-e and e-d are
// to replace. The position divides the part into two pieces. The first piece and the edge a-e must
// be within the tolerance of each other, and so must the second piece and the edge e-d. Otherwise
// the function returns no value. `tolerance2` is the squared tolerance.
//
// The function checks only that e is near its position, and that each vertex of the contour is near
// the edge that replaces it. It need not check that each point of the edge is near the contour,
// because this follows. While a point runs along a piece of the contour, the nearest point on the
// edge runs along the edge and leaves out at most a stretch at either end. Such a stretch is near
// the contour too, because the end of the edge is near its own position on the contour.
inline std::optional<ContourPosition> position_within(const ContourPart& part, LatticePoint a,
                                                      LatticePoint d, LatticePoint e,
                                                      double tolerance2) {
  const LatticePoint* const contour = part.contour;
  const std::uint32_t n = part.n;
  const ContourPosition from = part.from, to = part.to;
  std::uint32_t inner = to.k >= from.k ? to.k - from.k : to.k + n - from.k;
  if (inner == 0 && to.t < from.t) inner = n;  // the whole contour
  const Point at = point(e);
  // Segment j of the part (j = 0 .. inner) runs from a vertex to the next one. The first segment
  // begins at `from`, and the last one ends at `to`.
  ContourPosition nearest;
  double least = std::numeric_limits<double>::max();
  std::uint32_t nearest_segment = 0;
  for (std::uint32_t j = 0, k = from.k; j <= inner; ++j) {
    const Point p = point(contour[k]), q = point(contour[k + 1]);
    const double low = j == 0 ? from.t : 0, high = j == inner ? to.t : 1;
    const double t = std::clamp(fraction_along(p, q, at), low, high);
    const double d2 = distance2_between({p.x + t * (q.x - p.x), p.y + t * (q.y - p.y)}, at);
    if (d2 < least) least = d2, nearest = {k, t}, nearest_segment = j;
    k = k + 1 < n ? k + 1 : 0;
  }
  if (least > tolerance2) return std::nullopt;
  const auto are_near = [&](Point end, std::uint32_t first, std::uint32_t last) {
    std::uint32_t k = from.k + first < n ? from.k + first : from.k + first - n;
    for (std::uint32_t j = first; j <= last; ++j) {
      if (segment_distance2(end, at, point(contour[k])) > tolerance2) return false;
      k = k + 1 < n ? k + 1 : 0;
    }
    return true;
  };
  if (!are_near(point(a), 1, nearest_segment) || !are_near(point(d), nearest_segment + 1, inner))
    return std::nullopt;
  if (nearest.t >= 1) nearest = {nearest.k + 1 < n ? nearest.k + 1 : 0, 0};
  return nearest;
}

}  // namespace trocar::pipeline::collapse
