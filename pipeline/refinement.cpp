// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/refinement.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "pipeline/mesh_adjacency.h"

namespace trocar::pipeline {
namespace {

constexpr std::uint32_t kNone = kNoTriangle;
constexpr double kSmallInputAngle_deg = 60;
// Corners below this pull splits of their segments onto concentric shells.
constexpr double kAcute_deg = 75;
// Distances from a corner that differ by no more than this many steps are one shell.
constexpr double kSameShell = 2;
// An edge is not split into halves of fewer lattice steps than this, nor a triangle with a shorter
// edge improved: rounding to the lattice would decide the angles.
constexpr std::int64_t kShortestEdge = 4;

// A triangle of the working mesh. Side i is opposite v[i]; its neighbour, or kNone at the
// boundary, where `segment` says which input segment it belongs to.
struct Tri {
  std::array<std::uint32_t, 3> v;
  std::array<std::uint32_t, 3> neighbour{kNone, kNone, kNone};
  std::array<std::int32_t, 3> segment{-1, -1, -1};
};

struct Side {
  std::uint32_t triangle, side;
};

// A reference that goes stale when its triangle is replaced.
struct Ticket {
  std::uint32_t triangle, stamp;
  std::uint32_t side = 0;
};

class Refiner {
 public:
  Refiner(const SliceMesh& mesh, const Lattice& lattice, const RefinementOptions& options)
      : points_(mesh.vertices), min_angle_deg_(options.min_angle_deg) {
    const double angle = options.min_angle_deg * std::numbers::pi / 180;
    cos2_ = std::cos(angle) * std::cos(angle);
    // Uengoer's off-centre sees the shortest edge under slightly more than the wanted angle.
    off_centre_ = 0.475 * std::sqrt((1 + std::cos(angle)) / (1 - std::cos(angle)));
    const double step2 = lattice.step_mm() * lattice.step_mm();
    max_doubled_area_ = 2 * options.max_area_mm2 / step2;
    build(mesh);
    max_vertices_ = options.max_vertices != 0
                        ? options.max_vertices
                        : static_cast<std::uint32_t>(std::min(
                              4e9, 10'000 + 200.0 * static_cast<double>(points_.size()) +
                                       20.0 * static_cast<double>(doubled_area(mesh)) / std::max(max_doubled_area_, 1.0)));
  }

  Refined run() {
    for (std::uint32_t t = 0; t < triangles_.size(); ++t) look_at(t);
    while (true) {
      split_encroached();
      const std::optional<Ticket> bad = next_bad();
      if (!bad) break;
      if (points_.size() >= max_vertices_) {
        out_.out_of_vertices = true;
        break;
      }
      improve(bad->triangle);
    }
    return finish();
  }

 private:
  // ---- set-up ----

  void build(const SliceMesh& mesh) {
    triangles_.reserve(mesh.triangles.size() * 4);
    for (const Triangle& t : mesh.triangles) triangles_.push_back({t});
    stamps_.assign(triangles_.size(), 0);
    const Neighbours beyond = neighbours(mesh);
    std::vector<std::int32_t> segment_into(points_.size(), -1);
    for (std::uint32_t t = 0; t < triangles_.size(); ++t) {
      triangles_[t].neighbour = beyond[t];
      for (std::uint32_t i = 0; i < 3; ++i) {
        if (beyond[t][i] != kNone) continue;
        const auto [a, b] = ends({t, i});
        const auto s = static_cast<std::int32_t>(out_.segments.size());
        triangles_[t].segment[i] = s;
        out_.segments.push_back({a, b, -1, 0});
        segment_into[b] = s;
      }
    }
    for (Refined::Segment& s : out_.segments) {
      s.previous = segment_into[s.from];
      const LatticePoint v = points_[s.from];
      const LatticePoint p = points_[out_.segments[static_cast<std::size_t>(s.previous)].from], n = points_[s.to];
      const double cross = static_cast<double>(orient2d(v, n, p));
      const double dot = static_cast<double>(diametral_dot(n, p, v));
      s.angle_at_from_deg = std::atan2(cross, dot) * 180 / std::numbers::pi;
      if (s.angle_at_from_deg <= 0) s.angle_at_from_deg += 360;
    }
    out_.origins.assign(points_.size(), {VertexOrigin::kCorner});
    corner_angle_deg_.assign(points_.size(), 360);
    for (const Refined::Segment& s : out_.segments) corner_angle_deg_[s.from] = s.angle_at_from_deg;
    star_.assign(points_.size(), kNone);
  }

  std::pair<std::uint32_t, std::uint32_t> ends(Side s) const {
    const Tri& t = triangles_[s.triangle];
    return {t.v[(s.side + 1) % 3], t.v[(s.side + 2) % 3]};
  }
  LatticePoint at(std::uint32_t v) const { return points_[v]; }

  // ---- what is wrong with a triangle ----

  double distance(std::uint32_t a, std::uint32_t b) const {
    return std::sqrt(static_cast<double>(distance2(at(a), at(b))));
  }

  bool is_encroached(Side s) const {
    const auto [a, b] = ends(s);
    const std::uint32_t apex = triangles_[s.triangle].v[s.side];
    if (diametral_dot(at(a), at(b), at(apex)) >= 0) return false;
    // Across a small input angle, the vertex on the same shell encroaches by rounding alone.
    const std::uint32_t corner = common_small_corner(triangles_[s.triangle].segment[s.side], out_.origins[apex].segment);
    if (corner == kNone) return true;
    const double d = distance(apex, corner);
    return std::abs(d - distance(a, corner)) > kSameShell && std::abs(d - distance(b, corner)) > kSameShell;
  }

  // The corner where two input segments meet under a small angle in the material, or kNone.
  std::uint32_t common_small_corner(std::int32_t s, std::int32_t t) const {
    if (s < 0 || t < 0 || s == t) return kNone;
    const auto& from_s = out_.segments[static_cast<std::size_t>(s)];
    const auto& from_t = out_.segments[static_cast<std::size_t>(t)];
    if (from_s.previous == t && from_s.angle_at_from_deg < kSmallInputAngle_deg) return from_s.from;
    if (from_t.previous == s && from_t.angle_at_from_deg < kSmallInputAngle_deg) return from_t.from;
    return kNone;
  }

  // Queues what is wrong with a new triangle.
  void look_at(std::uint32_t t) {
    const Tri& tri = triangles_[t];
    for (std::uint32_t i = 0; i < 3; ++i) {
      if (tri.neighbour[i] == kNone && is_encroached({t, i})) encroached_.push_back({t, stamps_[t], i});
    }
    const LatticePoint a = at(tri.v[0]), b = at(tri.v[1]), c = at(tri.v[2]);
    const bool large = static_cast<double>(orient2d(a, b, c)) > max_doubled_area_;
    if (!large && !is_angle_below(a, b, c, cos2_)) return;
    const std::int64_t shortest = std::min({distance2(a, b), distance2(b, c), distance2(c, a)});
    // Shortest first: the buckets are powers of two of the squared length.
    const auto bucket = static_cast<std::size_t>(std::bit_width(static_cast<std::uint64_t>(shortest)));
    bad_[bucket].push_back({t, stamps_[t]});
    first_bad_ = std::min(first_bad_, bucket);
  }

  std::optional<Ticket> next_bad() {
    for (; first_bad_ < bad_.size(); ++first_bad_) {
      std::vector<Ticket>& bucket = bad_[first_bad_];
      while (!bucket.empty()) {
        const Ticket ticket = bucket.back();
        bucket.pop_back();
        if (stamps_[ticket.triangle] == ticket.stamp) return ticket;
      }
    }
    return std::nullopt;
  }

  // ---- splitting boundary edges ----

  void split_encroached() {
    while (!encroached_.empty() && points_.size() < max_vertices_) {
      const Ticket ticket = encroached_.back();
      encroached_.pop_back();
      if (stamps_[ticket.triangle] == ticket.stamp) split_side({ticket.triangle, ticket.side});
    }
  }

  // Where to split ab, a piece of an input segment: the middle, but if the segment has an acute corner
  // on a shell around it, so that pieces of the two segments that meet there end at equal distances.
  double split_fraction(std::uint32_t a, std::uint32_t b, std::int32_t segment) const {
    const Refined::Segment& s = out_.segments[static_cast<std::size_t>(segment)];
    double fraction = 0.5, nearest = std::numeric_limits<double>::max();
    for (const std::uint32_t corner : {s.from, s.to}) {
      if (corner_angle_deg_[corner] >= kAcute_deg) continue;
      const double da = distance(a, corner), db = distance(b, corner);
      const double near = std::min(da, db), far = std::max(da, db);
      if (near >= nearest) continue;
      nearest = near;
      fraction = (shell_between(near, far) - near) / (far - near);
      if (db < da) fraction = 1 - fraction;
    }
    return fraction;
  }

  // The shells around a corner, the same for every segment: the powers of two, between them their
  // ratio's square root (shells in the ratio sqrt(2) leave no angle below 32 degrees between segments
  // that meet under 30 or more, the ratio 2 leaves 26), then halves. Gives the first in this order
  // that lies well inside (near, far).
  static double shell_between(double near, double far) {
    const double low = near + 0.25 * (far - near), high = far - 0.25 * (far - near);
    double power = 1;
    while (power * 2 <= high) power *= 2;
    if (power >= low) return power;
    double from = power, to = 2 * power, middle = power * std::numbers::sqrt2;
    for (int depth = 0; depth < 20; ++depth) {
      if (middle >= low && middle <= high) return middle;
      (middle < low ? from : to) = middle;
      middle = 0.5 * (from + to);
    }
    return 0.5 * (near + far);
  }

  // The lattice point nearest to the split point that lies on the edge or on its inner side and
  // leaves two positive triangles: the boundary then never moves outwards, so it cannot meet
  // another part of itself, and the triangle that held it still does.
  std::optional<LatticePoint> split_point(Side s) const {
    const auto [ia, ib] = ends(s);
    const LatticePoint a = at(ia), b = at(ib), c = at(triangles_[s.triangle].v[s.side]);
    const double f = split_fraction(ia, ib, triangles_[s.triangle].segment[s.side]);
    const double x = a.x + f * (static_cast<double>(b.x) - a.x), y = a.y + f * (static_cast<double>(b.y) - a.y);
    std::optional<LatticePoint> best;
    double best_d2 = 0;
    for (int dy = 0; dy < 2; ++dy) {
      for (int dx = 0; dx < 2; ++dx) {
        const LatticePoint m{static_cast<std::int32_t>(std::floor(x)) + dx, static_cast<std::int32_t>(std::floor(y)) + dy};
        if (orient2d(a, b, m) < 0 || orient2d(b, c, m) <= 0 || orient2d(c, a, m) <= 0) continue;
        const double d2 = (m.x - x) * (m.x - x) + (m.y - y) * (m.y - y);
        if (!best || d2 < best_d2) best = m, best_d2 = d2;
      }
    }
    return best;
  }

  bool split_side(Side s) {
    const auto [a, b] = ends(s);
    if (distance2(at(a), at(b)) < 4 * kShortestEdge * kShortestEdge) return false;
    const std::optional<LatticePoint> m = split_point(s);
    if (!m) return false;
    find_cavity(s.triangle, *m);
    const std::int32_t segment = triangles_[s.triangle].segment[s.side];
    // The side itself leaves the cavity's rim: m lies on it.
    std::erase_if(rim_, [s](const Rim& r) { return r.from.triangle == s.triangle && r.from.side == s.side; });
    return fill_cavity(*m, {segment}, segment);
  }

  // ---- inserting in the material ----

  void improve(std::uint32_t t) {
    const Tri tri = triangles_[t];
    const LatticePoint a = at(tri.v[0]), b = at(tri.v[1]), c = at(tri.v[2]);
    const bool large = static_cast<double>(orient2d(a, b, c)) > max_doubled_area_;
    if (!large) {
      if (is_too_short(tri)) return;
      if (const std::uint32_t corner = across_small_angle(tri); corner != kNone) {
        // Miller, Pav and Walkington: shortening this edge would go on for ever. Where the input
        // angle allows the wanted one, closer shells reach it.
        if (corner_angle_deg_[corner] < min_angle_deg_ + kLatticeAllowance_deg) return;
        if (split_shells(t, corner)) return;
      }
    }
    const std::optional<LatticePoint> p = large && !is_angle_below(a, b, c, cos2_) ? circumcentre(tri, false) : circumcentre(tri, true);
    if (!p || in_circle(a, b, c, *p) <= 0) return;
    find_cavity(t, *p);
    // A point that would encroach, or lies beyond the boundary, splits the edges in its way instead.
    split_first_.clear();
    for (const Rim& r : rim_) {
      if (r.outside == kNone && (diametral_dot(at(r.a), at(r.b), *p) < 0 || orient2d(at(r.a), at(r.b), *p) <= 0)) {
        split_first_.push_back({r.from.triangle, stamps_[r.from.triangle], r.from.side});
      }
    }
    if (split_first_.empty()) {
      fill_cavity(*p, {VertexOrigin::kFree}, -1);
      return;
    }
    bool split = false;
    const std::uint32_t stamp = stamps_[t];
    for (const Ticket& side : std::vector<Ticket>(split_first_)) {
      if (stamps_[side.triangle] == side.stamp) split = split_side({side.triangle, side.side}) || split;
    }
    if (split && stamps_[t] == stamp) look_at(t);  // it may still be bad
  }

  bool is_too_short(const Tri& tri) {
    const LatticePoint a = at(tri.v[0]), b = at(tri.v[1]), c = at(tri.v[2]);
    const bool is = std::min({distance2(a, b), distance2(b, c), distance2(c, a)}) < kShortestEdge * kShortestEdge;
    if (is) ++out_.too_short;
    return is;
  }

  // The corner, if the shortest edge joins two input segments that meet there under a small angle,
  // at the same distance from it; else kNone.
  std::uint32_t across_small_angle(const Tri& tri) const {
    std::uint32_t shortest = 0;
    std::int64_t length2 = std::numeric_limits<std::int64_t>::max();
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::int64_t d2 = distance2(at(tri.v[(i + 1) % 3]), at(tri.v[(i + 2) % 3]));
      if (d2 < length2) length2 = d2, shortest = i;
    }
    const std::uint32_t p = tri.v[(shortest + 1) % 3], q = tri.v[(shortest + 2) % 3];
    const std::uint32_t corner = common_small_corner(out_.origins[p].segment, out_.origins[q].segment);
    if (corner == kNone || std::abs(distance(p, corner) - distance(q, corner)) > kSameShell) return kNone;
    return corner;
  }

  // Splits the sides of a triangle that lie on segments from the corner and reach from one shell
  // to the next but one, so that shells follow in the ratio sqrt(2).
  bool split_shells(std::uint32_t t, std::uint32_t corner) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      if (triangles_[t].neighbour[i] != kNone) continue;
      const auto [a, b] = ends({t, i});
      const double da = distance(a, corner), db = distance(b, corner);
      if (std::min(da, db) > 0 && std::max(da, db) > 1.5 * std::min(da, db) && split_side({t, i})) return true;
    }
    return false;
  }

  // Circumcentre, or where that is nearer the off-centre on the same bisector, on the lattice.
  std::optional<LatticePoint> circumcentre(const Tri& tri, bool off_centre) const {
    std::uint32_t k = 0;  // shortest edge: from v[k+1] to v[k+2]
    std::int64_t length2 = std::numeric_limits<std::int64_t>::max();
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::int64_t d2 = distance2(at(tri.v[(i + 1) % 3]), at(tri.v[(i + 2) % 3]));
      if (d2 < length2) length2 = d2, k = i;
    }
    const LatticePoint p = at(tri.v[(k + 1) % 3]), q = at(tri.v[(k + 2) % 3]), r = at(tri.v[k]);
    const double qx = static_cast<double>(q.x) - p.x, qy = static_cast<double>(q.y) - p.y;
    const double rx = static_cast<double>(r.x) - p.x, ry = static_cast<double>(r.y) - p.y;
    const double q2 = qx * qx + qy * qy, r2 = rx * rx + ry * ry;
    const double d = 2 * (qx * ry - qy * rx);
    double x = (ry * q2 - qy * r2) / d, y = (qx * r2 - rx * q2) / d;
    if (off_centre) {
      // On a short edge rounding moves the apex by a sizeable angle: stay nearer, to see it wider.
      const double reach = off_centre_ * (1 - std::min(0.4, 3 / std::sqrt(q2)));
      const double ox = 0.5 * qx - reach * qy, oy = 0.5 * qy + reach * qx;
      const double mx = 0.5 * qx, my = 0.5 * qy;
      if ((ox - mx) * (ox - mx) + (oy - my) * (oy - my) < (x - mx) * (x - mx) + (y - my) * (y - my)) x = ox, y = oy;
    }
    x += p.x, y += p.y;
    if (!(std::abs(x) < kMaxCoordinate && std::abs(y) < kMaxCoordinate)) return std::nullopt;
    return LatticePoint{static_cast<std::int32_t>(std::lrint(x)), static_cast<std::int32_t>(std::lrint(y))};
  }

  // ---- the cavity: all triangles whose circumcircle holds p and that p sees ----

  struct Rim {
    std::uint32_t a, b;     // directed, cavity on the left
    std::uint32_t outside;  // triangle beyond, or kNone
    std::int32_t segment;
    Side from;
  };

  void find_cavity(std::uint32_t start, LatticePoint p) {
    cavity_.assign(1, start);
    rim_.clear();
    in_cavity_.resize(triangles_.size(), 0);
    in_cavity_[start] = 1;
    for (std::size_t k = 0; k < cavity_.size(); ++k) {
      const std::uint32_t t = cavity_[k];
      for (std::uint32_t i = 0; i < 3; ++i) {
        const std::uint32_t n = triangles_[t].neighbour[i];
        if (n != kNone && in_cavity_[n] != 0) continue;
        if (n != kNone) {
          const Tri& tri = triangles_[n];
          if (in_circle(at(tri.v[0]), at(tri.v[1]), at(tri.v[2]), p) > 0) {
            in_cavity_[n] = 1;
            cavity_.push_back(n);
            continue;
          }
        }
        const auto [a, b] = ends({t, i});
        rim_.push_back({a, b, n, triangles_[t].segment[i], {t, i}});
      }
    }
    for (const std::uint32_t t : cavity_) in_cavity_[t] = 0;
  }

  // Replaces the cavity by the star of a new vertex p. The rim is a closed loop, or, when p splits
  // a boundary edge of `segment`, open at that edge. Changes nothing and gives false if a triangle
  // of the star would not be positive.
  bool fill_cavity(LatticePoint p, VertexOrigin origin, std::int32_t segment) {
    for (const Rim& r : rim_) {
      if (orient2d(at(r.a), at(r.b), p) <= 0) return false;
    }
    // A loop around cavity_.size() triangles has two edges more, an open one one more.
    if (rim_.size() != cavity_.size() + (segment < 0 ? 2 : 1)) return false;
    const auto v = static_cast<std::uint32_t>(points_.size());
    points_.push_back(p);
    out_.origins.push_back(origin);
    star_.push_back(kNone);
    corner_angle_deg_.push_back(360);
    fresh_.clear();
    for (std::size_t k = 0; k < rim_.size(); ++k) {
      std::uint32_t t = 0;
      if (k < cavity_.size()) {
        t = cavity_[k];
      } else {
        t = static_cast<std::uint32_t>(triangles_.size());
        triangles_.emplace_back();
        stamps_.push_back(0);
      }
      fresh_.push_back(t);
    }
    // The rim speaks of old sides of triangles about to be overwritten: look from outside in first.
    for (std::size_t k = 0; k < rim_.size(); ++k) {
      const Rim& r = rim_[k];
      if (r.outside == kNone) continue;
      Tri& out = triangles_[r.outside];
      for (std::uint32_t i = 0; i < 3; ++i) {
        if (out.v[(i + 1) % 3] == r.b && out.v[(i + 2) % 3] == r.a) out.neighbour[i] = fresh_[k];
      }
    }
    for (std::size_t k = 0; k < rim_.size(); ++k) {
      const Rim& r = rim_[k];
      Tri& t = triangles_[fresh_[k]];
      t = Tri{{v, r.a, r.b}};
      t.neighbour[0] = r.outside;
      t.segment[0] = r.segment;
      ++stamps_[fresh_[k]];
      star_[r.a] = fresh_[k];
    }
    for (std::size_t k = 0; k < rim_.size(); ++k) {
      const std::uint32_t next = star_[rim_[k].b];  // the one that starts where this one ends
      if (next != kNone) {
        triangles_[fresh_[k]].neighbour[1] = next;
        triangles_[next].neighbour[2] = fresh_[k];
      }
    }
    for (const Rim& r : rim_) star_[r.a] = kNone;
    for (const std::uint32_t t : fresh_) {
      for (std::uint32_t i = 1; i < 3; ++i) {
        if (triangles_[t].neighbour[i] == kNone) triangles_[t].segment[i] = segment;
      }
    }
    for (const std::uint32_t t : fresh_) look_at(t);
    return true;
  }

  Refined finish() {
    out_.mesh.vertices = std::move(points_);
    out_.mesh.triangles.reserve(triangles_.size());
    for (const Tri& t : triangles_) out_.mesh.triangles.push_back(t.v);
    return std::move(out_);
  }

  std::vector<LatticePoint> points_;
  std::vector<Tri> triangles_;
  std::vector<std::uint32_t> stamps_;  // by triangle; grows when it is replaced
  std::vector<double> corner_angle_deg_;  // by vertex: the material angle of an input vertex
  std::vector<std::uint32_t> star_;    // by vertex; scratch of fill_cavity
  double min_angle_deg_, cos2_ = 0, off_centre_ = 0, max_doubled_area_ = 0;
  std::uint32_t max_vertices_ = 0;
  std::vector<Ticket> encroached_, split_first_;
  std::array<std::vector<Ticket>, 65> bad_;
  std::size_t first_bad_ = 65;
  std::vector<std::uint32_t> cavity_, fresh_;
  std::vector<char> in_cavity_;
  std::vector<Rim> rim_;
  Refined out_;
};

}  // namespace

bool is_angle_below(LatticePoint a, LatticePoint b, LatticePoint c, double cos2) {
  std::int64_t ab = distance2(a, b), bc = distance2(b, c), ca = distance2(c, a);
  // The smallest angle lies opposite the shortest side, between the two others.
  LatticePoint apex = c;
  std::int64_t l = bc, m = ca;
  if (bc <= ab && bc <= ca) {
    apex = a, l = ab, m = ca;
  } else if (ca <= ab && ca <= bc) {
    apex = b, l = ab, m = bc;
  }
  const LatticePoint p = apex == a ? b : a, q = apex == c ? b : c;
  const double dot = static_cast<double>(diametral_dot(p, q, apex));
  return dot > 0 && dot * dot > cos2 * (static_cast<double>(l) * static_cast<double>(m));
}

Refined refine(const SliceMesh& mesh, const Lattice& lattice, const RefinementOptions& options) {
  return Refiner(mesh, lattice, options).run();
}

}  // namespace trocar::pipeline
