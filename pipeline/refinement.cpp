// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/refinement.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "pipeline/refinement_mesh.h"
#include "pipeline/refinement_outline.h"
#include "pipeline/refinement_queue.h"

namespace trocar::pipeline {
namespace {

// An edge is not split into halves of fewer lattice steps than this, nor a triangle with a shorter
// edge improved: rounding to the lattice would decide the angles.
constexpr std::int64_t kShortestEdge = 4;
// By how many steps a place is drawn nearer to its edge, for rounding not to make the angle too
// small.
constexpr double kRounding = 1.5;
// Places for a new point over the shortest side of a sharp triangle: under the wanted angle, turned
// from the bisector by these.
constexpr std::array kTurns_deg = {30.0, -30.0, 60.0, -60.0};
// Places for a split of an outline's edge, the preferred first.
constexpr std::array kSplits = {0.5, 0.42, 0.58, 0.34, 0.66};
// A point over a side of a triangle that is too large is to make an equilateral one with sides
// this much of the largest allowed, no nearer to other vertices than half of that.
constexpr double kEvenSide = 0.9;

// For angles that are not safe: this many times the vertices of the mesh of the safe one, and how
// close to the steepest that ends the one taken is.
constexpr std::size_t kSteepBudget = 4;
constexpr double kAngleStep_deg = 0.25;

struct Limits {
  double sine2, doubled_area;
};

// The shape of a triangle, as far as refinement cares.
struct Shape {
  std::int64_t doubled_area;
  double ca2;        // squared length of the side from c to a
  double shortest2;  // and of the shortest side
  bool is_sharp, is_large;
  bool is_bad() const { return is_sharp || is_large; }
};

[[gnu::always_inline]] inline Shape shape_of(LatticePoint a, LatticePoint b, LatticePoint c,
                                             const Limits& limits) {
  const std::int64_t ab_x = std::int64_t{b.x} - a.x, ab_y = std::int64_t{b.y} - a.y;
  const std::int64_t ac_x = std::int64_t{c.x} - a.x, ac_y = std::int64_t{c.y} - a.y;
  const std::int64_t bc_x = ac_x - ab_x, bc_y = ac_y - ab_y;
  const std::int64_t doubled_area = ab_x * ac_y - ab_y * ac_x;
  const auto ab2 = static_cast<double>(ab_x * ab_x + ab_y * ab_y),
             ac2 = static_cast<double>(ac_x * ac_x + ac_y * ac_y),
             bc2 = static_cast<double>(bc_x * bc_x + bc_y * bc_y);
  // The smallest angle lies between the two longer sides.
  const double product = std::max(std::max(ab2 * ac2, ac2 * bc2), bc2 * ab2);
  const auto area = static_cast<double>(doubled_area);
  return {doubled_area, ac2, std::min(std::min(ab2, ac2), bc2),
          area * area<limits.sine2 * product, area> limits.doubled_area};
}

// Of a coordinate on the lattice. (std::lrint is a call.)
std::int32_t rounded(double x) {
  return static_cast<std::int32_t>(x < 0 ? x - 0.5 : x + 0.5);
}

// A new point, and what it would do.
struct Prospect {
  LatticePoint p;
  Cavity cavity;
  int growth = 0;  // of the number of bad triangles and encroached edges
  int flaws = 0;   // how many there would be
};

struct EncroachedTicket {
  Side side;
  std::uint32_t generation;
};

// Memory that is kept from slice to slice: taking fresh pages cost a fifth of the time.
struct Workspace {
  RefinementMesh mesh;
  RefinementOutline outline;
  RefinementQueue bad;
  std::vector<VertexOrigin> origins;
  std::vector<EncroachedTicket> encroached;
  std::vector<std::uint32_t> fresh;
  Prospect best, trial;
};

class Refiner {
 public:
  Refiner(const Triangulation& from, const Lattice& lattice, const RefinementOptions& options,
          Workspace& memory)
      : mesh_(memory.mesh),
        outline_(memory.outline),
        bad_(memory.bad),
        origins_(memory.origins),
        encroached_(memory.encroached),
        fresh_(memory.fresh),
        best_(memory.best),
        trial_(memory.trial),
        min_angle_deg_(options.min_angle_deg),
        max_vertices_(options.max_vertices) {
    const double angle = options.min_angle_deg * std::numbers::pi / 180;
    const double cot = std::cos(angle) / std::sin(angle), radius = 0.5 / std::sin(angle);
    off_centre_ = 0.5 * cot + radius;
    for (std::size_t k = 0; k < kTurns_deg.size(); ++k) {
      const double turn = kTurns_deg[k] * std::numbers::pi / 180;
      places_[k] = {radius * std::sin(turn), 0.5 * cot + radius * std::cos(turn)};
    }
    const double step2 = lattice.step_mm() * lattice.step_mm();
    limits_ = {std::sin(angle) * std::sin(angle), 2 * options.max_area_mm2 / step2};
    even_side_ = kEvenSide * std::sqrt(2 / std::numbers::sqrt3 * limits_.doubled_area);
    outline_.clear(from.mesh.vertices.size());
    mesh_.assign(from, [&](std::uint32_t a, std::uint32_t b) { return outline_.add(a, b); });
    outline_.close(mesh_.points);
    origins_.assign(mesh_.points.size(), {VertexOrigin::kCorner});
    encroached_.clear();
    bad_.clear();
  }

  Refined run() {
    for (std::uint32_t t = 0; t < mesh_.triangles.size(); ++t) {
      for (std::uint32_t i = 0; i < 3; ++i)
        look_at_side(side_number(t, i));
      const std::array<std::uint32_t, 3>& v = mesh_.triangles[t].v;
      const Shape shape = shape_of(at(v[0]), at(v[1]), at(v[2]), limits_);
      queue(t, shape.is_bad(), shape.shortest2);
    }
    while (true) {
      split_encroached();
      RefinementQueue::Ticket bad{};
      const bool is_any = bad_.pop(bad, [&](const RefinementQueue::Ticket& ticket) {
        return mesh_.triangles[ticket.triangle].generation == ticket.generation;
      });
      if (!is_any) break;
      if (mesh_.points.size() >= max_vertices_) {
        out_.outcome = RefinementOutcome::kVertexBudget;
        break;
      }
      improve(bad.triangle);
    }
    return finish();
  }

 private:
  // Seen from the middle of a side, in units of its length: along it and away from it.
  struct Place {
    double along, away;
  };

  LatticePoint at(std::uint32_t v) const { return mesh_.points[v]; }
  double distance(std::uint32_t a, std::uint32_t b) const {
    return std::sqrt(static_cast<double>(distance2(at(a), at(b))));
  }

  // ---- what is wrong with a triangle ----

  bool is_encroached(std::uint32_t segment, std::uint32_t a, std::uint32_t b,
                     std::uint32_t apex) const {
    if (diametral_dot(at(a), at(b), at(apex)) >= 0) return false;
    // Across a small input angle, the vertex on the same shell encroaches by rounding alone.
    const std::uint32_t corner =
        outline_.small_corner(static_cast<std::int32_t>(segment), origins_[apex].segment);
    if (corner == RefinementOutline::kNoCorner) return true;
    const double d = distance(apex, corner);
    return std::abs(d - distance(a, corner)) > RefinementOutline::kSameShell &&
           std::abs(d - distance(b, corner)) > RefinementOutline::kSameShell;
  }

  void look_at_side(Side s) {
    const std::uint32_t beyond = mesh_.beyond(s);
    if ((beyond & kOutline) == 0) return;
    const auto [a, b] = mesh_.ends(s);
    if (is_encroached(beyond ^ kOutline, a, b, mesh_.apex(s)))
      encroached_.push_back({s, mesh_.triangles[triangle_of(s)].generation});
  }

  void queue(std::uint32_t t, bool is_bad, double shortest2) {
    mesh_.triangles[t].is_bad = is_bad ? 1 : 0;
    if (is_bad) bad_.push(shortest2, {t, mesh_.triangles[t].generation});
  }

  // ---- looking before inserting ----

  // The shape of the triangle that would replace the edge of the rim.
  Shape look_ahead(Cavity::Rim& r, LatticePoint p) const {
    const Shape shape = shape_of(at(r.a), at(r.b), p, limits_);
    r.shortest2 = shape.shortest2;
    r.is_bad = shape.is_bad();
    return shape;
  }
  void sum_up(Prospect& prospect) const {
    prospect.growth = prospect.flaws;
    for (const std::uint32_t t : prospect.cavity.triangles)
      prospect.growth -= mesh_.triangles[t].is_bad;
  }

  bool is_in_the_way(const Cavity::Rim& r, LatticePoint p, const Shape& shape) const {
    return r.is_outline() && (shape.doubled_area <= 0 || diametral_dot(at(r.a), at(r.b), p) < 0);
  }

  // A quick look at what a neighbouring place saw: does it speak against this one?
  bool is_unwelcome_at(const Cavity& seen, LatticePoint p, double min_distance2) const {
    return std::any_of(seen.rim.begin(), seen.rim.end(), [&](const Cavity::Rim& r) {
      return static_cast<double>(distance2(at(r.a), p)) < min_distance2 ||
             (r.is_outline() && diametral_dot(at(r.a), at(r.b), p) < 0);
    });
  }

  // Would a point within the circumcircle of t lie in the material, encroach upon no edge and keep
  // a distance from other vertices?
  bool is_welcome(std::uint32_t t, LatticePoint p, double min_distance2, Prospect& out) {
    if (!mesh_.circumcircle_holds(t, p)) return false;
    out.p = p;
    out.flaws = 0;
    mesh_.find_cavity(t, p, kNoSide, out.cavity);
    for (Cavity::Rim& r : out.cavity.rim) {
      const Shape shape = look_ahead(r, p);
      out.flaws += r.is_bad ? 1 : 0;
      if (shape.doubled_area <= 0 || shape.ca2 < min_distance2 || is_in_the_way(r, p, shape))
        return false;
    }
    sum_up(out);
    return true;
  }

  // The longest edge of the outline that a point within the circumcircle of t encroaches upon or
  // lies beyond; kNoSide if there is none.
  Side find_in_the_way(std::uint32_t t, LatticePoint p, Prospect& out) {
    out.p = p;
    out.flaws = 0;
    Side longest = kNoSide;
    std::int64_t length2 = 0;
    mesh_.find_cavity(t, p, kNoSide, out.cavity);
    for (Cavity::Rim& r : out.cavity.rim) {
      const Shape shape = look_ahead(r, p);
      out.flaws += r.is_bad ? 1 : 0;
      if (is_in_the_way(r, p, shape)) {
        const std::int64_t ab2 = distance2(at(r.a), at(r.b));
        if (ab2 > length2) length2 = ab2, longest = r.inside;
      }
    }
    if (longest == kNoSide) sum_up(out);
    return longest;
  }

  // ---- splitting edges of the outline ----

  void split_encroached() {
    while (!encroached_.empty() && mesh_.points.size() < max_vertices_) {
      const EncroachedTicket ticket = encroached_.back();
      encroached_.pop_back();
      if (mesh_.triangles[triangle_of(ticket.side)].generation == ticket.generation)
        split_side(ticket.side);
    }
  }

  // The lattice point nearest to the split point that lies on the edge or on its inner side and
  // leaves two positive triangles: the boundary then never moves outwards, so it cannot meet
  // another part of itself, and the triangle that held it still does.
  static std::optional<LatticePoint> split_point(LatticePoint a, LatticePoint b, LatticePoint c,
                                                 double fraction) {
    const double x = a.x + fraction * (static_cast<double>(b.x) - a.x),
                 y = a.y + fraction * (static_cast<double>(b.y) - a.y);
    const LatticePoint near{rounded(x), rounded(y)};
    // The four points around, the nearest first.
    const int dx = x < near.x ? -1 : 1, dy = y < near.y ? -1 : 1;
    const bool x_first = std::abs(x - near.x) > std::abs(y - near.y);
    const std::array<LatticePoint, 4> around = {
        near, x_first ? LatticePoint{near.x + dx, near.y} : LatticePoint{near.x, near.y + dy},
        x_first ? LatticePoint{near.x, near.y + dy} : LatticePoint{near.x + dx, near.y},
        LatticePoint{near.x + dx, near.y + dy}};
    for (const LatticePoint m : around) {
      if (orient2d(a, b, m) >= 0 && orient2d(b, c, m) > 0 && orient2d(c, a, m) > 0) return m;
    }
    return std::nullopt;
  }

  // What splitting the side in p would do.
  bool look_at_split(Side s, LatticePoint p, Prospect& out) {
    out.p = p;
    mesh_.find_cavity(triangle_of(s), p, s, out.cavity);
    for (Cavity::Rim& r : out.cavity.rim) {
      if (look_ahead(r, out.p).doubled_area <= 0) return false;
    }
    out.flaws = flaws_of_split(s, p, out.cavity, std::numeric_limits<int>::max());
    sum_up(out);
    return true;
  }

  // How many bad triangles and encroached edges there would be after the split of s in p if it had
  // this cavity; `limit` for more and where it cannot have it.
  int flaws_of_split(Side s, LatticePoint p, const Cavity& cavity, int limit) const {
    const auto [a, b] = mesh_.ends(s);
    int flaws = 0;
    for (const Cavity::Rim& r : cavity.rim) {
      const LatticePoint from = at(r.a), to = at(r.b);
      const Shape shape = shape_of(from, to, p, limits_);
      flaws += shape.is_bad() ? 1 : 0;
      flaws += r.is_outline() && diametral_dot(from, to, p) < 0 ? 1 : 0;
      flaws += r.b == a && diametral_dot(to, p, from) < 0 ? 1 : 0;
      flaws += r.a == b && diametral_dot(p, from, to) < 0 ? 1 : 0;
      if (shape.doubled_area <= 0 || flaws >= limit) return limit;
    }
    return flaws;
  }

  bool split_side(Side s) {
    const auto [ia, ib] = mesh_.ends(s);
    const LatticePoint a = at(ia), b = at(ib), c = at(mesh_.apex(s));
    if (distance2(a, b) < 4 * kShortestEdge * kShortestEdge) return false;
    const std::uint32_t segment = mesh_.beyond(s) ^ kOutline;
    const bool has_shells = outline_.has_shells(segment);
    bool is_found = false;
    std::optional<LatticePoint> better;
    int fewest = 0;
    for (std::size_t k = 0; k < (has_shells ? 1 : kSplits.size()); ++k) {
      const double fraction =
          has_shells ? outline_.shell_fraction(segment, a, b, mesh_.points) : kSplits[k];
      const std::optional<LatticePoint> p = split_point(a, b, c, fraction);
      if (!p) continue;
      if (!is_found) {
        is_found = look_at_split(s, *p, best_);
        fewest = best_.flaws;
      } else if (const int flaws = flaws_of_split(s, *p, best_.cavity, fewest); flaws < fewest) {
        // The places' cavities are nearly the same: judging by the first one's will do.
        fewest = flaws, better = p;
      }
      if (is_found && fewest == 0) break;
    }
    if (!is_found) return false;
    if (better && look_at_split(s, *better, trial_) && trial_.growth < best_.growth)
      std::swap(best_, trial_);
    if (!insert(best_, {static_cast<std::int32_t>(segment)}, s)) return false;
    for (const std::uint32_t t : fresh_) {
      for (std::uint32_t i = 0; i < 3; ++i)
        look_at_side(side_number(t, i));
    }
    return true;
  }

  bool insert(const Prospect& prospect, VertexOrigin origin, Side split) {
    if (!mesh_.fill_cavity(prospect.cavity, prospect.p, split, fresh_)) return false;
    origins_.push_back(origin);
    for (std::size_t k = 0; k < fresh_.size(); ++k)
      queue(fresh_[k], prospect.cavity.rim[k].is_bad, prospect.cavity.rim[k].shortest2);
    return true;
  }

  // ---- inserting in the material ----

  void improve(std::uint32_t t) {
    const std::array<std::uint32_t, 3> v = mesh_.triangles[t].v;
    const Shape shape = shape_of(at(v[0]), at(v[1]), at(v[2]), limits_);
    const std::uint32_t shortest = shortest_side(v);
    if (!shape.is_large) {
      if (shape.shortest2 < kShortestEdge * kShortestEdge) {
        ++out_.bad_at_lattice_step;
        return give_up(t);
      }
      if (const std::uint32_t corner = across_small_angle(v, shortest);
          corner != RefinementOutline::kNoCorner) {
        // Miller, Pav and Walkington: shortening this edge would go on for ever. Where the input
        // angle allows the wanted one, closer shells reach it.
        if (outline_.angle_deg(corner) < min_angle_deg_ + kLatticeAllowance_deg) return give_up(t);
        if (split_shells(t, corner)) return;
      }
    }
    const std::optional<LatticePoint> centre = circumcentre(v, shortest, shape.is_sharp);
    if (!centre || !mesh_.circumcircle_holds(t, *centre)) return;
    const Side in_the_way = find_in_the_way(t, *centre, best_);
    const bool is_found = find_better(t, v, shortest, shape, in_the_way);
    if (in_the_way == kNoSide || is_found) {
      insert(best_, {VertexOrigin::kFree}, kNoSide);
      return;
    }
    // A point that would encroach, or lies beyond the outline, splits an edge in its way instead.
    const std::uint32_t generation = mesh_.triangles[t].generation;
    if (split_side(in_the_way) && mesh_.triangles[t].generation == generation)
      queue(t, true, shape.shortest2);  // it may still be bad
  }

  // Other places may rid us of more bad triangles at once, or spare the outline: the first that
  // leaves fewer than there were, or the best of them. They keep the distance from other vertices
  // that the off-centre has by nature, the shortest edge's length, so that refinement ends as it
  // does without them. Puts the best one into best_; gives false if there is none.
  bool find_better(std::uint32_t t, const std::array<std::uint32_t, 3>& v, std::uint32_t shortest,
                   const Shape& shape, Side in_the_way) {
    int growth = in_the_way == kNoSide ? best_.growth : 0;
    bool is_found = false;
    const auto consider = [&](std::uint32_t side, Place place, double min_distance2) {
      const LatticePoint q = over(at(v[after(side)]), at(v[before(side)]), place);
      if (is_unwelcome_at(best_.cavity, q, min_distance2)) return;
      if (!is_welcome(t, q, min_distance2, trial_) || trial_.growth >= growth) return;
      growth = trial_.growth;
      is_found = true;
      std::swap(best_, trial_);
    };
    if (!shape.is_large) {
      const double shrink = 1 - std::min(0.4, kRounding / std::sqrt(shape.shortest2));
      for (const Place& place : places_) {
        if (growth < -1) break;
        consider(shortest, {place.along * shrink, place.away * shrink}, shape.shortest2);
      }
    } else if (in_the_way == kNoSide) {
      const double min_distance2 = 0.25 * even_side_ * even_side_;
      for (std::uint32_t i = 0; i < 3; ++i) {
        const double side2 = static_cast<double>(distance2(at(v[after(i)]), at(v[before(i)])));
        const double leg2 = std::max(even_side_ * even_side_, 0.49 * side2);
        consider(i, {0, std::sqrt(leg2 / side2 - 0.25)}, min_distance2);
        if ((mesh_.triangles[t].beyond[i] & kOutline) == 0) consider(i, {0, 0}, min_distance2);
      }
    }
    return is_found;
  }

  static LatticePoint over(LatticePoint p, LatticePoint q, Place place) {
    const double dx = static_cast<double>(q.x) - p.x, dy = static_cast<double>(q.y) - p.y;
    const double x = 0.5 * (static_cast<double>(q.x) + p.x),
                 y = 0.5 * (static_cast<double>(q.y) + p.y);
    return {rounded(x + (place.along * dx - place.away * dy)),
            rounded(y + (place.along * dy + place.away * dx))};
  }

  void give_up(std::uint32_t t) { mesh_.triangles[t].is_bad = 0; }

  std::uint32_t shortest_side(const std::array<std::uint32_t, 3>& v) const {
    const LatticePoint a = at(v[0]), b = at(v[1]), c = at(v[2]);
    const std::int64_t bc = distance2(b, c), ca = distance2(c, a), ab = distance2(a, b);
    return bc <= ca && bc <= ab ? 0 : ca <= ab ? 1 : 2;
  }

  // The corner, if the shortest edge joins two input segments that meet there under a small angle,
  // at the same distance from it; else none.
  std::uint32_t across_small_angle(const std::array<std::uint32_t, 3>& v,
                                   std::uint32_t shortest) const {
    const std::uint32_t p = v[after(shortest)], q = v[before(shortest)];
    const std::uint32_t corner = outline_.small_corner(origins_[p].segment, origins_[q].segment);
    if (corner == RefinementOutline::kNoCorner ||
        std::abs(distance(p, corner) - distance(q, corner)) > RefinementOutline::kSameShell)
      return RefinementOutline::kNoCorner;
    return corner;
  }

  // Splits the sides of a triangle that lie on segments from the corner and reach from one shell
  // to the next but one, so that shells follow in the ratio sqrt(2).
  bool split_shells(std::uint32_t t, std::uint32_t corner) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      const Side s = side_number(t, i);
      if ((mesh_.beyond(s) & kOutline) == 0) continue;
      const auto [a, b] = mesh_.ends(s);
      const double da = distance(a, corner), db = distance(b, corner);
      if (std::min(da, db) > 0 && std::max(da, db) > 1.5 * std::min(da, db) && split_side(s))
        return true;
    }
    return false;
  }

  // Circumcentre, or where that is nearer the off-centre on the same bisector, on the lattice.
  std::optional<LatticePoint> circumcentre(const std::array<std::uint32_t, 3>& v,
                                           std::uint32_t shortest, bool off_centre) const {
    const LatticePoint p = at(v[after(shortest)]), q = at(v[before(shortest)]), r = at(v[shortest]);
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
    return LatticePoint{rounded(x), rounded(y)};
  }

  Refined finish() {
    if (out_.outcome == RefinementOutcome::kRefined && out_.bad_at_lattice_step > 0)
      out_.outcome = RefinementOutcome::kLatticeTooCoarse;
    out_.angle_deg = min_angle_deg_;
    out_.mesh.vertices = mesh_.points;
    out_.origins = origins_;
    out_.segments = outline_.segments();
    out_.mesh.triangles.reserve(mesh_.triangles.size());
    for (const WorkingTriangle& t : mesh_.triangles)
      out_.mesh.triangles.push_back(t.v);
    return std::move(out_);
  }

  RefinementMesh& mesh_;
  RefinementOutline& outline_;
  RefinementQueue& bad_;
  std::vector<VertexOrigin>& origins_;
  std::vector<EncroachedTicket>& encroached_;
  std::vector<std::uint32_t>& fresh_;
  Prospect &best_, &trial_;
  double min_angle_deg_;
  std::uint32_t max_vertices_;
  std::array<Place, kTurns_deg.size()> places_{};
  double off_centre_ = 0, even_side_ = 0;
  Limits limits_{};
  Refined out_;
};

// Far more vertices than refinement to a safe angle was ever seen to need.
std::uint32_t ample_budget(const Triangulation& from, const Lattice& lattice,
                           const RefinementOptions& options) {
  const double step2 = lattice.step_mm() * lattice.step_mm();
  const double doubled_area_bound = std::max(2 * options.max_area_mm2 / step2, 1.0);
  const double vertices = 10'000 + 200.0 * static_cast<double>(from.mesh.vertices.size()) +
                          20.0 * static_cast<double>(doubled_area(from.mesh)) / doubled_area_bound;
  return static_cast<std::uint32_t>(std::min(1e8, vertices));
}

}  // namespace

bool is_angle_below(LatticePoint a, LatticePoint b, LatticePoint c, double sine2) {
  return shape_of(a, b, c, {sine2, 0}).is_sharp;
}

Refined refine(const Triangulation& from, const Lattice& lattice,
               const RefinementOptions& options) {
  thread_local Workspace memory;
  const auto refine_to = [&](double angle_deg, std::uint32_t max_vertices) {
    const RefinementOptions attempt{angle_deg, options.max_area_mm2, max_vertices};
    return Refiner(from, lattice, attempt, memory).run();
  };
  const double safe_deg = std::min(options.min_angle_deg, kSafeAngle_deg);
  Refined best =
      refine_to(safe_deg, options.max_vertices != 0 ? options.max_vertices
                                                    : ample_budget(from, lattice, options));
  if (safe_deg == options.min_angle_deg || best.outcome == RefinementOutcome::kVertexBudget)
    return best;

  // Above, whether it ends depends on the outline. Halves the gap until it is small.
  const auto budget = options.max_vertices != 0
                          ? options.max_vertices
                          : static_cast<std::uint32_t>(kSteepBudget * best.mesh.vertices.size());
  double unreached_deg = options.min_angle_deg;
  for (double angle_deg = unreached_deg; unreached_deg - best.angle_deg > kAngleStep_deg;
       angle_deg = 0.5 * (best.angle_deg + unreached_deg)) {
    Refined steeper = refine_to(angle_deg, budget);
    if (steeper.outcome == RefinementOutcome::kVertexBudget ||
        steeper.bad_at_lattice_step > best.bad_at_lattice_step) {
      unreached_deg = angle_deg;
    } else {
      best = std::move(steeper);
      if (angle_deg == options.min_angle_deg) return best;
    }
  }
  best.outcome = RefinementOutcome::kAngleNotReached;
  return best;
}

}  // namespace trocar::pipeline
