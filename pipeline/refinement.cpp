// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/refinement.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "pipeline/refinement_mesh.h"

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
// A new point is tried in this many places, this far apart, to either side of the off-centre (see
// improve()).
// By how many steps a place is drawn nearer to its edge, for rounding not to make the angle too
// small.
constexpr double kRounding = 1.5;
constexpr int kPlaces = 2;
constexpr double kPlaceStep_deg = 30;

// A reference that goes stale when its triangle is replaced.
struct Ticket {
  std::uint32_t triangle, stamp;
  std::uint32_t side = 0;
};

// The shape of a triangle, as far as refinement cares.
struct Shape {
  std::int64_t shortest2;  // squared length of the shortest side
  bool is_sharp;           // its smallest angle is below the wanted one
};

[[gnu::always_inline]] inline Shape shape_of(LatticePoint a, LatticePoint b, LatticePoint c,
                                             double cos2) {
  // The smallest angle lies opposite the shortest side s, between l and m; l.m = (l^2 + m^2 - s^2)
  // / 2.
  const std::int64_t ab2 = distance2(a, b), bc2 = distance2(b, c), ca2 = distance2(c, a);
  const std::int64_t s2 = std::min(std::min(ab2, bc2), ca2), l2 = std::max(std::max(ab2, bc2), ca2);
  const std::int64_t m2 = ab2 + bc2 + ca2 - s2 - l2;
  const double dot = 0.5 * static_cast<double>(l2 + m2 - s2);
  return {s2, dot * dot > cos2 * (static_cast<double>(l2) * static_cast<double>(m2))};
}

// Memory that is kept from slice to slice: taking fresh pages cost a fifth of the time.
struct Workspace {
  RefinementMesh mesh;
  std::vector<VertexOrigin> origins;
  std::vector<Ticket> encroached, split_first;
  std::array<std::vector<Ticket>, 4 * 64> bad;
  std::vector<std::int8_t> is_bad;
  Cavity cavity, trial;
  std::vector<std::uint32_t> fresh;
};

// Places for a new point on the shortest side pq of a triangle, seen from the side's middle in
// units of the side: along it and away from it.
struct Place {
  double along, away;
};

class Refiner {
 public:
  Refiner(const SliceMesh& mesh, const Lattice& lattice, const RefinementOptions& options,
          Workspace& memory)
      : mesh_(memory.mesh),
        origins_(memory.origins),
        encroached_(memory.encroached),
        split_first_(memory.split_first),
        bad_(memory.bad),
        is_bad_(memory.is_bad),
        cavity_(memory.cavity),
        trial_(memory.trial),
        fresh_(memory.fresh),
        min_angle_deg_(options.min_angle_deg) {
    const double angle = options.min_angle_deg * std::numbers::pi / 180;
    cos2_ = std::cos(angle) * std::cos(angle);
    const double cot = std::cos(angle) / std::sin(angle), radius = 0.5 / std::sin(angle);
    off_centre_ = 0.5 * cot + radius;
    for (int k = 1; k <= kPlaces; ++k) {
      const double turn = k * kPlaceStep_deg * std::numbers::pi / 180;
      places_.push_back({radius * std::sin(turn), 0.5 * cot + radius * std::cos(turn)});
      places_.push_back({-radius * std::sin(turn), 0.5 * cot + radius * std::cos(turn)});
    }
    const double step2 = lattice.step_mm() * lattice.step_mm();
    max_doubled_area_ = 2 * options.max_area_mm2 / step2;
    encroached_.clear();
    is_bad_.clear();
    for (std::vector<Ticket>& bucket : bad_)
      bucket.clear();
    build(mesh);
    max_vertices_ = options.max_vertices != 0
                        ? options.max_vertices
                        : static_cast<std::uint32_t>(std::min(
                              4e9, 10'000 + 200.0 * static_cast<double>(mesh_.points.size()) +
                                       20.0 * static_cast<double>(doubled_area(mesh)) /
                                           std::max(max_doubled_area_, 1.0)));
  }

  Refined run() {
    for (std::uint32_t t = 0; t < mesh_.triangles.size(); ++t)
      look_at(t);
    while (true) {
      split_encroached();
      const std::optional<Ticket> bad = next_bad();
      if (!bad) break;
      if (mesh_.points.size() >= max_vertices_) {
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
    std::vector<std::int32_t> segment_into(mesh.vertices.size(), -1);
    mesh_.assign(mesh, [&](std::uint32_t a, std::uint32_t b) {
      const auto s = static_cast<std::uint32_t>(out_.segments.size());
      out_.segments.push_back({a, b, -1, 0});
      segment_into[b] = static_cast<std::int32_t>(s);
      return s;
    });
    for (Refined::Segment& s : out_.segments) {
      s.previous = segment_into[s.from];
      const LatticePoint v = at(s.from);
      const LatticePoint p = at(out_.segments[static_cast<std::size_t>(s.previous)].from),
                         n = at(s.to);
      const double cross = static_cast<double>(orient2d(v, n, p));
      const double dot = static_cast<double>(diametral_dot(n, p, v));
      s.angle_at_from_deg =
          cross > 0 && dot > 0 ? std::atan2(cross, dot) * 180 / std::numbers::pi : 360;
    }
    origins_.assign(mesh_.points.size(), {VertexOrigin::kCorner});
    corner_angle_deg_.assign(mesh_.points.size(), 360);
    for (const Refined::Segment& s : out_.segments)
      corner_angle_deg_[s.from] = s.angle_at_from_deg;
  }

  LatticePoint at(std::uint32_t v) const { return mesh_.points[v]; }

  // ---- what is wrong with a triangle ----

  double distance(std::uint32_t a, std::uint32_t b) const {
    return std::sqrt(static_cast<double>(distance2(at(a), at(b))));
  }

  bool is_encroached(Side s) const {
    const auto [a, b] = mesh_.ends(s);
    const std::uint32_t apex = mesh_.apex(s);
    if (diametral_dot(at(a), at(b), at(apex)) >= 0) return false;
    // Across a small input angle, the vertex on the same shell encroaches by rounding alone.
    const std::uint32_t corner =
        common_small_corner(static_cast<std::int32_t>(mesh_.segment(s)), origins_[apex].segment);
    if (corner == kNone) return true;
    const double d = distance(apex, corner);
    return std::abs(d - distance(a, corner)) > kSameShell &&
           std::abs(d - distance(b, corner)) > kSameShell;
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
    const WorkingTriangle& tri = mesh_.triangles[t];
    for (std::uint32_t i = 0; i < 3; ++i) {
      if (mesh_.is_outline({t, i}) && is_encroached({t, i}))
        encroached_.push_back({t, mesh_.stamps[t], i});
    }
    const LatticePoint a = at(tri.v[0]), b = at(tri.v[1]), c = at(tri.v[2]);
    const Shape shape = shape_of(a, b, c, cos2_);
    const bool bad = shape.is_sharp || is_large(orient2d(a, b, c));
    if (is_bad_.size() < mesh_.triangles.size()) is_bad_.resize(mesh_.triangles.size());
    is_bad_[t] = bad ? 1 : 0;
    if (!bad) return;
    // Shortest first: four buckets for each power of two of the squared length.
    const auto length2 = static_cast<std::uint64_t>(shape.shortest2) << 2;
    const auto width = static_cast<std::uint32_t>(std::bit_width(length2));
    const std::size_t bucket = 4 * width + ((length2 >> (width - 3)) & 3);
    bad_[bucket].push_back({t, mesh_.stamps[t]});
    first_bad_ = std::min(first_bad_, bucket);
  }

  bool is_large(std::int64_t area2) const { return static_cast<double>(area2) > max_doubled_area_; }

  std::optional<Ticket> next_bad() {
    for (; first_bad_ < bad_.size(); ++first_bad_) {
      std::vector<Ticket>& bucket = bad_[first_bad_];
      while (!bucket.empty()) {
        const Ticket ticket = bucket.back();
        bucket.pop_back();
        if (mesh_.stamps[ticket.triangle] == ticket.stamp) return ticket;
      }
    }
    return std::nullopt;
  }

  // ---- splitting boundary edges ----

  void split_encroached() {
    while (!encroached_.empty() && mesh_.points.size() < max_vertices_) {
      const Ticket ticket = encroached_.back();
      encroached_.pop_back();
      if (mesh_.stamps[ticket.triangle] == ticket.stamp) split_side({ticket.triangle, ticket.side});
    }
  }

  // Where to split ab, a piece of an input segment: the middle, but if the segment has an acute
  // corner on a shell around it, so that pieces of the two segments that meet there end at equal
  // distances.
  double split_fraction(std::uint32_t a, std::uint32_t b, std::uint32_t segment) const {
    const Refined::Segment& s = out_.segments[segment];
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
  // ratio's square root (shells in the ratio sqrt(2) leave no angle below 32 degrees between
  // segments that meet under 30 or more, the ratio 2 leaves 26), then halves. Gives the first in
  // this order that lies well inside (near, far).
  static double shell_between(double near, double far) {
    const double low = near + 0.25 * (far - near), high = far - 0.25 * (far - near);
    double power = 1;
    while (power * 2 <= high)
      power *= 2;
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
    const auto [ia, ib] = mesh_.ends(s);
    const LatticePoint a = at(ia), b = at(ib), c = at(mesh_.apex(s));
    const double f = split_fraction(ia, ib, mesh_.segment(s));
    const double x = a.x + f * (static_cast<double>(b.x) - a.x),
                 y = a.y + f * (static_cast<double>(b.y) - a.y);
    std::optional<LatticePoint> best;
    double best_d2 = 0;
    for (int dy = 0; dy < 2; ++dy) {
      for (int dx = 0; dx < 2; ++dx) {
        const LatticePoint m{static_cast<std::int32_t>(std::floor(x)) + dx,
                             static_cast<std::int32_t>(std::floor(y)) + dy};
        if (orient2d(a, b, m) < 0 || orient2d(b, c, m) <= 0 || orient2d(c, a, m) <= 0) continue;
        const double d2 = (m.x - x) * (m.x - x) + (m.y - y) * (m.y - y);
        if (!best || d2 < best_d2) best = m, best_d2 = d2;
      }
    }
    return best;
  }

  bool split_side(Side s) {
    const auto [a, b] = mesh_.ends(s);
    if (distance2(at(a), at(b)) < 4 * kShortestEdge * kShortestEdge) return false;
    const std::optional<LatticePoint> m = split_point(s);
    if (!m) return false;
    mesh_.find_cavity(s.triangle, *m, trial_);
    const std::uint32_t segment = mesh_.segment(s);
    // The side itself leaves the cavity's rim: m lies on it.
    std::erase_if(trial_.rim, [s](const Cavity::Rim& r) {
      return r.from.triangle == s.triangle && r.from.side == s.side;
    });
    return insert(trial_, *m, {static_cast<std::int32_t>(segment)}, kOutline | segment);
  }

  bool insert(const Cavity& cavity, LatticePoint p, VertexOrigin origin, std::uint32_t split) {
    if (!mesh_.fill_cavity(cavity, p, split, fresh_)) return false;
    origins_.push_back(origin);
    for (const std::uint32_t t : fresh_)
      look_at(t);
    return true;
  }

  // ---- inserting in the material ----

  void improve(std::uint32_t t) {
    const WorkingTriangle tri = mesh_.triangles[t];
    const LatticePoint a = at(tri.v[0]), b = at(tri.v[1]), c = at(tri.v[2]);
    const bool large = is_large(orient2d(a, b, c));
    if (!large) {
      if (is_too_short(tri)) return give_up(t);
      if (const std::uint32_t corner = across_small_angle(tri); corner != kNone) {
        // Miller, Pav and Walkington: shortening this edge would go on for ever. Where the input
        // angle allows the wanted one, closer shells reach it.
        if (corner_angle_deg_[corner] < min_angle_deg_ + kLatticeAllowance_deg) return give_up(t);
        if (split_shells(t, corner)) return;
      }
    }
    const Shape shape = shape_of(a, b, c, cos2_);
    std::optional<LatticePoint> p = circumcentre(tri, shape.is_sharp);
    if (!p || !mesh_.circumcircle_holds(t, *p)) return;
    mesh_.find_cavity(t, *p, cavity_);
    if (shape.is_sharp && !large) {
      // Other places under the same angle may rid us of more bad triangles at once, or spare the
      // outline: the first that leaves fewer than there were, or the best of them. They keep the
      // distance from other vertices that the off-centre has by nature, the shortest edge's length,
      // so that refinement ends as it does without them.
      int best = is_blocked(cavity_, *p) ? 0 : growth_of_bad(cavity_, *p);
      const std::uint32_t k = shortest_side(tri);
      const LatticePoint from = at(tri.v[next_side(k)]), to = at(tri.v[previous_side(k)]);
      const double dx = static_cast<double>(to.x) - from.x, dy = static_cast<double>(to.y) - from.y;
      const double x = 0.5 * (static_cast<double>(to.x) + from.x),
                   y = 0.5 * (static_cast<double>(to.y) + from.y);
      const double shrink =
          1 - std::min(0.4, kRounding / std::sqrt(static_cast<double>(shape.shortest2)));
      for (const Place& place : places_) {
        if (best < 0) break;
        const LatticePoint q{static_cast<std::int32_t>(
                                 std::lrint(x + (place.along * dx - place.away * dy) * shrink)),
                             static_cast<std::int32_t>(
                                 std::lrint(y + (place.along * dy + place.away * dx) * shrink))};
        if (!mesh_.circumcircle_holds(t, q)) continue;
        const auto is_welcome = [&](const Cavity::Rim& r) {
          return distance2(at(r.a), q) >= shape.shortest2 && orient2d(at(r.a), at(r.b), q) > 0 &&
                 !is_in_the_way(r, q);
        };
        if (!mesh_.find_cavity(t, q, trial_, is_welcome)) continue;
        if (const int growth = growth_of_bad(trial_, q); growth < best) {
          best = growth, p = q;
          std::swap(cavity_, trial_);
        }
      }
    }
    // A point that would encroach, or lies beyond the boundary, splits the edges in its way
    // instead.
    split_first_.clear();
    for (const Cavity::Rim& r : cavity_.rim) {
      if (is_in_the_way(r, *p))
        split_first_.push_back({r.from.triangle, mesh_.stamps[r.from.triangle], r.from.side});
    }
    if (split_first_.empty()) {
      insert(cavity_, *p, {VertexOrigin::kFree}, 0);
      return;
    }
    bool split = false;
    const std::uint32_t stamp = mesh_.stamps[t];
    for (const Ticket& side : split_first_) {
      if (mesh_.stamps[side.triangle] == side.stamp)
        split = split_side({side.triangle, side.side}) || split;
    }
    if (split && mesh_.stamps[t] == stamp) look_at(t);  // it may still be bad
  }

  void give_up(std::uint32_t t) { is_bad_[t] = 0; }

  bool is_in_the_way(const Cavity::Rim& r, LatticePoint p) const {
    return r.is_outline() &&
           (diametral_dot(at(r.a), at(r.b), p) < 0 || orient2d(at(r.a), at(r.b), p) <= 0);
  }

  bool is_blocked(const Cavity& cavity, LatticePoint p) const {
    return std::any_of(cavity.rim.begin(), cavity.rim.end(),
                       [&](const Cavity::Rim& r) { return is_in_the_way(r, p); });
  }

  // How many bad triangles more there would be.
  int growth_of_bad(const Cavity& cavity, LatticePoint p) const {
    int out = 0;
    for (const Cavity::Rim& r : cavity.rim)
      out += is_bad(at(r.a), at(r.b), p) ? 1 : 0;
    for (const std::uint32_t t : cavity.triangles)
      out -= is_bad_[t];
    return out;
  }
  bool is_bad(LatticePoint a, LatticePoint b, LatticePoint c) const {
    return shape_of(a, b, c, cos2_).is_sharp || is_large(orient2d(a, b, c));
  }

  bool is_too_short(const WorkingTriangle& tri) {
    const LatticePoint a = at(tri.v[0]), b = at(tri.v[1]), c = at(tri.v[2]);
    const bool is = std::min({distance2(a, b), distance2(b, c), distance2(c, a)}) <
                    kShortestEdge * kShortestEdge;
    if (is) ++out_.too_short;
    return is;
  }

  std::uint32_t shortest_side(const WorkingTriangle& tri) const {
    const LatticePoint a = at(tri.v[0]), b = at(tri.v[1]), c = at(tri.v[2]);
    const std::int64_t bc = distance2(b, c), ca = distance2(c, a), ab = distance2(a, b);
    return bc <= ca && bc <= ab ? 0 : ca <= ab ? 1 : 2;
  }

  // The corner, if the shortest edge joins two input segments that meet there under a small angle,
  // at the same distance from it; else kNone.
  std::uint32_t across_small_angle(const WorkingTriangle& tri) const {
    const std::uint32_t shortest = shortest_side(tri);
    const std::uint32_t p = tri.v[next_side(shortest)], q = tri.v[previous_side(shortest)];
    const std::uint32_t corner = common_small_corner(origins_[p].segment, origins_[q].segment);
    if (corner == kNone || std::abs(distance(p, corner) - distance(q, corner)) > kSameShell)
      return kNone;
    return corner;
  }

  // Splits the sides of a triangle that lie on segments from the corner and reach from one shell
  // to the next but one, so that shells follow in the ratio sqrt(2).
  bool split_shells(std::uint32_t t, std::uint32_t corner) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      if (!mesh_.is_outline({t, i})) continue;
      const auto [a, b] = mesh_.ends({t, i});
      const double da = distance(a, corner), db = distance(b, corner);
      if (std::min(da, db) > 0 && std::max(da, db) > 1.5 * std::min(da, db) && split_side({t, i}))
        return true;
    }
    return false;
  }

  // Circumcentre, or where that is nearer the off-centre on the same bisector, on the lattice.
  std::optional<LatticePoint> circumcentre(const WorkingTriangle& tri, bool off_centre) const {
    const std::uint32_t k = shortest_side(tri);
    const LatticePoint p = at(tri.v[next_side(k)]), q = at(tri.v[previous_side(k)]),
                       r = at(tri.v[k]);
    const double qx = static_cast<double>(q.x) - p.x, qy = static_cast<double>(q.y) - p.y;
    const double rx = static_cast<double>(r.x) - p.x, ry = static_cast<double>(r.y) - p.y;
    const double q2 = qx * qx + qy * qy, r2 = rx * rx + ry * ry;
    const double d = 2 * (qx * ry - qy * rx);
    double x = (ry * q2 - qy * r2) / d, y = (qx * r2 - rx * q2) / d;
    if (off_centre) {
      // On a short edge rounding moves the apex by a sizeable angle: stay nearer, to see it wider.
      const double reach = off_centre_ * (1 - std::min(0.4, kRounding / std::sqrt(q2)));
      const double ox = 0.5 * qx - reach * qy, oy = 0.5 * qy + reach * qx;
      const double mx = 0.5 * qx, my = 0.5 * qy;
      if ((ox - mx) * (ox - mx) + (oy - my) * (oy - my) < (x - mx) * (x - mx) + (y - my) * (y - my))
        x = ox, y = oy;
    }
    x += p.x, y += p.y;
    if (!(std::abs(x) < kMaxCoordinate && std::abs(y) < kMaxCoordinate)) return std::nullopt;
    return LatticePoint{static_cast<std::int32_t>(std::lrint(x)),
                        static_cast<std::int32_t>(std::lrint(y))};
  }

  Refined finish() {
    out_.mesh.vertices = mesh_.points;
    out_.origins = origins_;
    out_.mesh.triangles.reserve(mesh_.triangles.size());
    for (const WorkingTriangle& t : mesh_.triangles)
      out_.mesh.triangles.push_back(t.v);
    return std::move(out_);
  }

  RefinementMesh& mesh_;
  std::vector<VertexOrigin>& origins_;
  std::vector<Ticket>&encroached_, &split_first_;
  std::array<std::vector<Ticket>, 4 * 64>& bad_;
  std::vector<std::int8_t>& is_bad_;  // by triangle: 1 if it is to be improved
  Cavity &cavity_, &trial_;
  std::vector<std::uint32_t>& fresh_;
  std::size_t first_bad_ = 4 * 64;
  std::vector<double> corner_angle_deg_;  // by input vertex: its material angle
  std::vector<Place> places_;
  double min_angle_deg_, cos2_ = 0, off_centre_ = 0, max_doubled_area_ = 0;
  std::uint32_t max_vertices_ = 0;
  Refined out_;
};

}  // namespace

bool is_angle_below(LatticePoint a, LatticePoint b, LatticePoint c, double cos2) {
  return shape_of(a, b, c, cos2).is_sharp;
}

Refined refine(const SliceMesh& mesh, const Lattice& lattice, const RefinementOptions& options) {
  thread_local Workspace memory;
  return Refiner(mesh, lattice, options, memory).run();
}

}  // namespace trocar::pipeline
