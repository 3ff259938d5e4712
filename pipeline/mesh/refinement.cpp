// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/mesh/refinement.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "formats/geometry/canonical_rotation.h"
#include "formats/geometry/split_places.h"
#include "formats/geometry/steiner_places.h"
#include "formats/geometry/triangle_shape.h"
#include "pipeline/mesh/fill_nodes.h"
#include "pipeline/mesh/insertion_look.h"
#include "pipeline/mesh/refinement_mesh.h"
#include "pipeline/mesh/refinement_outline.h"
#include "pipeline/mesh/refinement_queue.h"
#include "pipeline/mesh/shared_edges.h"
#include "pipeline/mesh/triangle_bounds.h"

namespace trocar::pipeline {
namespace {

// In lattice steps. No edge is split into shorter halves, and no triangle with a shorter edge is
// improved: rounding to the lattice would decide the angles.
constexpr std::int64_t kShortestEdge = 4;

// Places for a split of an edge of the outline, as fractions of it, the preferred one first.
constexpr std::array kSplits = {0.5, 0.42, 0.58, 0.34, 0.66};
// For a triangle that is too large: a new point over one of its edges is placed to make an
// equilateral triangle. Its edges have this share of the largest length allowed; other vertices
// are at least half an edge away.
constexpr double kEvenEdge = 0.9;
// Where the largest area asks for at least so many triangles for each vertex of the input, a
// lattice fills the inside. In lengths of its edges: outline edges are split into parts of this
// length, and its points are so far away from other vertices. Below so many steps it is not fine
// enough.
constexpr double kLeastFilled = 4, kFillPart = 0.85, kFillAway = 0.7, kLeastFillEdge_steps = 32;
// Where to look for points over the shortest edge, as angles from the off-centre.
constexpr std::array kAside_deg = {30.0, -30.0, 60.0, -60.0};

// Edges have ids below 2^31.
constexpr std::uint32_t kMostVertices = 100'000'000;
// For angles above kSafeAngle_deg: the vertex budget as a multiple of the vertices of the mesh
// refined to that angle, and how close the search comes to the largest angle that can be reached.
constexpr std::size_t kSteepBudget = 4;
constexpr double kAngleStep_deg = 0.25;

struct EncroachedTicket {
  EdgeId edge;
  std::uint32_t generation;
};

// Memory that is kept from slice to slice: fresh pages took a fifth of the time.
constexpr std::size_t kMostKeptTriangles = 1 << 17;  // 8 MB
struct Workspace {
  RefinementMesh mesh;
  RefinementOutline outline;
  RefinementQueue bad;
  std::vector<VertexOrigin> origins;
  std::vector<EncroachedTicket> encroached, long_edges;
  std::vector<FillNode> nodes;
  Candidate best, trial;
  SharedEdges shared;
  Candidate best_beyond, trial_beyond;
};

class Refiner {
  using Of = InsertionLook::Of;
  using Places = InsertionLook::Places;
  using Rim = InsertionCavity::Rim;
  using Tally = InsertionLook::Tally;

 public:
  Refiner(const Triangulation& from, const Lattice& lattice, const RefinementOptions& options,
          Workspace& memory)
      : from_(from),
        mesh_(memory.mesh),
        outline_(memory.outline),
        bad_(memory.bad),
        origins_(memory.origins),
        encroached_(memory.encroached),
        long_edges_(memory.long_edges),
        nodes_(memory.nodes),
        best_(memory.best),
        trial_(memory.trial),
        shared_(memory.shared),
        best_beyond_(memory.best_beyond),
        trial_beyond_(memory.trial_beyond),
        min_angle_deg_(options.min_angle_deg),
        max_area_mm2_(options.max_area_mm2),
        max_vertices_(options.max_vertices),
        keep_area_(options.keep_area),
        has_shared_(options.shared_borders),
        farthest2_(options.farthest_steps * options.farthest_steps),
        bounds_(lattice, options),
        look_(memory.mesh, bounds_),
        circle_(options.min_angle_deg * std::numbers::pi / 180) {
    for (std::size_t k = 0; k < aside_.size(); ++k) {
      const double angle = kAside_deg[k] * std::numbers::pi / 180;
      aside_[k] = circle_.at(std::sin(angle), std::cos(angle));
    }
    outline_.clear(from.mesh.vertices.size());
    mesh_.assign(from, [&](std::uint32_t a, std::uint32_t b) { return outline_.add(a, b); });
    outline_.close(mesh_.points);
    if (has_shared_) {
      outline_.find_twins(mesh_.points);
      shared_.clear();
      for (std::uint32_t t = 0; t < mesh_.triangles.size(); ++t)
        shared_.note(mesh_, t);
    }
    if (keep_area_ || has_shared_) outline_.find_loops();
    if (keep_area_) outline_.find_room(mesh_.points);
    origins_.reserve(mesh_.points.capacity());
    origins_.assign(mesh_.points.size(), {VertexOrigin::kCorner});
    encroached_.clear();
    bad_.clear();
  }

  Refined run() {
    for (std::uint32_t t = 0; t < mesh_.triangles.size(); ++t) {
      note_encroached_edges(t);
      const std::array<std::uint32_t, 3>& v = mesh_.triangles[t].v;
      const TriangleShape shape = bounds_.shape(at(v[0]), at(v[1]), at(v[2]));
      queue(t, shape.is_bad(), shape.shortest2);
    }
    fill_large();
    while (true) {
      split_encroached();
      RefinementQueue::Ticket bad{};
      const bool is_any = bad_.pop(bad, [&](const RefinementQueue::Ticket& ticket) {
        return mesh_.triangles[ticket.triangle].generation == ticket.generation;
      });
      if (mesh_.points.size() >= max_vertices_ && (is_any || !encroached_.empty())) {
        out_.outcome = RefinementOutcome::kVertexBudget;
        break;
      }
      if (!is_any) break;
      improve(bad.triangle);
    }
    return finish();
  }

 private:
  LatticePoint at(std::uint32_t v) const { return mesh_.points[v]; }
  double distance(std::uint32_t a, std::uint32_t b) const { return edge_length(at(a), at(b)); }

  // ---- bad triangles and encroached edges ----

  bool is_encroached(std::uint32_t segment, std::uint32_t a, std::uint32_t b,
                     std::uint32_t apex) const {
    if (!encroaches(at(a), at(b), at(apex))) return false;
    // Across a small input angle, a vertex on the same shell encroaches only by rounding.
    const std::uint32_t corner =
        outline_.small_corner(static_cast<std::int32_t>(segment), origins_[apex].segment);
    if (corner == RefinementOutline::kNoCorner) return true;
    const double d = distance(apex, corner);
    return std::abs(d - distance(a, corner)) > kSameShell_steps &&
           std::abs(d - distance(b, corner)) > kSameShell_steps;
  }

  // Notes edges on the outline that are encroached upon.
  [[gnu::always_inline]] void note_encroached_edges(std::uint32_t t) {
    const WorkingTriangle& tri = mesh_.triangles[t];
    if (((tri.beyond[0] | tri.beyond[1] | tri.beyond[2]) & kOutline) == 0) return;
    for (std::uint32_t i = 0; i < 3; ++i) {
      if ((tri.beyond[i] & kOutline) != 0 &&
          is_encroached(tri.beyond[i] ^ kOutline, tri.v[i], tri.v[next_corner(i)],
                        tri.v[previous_corner(i)]))
        encroached_.push_back({edge_id(t, i), tri.generation});
    }
  }

  double shortest2(const WorkingTriangle& t) const {
    const LatticePoint a = at(t.v[0]), b = at(t.v[1]), c = at(t.v[2]);
    return static_cast<double>(std::min({distance2(a, b), distance2(b, c), distance2(c, a)}));
  }
  void queue(std::uint32_t t, bool is_bad, double shortest2) {
    mesh_.triangles[t].is_bad = is_bad ? 1 : 0;
    if (is_bad) bad_.push(shortest2, {t, mesh_.triangles[t].generation});
  }

  // Does a point within the circumcircle of t lie in the material, encroach upon no edge and keep
  // its distance from other vertices?
  bool is_allowed(std::uint32_t t, LatticePoint p, double min_distance2, Candidate& out) {
    if (!mesh_.circumcircle_contains(t, p)) return false;
    out.p = p;
    mesh_.find_cavity(t, p, out.cavity);
    const Tally seen = look_.ahead<Of::kFree>(out, min_distance2);
    return !(seen.is_turned | seen.is_near | seen.is_blocked);
  }

  // The longest edge of the outline that a point within the circumcircle of t encroaches upon or
  // lies beyond; kNoEdge if there is none.
  EdgeId find_in_the_way(std::uint32_t t, LatticePoint p, Candidate& out) {
    out.p = p;
    mesh_.find_cavity(t, p, out.cavity);
    const Tally seen = look_.ahead<Of::kFree>(out, 0);
    if (seen.is_turned) out.growth = kImpossible;
    if (!seen.is_turned && !seen.is_blocked) return kNoEdge;
    EdgeId longest = kNoEdge;
    std::int64_t length2 = 0;
    InsertionLook::for_each_edge(out.cavity, &RimQuad::is_blocked, [&](std::size_t k) {
      const Rim& r = out.cavity.rim()[k];
      const std::int64_t ab2 = distance2(at(r.a), at(r.b));
      if (ab2 > length2) length2 = ab2, longest = r.inside;
    });
    return longest;
  }

  // ---- splitting edges of the outline ----

  void split_encroached() {
    while (!encroached_.empty() && mesh_.points.size() < max_vertices_) {
      const EncroachedTicket ticket = encroached_.back();
      encroached_.pop_back();
      if (mesh_.triangles[triangle_of(ticket.edge)].generation == ticket.generation)
        split_edge(ticket.edge);
    }
  }

  // The mesh with the edge split at p.
  bool look_at_split(EdgeId s, LatticePoint p, Candidate& out) {
    out.p = p;
    mesh_.find_split_cavity(s, p, out.cavity);
    return !look_.ahead<Of::kSplit>(out, 0).is_turned;
  }

  // An input segment, and how far its splits may lie from it: each is rounded inwards, so repeated
  // splits move away.
  struct Segment {
    LatticePoint from, to;
    double farthest_area2;
    bool is_far(LatticePoint p) const {
      const auto area = static_cast<double>(orient2d(from, to, p));
      return area * area >= farthest_area2;
    }
  };
  Segment segment_at(std::uint32_t segment) const {
    const Refined::Segment& input = outline_.segments()[segment];
    const LatticePoint from = at(input.from), to = at(input.to);
    return {from, to, farthest2_ * static_cast<double>(distance2(from, to))};
  }

  // Where to split the edge ab of the triangle abc (t) of the mesh at this fraction; false if
  // nowhere.
  bool find_split_place(std::uint32_t t, std::uint32_t segment, const Segment& input,
                        const TriangleCorners& v, double fraction, LatticePoint& out) {
    const auto [a, b, c] = v;
    const std::optional<LatticePoint> inside = split_near(a, b, c, fraction);
    if (!keep_area_ || (inside && orient2d(a, b, *inside) == 0) || !outline_.has_room(segment)) {
      if (!inside) return false;
      out = *inside;
      return !input.is_far(out);
    }
    const std::optional<LatticePoint> outside = split_outside(t, input, a, b, fraction);
    if (!inside && !outside) return false;
    // Either, where both are allowed, so that the loop keeps its area: which one cannot be
    // predicted.
    const LatticePoint p = inside ? *inside : *outside, q = outside ? *outside : p;
    const std::int64_t lost = outline_.lost_of_loop(segment),
                       lost_at_p = std::abs(lost + orient2d(a, b, p)),
                       lost_at_q = std::abs(lost + orient2d(a, b, q));
    const bool p_is_far = input.is_far(p), q_is_far = input.is_far(q);
    const auto takes_q =
        static_cast<std::int32_t>(p_is_far | (!q_is_far & (lost_at_q < lost_at_p)));
    out = {p.x + takes_q * (q.x - p.x), p.y + takes_q * (q.y - p.y)};
    return !(p_is_far & q_is_far);
  }

  // Of the lattice points around the one at this fraction from a to b: the nearest that lies on the
  // void's side of the edge, no more than a step from the input segment, and in the circumcircle of
  // the triangle, so that the mesh stays Delaunay.
  std::optional<LatticePoint> split_outside(std::uint32_t t, const Segment& input, LatticePoint a,
                                            LatticePoint b, double fraction) const {
    const LatticePoint from = input.from, to = input.to;
    const double farthest = edge_length(from, to);
    const double x = fraction * (static_cast<double>(b.x) - a.x),
                 y = fraction * (static_cast<double>(b.y) - a.y);
    const double low_x = floor_of(x), low_y = floor_of(y);
    const LatticePoint low{a.x + static_cast<std::int32_t>(low_x),
                           a.y + static_cast<std::int32_t>(low_y)};
    // By steps right and up from there, no step where the place is on the lattice already. Which of
    // the four are allowed cannot be predicted.
    const std::array<std::int32_t, 2> right{0, x > low_x ? 1 : 0}, up{0, y > low_y ? 1 : 0};
    const std::int64_t dx = std::int64_t{b.x} - a.x, dy = std::int64_t{b.y} - a.y,
                       input_dx = std::int64_t{to.x} - from.x,
                       input_dy = std::int64_t{to.y} - from.y;
    const std::int64_t side = orient2d(a, b, low), input_side = orient2d(from, to, low);
    const std::int64_t ax = std::int64_t{a.x} - low.x, ay = std::int64_t{a.y} - low.y,
                       bx = std::int64_t{b.x} - low.x, by = std::int64_t{b.y} - low.y;
    std::array<LatticePoint, 4> places;
    std::array<double, 4> far{};
    constexpr std::array kForbidden{1e300, 0.0};
    for (std::size_t k = 0; k < 4; ++k) {
      const std::int32_t i = right[k / 2], j = up[k % 2];
      const double off_x = low_x + i - x, off_y = low_y + j - y;
      const bool is_allowed =
          (side + j * dx - i * dy < 0) & ((ax - i) * (bx - i) + (ay - j) * (by - j) < 0) &
          (static_cast<double>(input_side + j * input_dx - i * input_dy) >= -farthest);
      places[k] = {low.x + i, low.y + j};
      far[k] = off_x * off_x + off_y * off_y + kForbidden[is_allowed ? 1 : 0];
    }
    while (true) {
      const std::size_t low_least = far[1] < far[0] ? 1 : 0, high_least = far[3] < far[2] ? 3 : 2;
      const std::size_t is_high = far[high_least] < far[low_least] ? 1 : 0,
                        least = low_least + is_high * (high_least - low_least);
      if (far[least] >= kForbidden[0]) return std::nullopt;
      if (mesh_.circumcircle_contains(t, places[least])) return places[least];
      far[least] = kForbidden[0];
    }
  }
  // Of a number within the lattice's bounds. (std::floor would be a function call.)
  static double floor_of(double x) {
    const auto whole = static_cast<std::int32_t>(x);
    return whole - static_cast<std::int32_t>(whole > x);
  }

  // At this fraction, or at the best place if it is 0.
  bool split_edge(EdgeId s, double wanted = 0) {
    if (has_shared_) {
      if (const EdgeId beyond = shared_.beyond(s, mesh_, outline_); beyond != kNoEdge)
        return split_shared_edge(s, beyond);
    }
    const auto [ia, ib] = mesh_.ends(s);
    const LatticePoint a = at(ia), b = at(ib), c = at(mesh_.apex(s));
    if (distance2(a, b) < 4 * kShortestEdge * kShortestEdge) return false;
    const std::uint32_t segment = mesh_.beyond(s) ^ kOutline;
    const bool has_shells = outline_.has_shells(segment);
    const Segment input = segment_at(segment);
    const auto find_place = [&](double fraction, LatticePoint& p) {
      return find_split_place(triangle_of(s), segment, input, {a, b, c}, fraction, p);
    };
    const auto look_at = [&](double fraction) {
      LatticePoint p;
      return find_place(fraction, p) && look_at_split(s, p, best_);
    };
    if (has_shells || wanted > 0) {
      if (!look_at(wanted > 0 && !has_shells
                       ? wanted
                       : outline_.shell_fraction(segment, a, b, mesh_.points)))
        return false;
    } else {
      std::size_t k = 0;
      while (!look_at(kSplits[k])) {
        if (++k == kSplits.size()) return false;
      }
      if (best_.flaws > 0) {
        Places places;
        Four is_place{};
        places.fill(best_.p);
        for (std::size_t i = 0; i < 4; ++i)
          is_place[i] =
              -static_cast<std::int32_t>(find_place(kSplits[i + 1], places[i]) & (i >= k));
        const InsertionLook::Fewest best =
            InsertionLook::fewest_of(look_.flaws_of<Of::kSplit>(places, best_.cavity), is_place);
        if (best.flaws < best_.flaws && look_at_split(s, places[best.place], trial_) &&
            trial_.growth < best_.growth)
          std::swap(best_, trial_);
      }
    }
    if (!insert(best_, {static_cast<std::int32_t>(segment)}, s)) return false;
    if (keep_area_) outline_.lost_of_loop(segment) += orient2d(a, b, best_.p);
    note_encroached_edges(best_);
    return true;
  }
  // After its insertion.
  [[gnu::always_inline]] void note_encroached_edges(const Candidate& split) {
    InsertionLook::for_each_edge(split.cavity, &RimQuad::is_blocked, [&](std::size_t k) {
      note_encroached_edges(split.cavity.fresh_triangle(k));
    });
  }

  // ---- splitting edges that two regions share ----

  // Both meshes with the shared edge split at p.
  bool look_at_shared_split(EdgeId s, EdgeId t, LatticePoint p, Candidate& here, Candidate& there) {
    const auto is_open_loop = [](const InsertionCavity& c) {
      return c.rim().size() == c.size() + 1;
    };
    return may_split_either_way(mesh_, s, p) && may_split_either_way(mesh_, t, p) &&
           look_at_split(s, p, here) && look_at_split(t, p, there) && is_open_loop(here.cavity) &&
           is_open_loop(there.cavity);
  }

  // One point for both sides, or none. (The attributes here and below leave the code for a slice
  // without shared edges as it is without this function: it was slower by 2 %.)
  [[gnu::noinline]] bool split_shared_edge(EdgeId s, EdgeId t) {
    const auto [ia, ib] = mesh_.ends(s);
    const LatticePoint a = at(ia), b = at(ib), c = at(mesh_.apex(s)), d = at(mesh_.apex(t));
    if (distance2(a, b) < 4 * kShortestEdge * kShortestEdge) return false;
    const std::uint32_t segment = mesh_.beyond(s) ^ kOutline, twin = mesh_.beyond(t) ^ kOutline;
    const bool has_shells = outline_.has_shells(segment);
    const Segment input = segment_at(segment);
    bool is_found = false;
    std::optional<LatticePoint> better;
    int fewest = 0;
    for (std::size_t k = 0; k < (has_shells ? 1 : kSplits.size()); ++k) {
      const double fraction =
          has_shells ? outline_.shell_fraction(segment, a, b, mesh_.points) : kSplits[k];
      for (const std::optional<LatticePoint>& p :
           shared_places(a, b, c, d, fraction, outline_.lost_of_loop(segment))) {
        if (!p || input.is_far(*p)) continue;
        if (!is_found) {
          is_found = look_at_shared_split(s, t, *p, best_, best_beyond_);
          fewest = best_.flaws + best_beyond_.flaws;
          if (is_found) break;
        } else {
          const Places place{*p, *p, *p, *p};
          const int flaws = look_.flaws_of<Of::kSplit>(place, best_.cavity)[0] +
                            look_.flaws_of<Of::kSplit>(place, best_beyond_.cavity)[0];
          if (flaws < fewest) fewest = flaws, better = p;
        }
      }
      if (is_found && fewest == 0) break;
    }
    if (!is_found) return false;
    if (better && look_at_shared_split(s, t, *better, trial_, trial_beyond_) &&
        trial_.growth + trial_beyond_.growth < best_.growth + best_beyond_.growth) {
      std::swap(best_, trial_);
      std::swap(best_beyond_, trial_beyond_);
    }
    const auto v = static_cast<std::uint32_t>(mesh_.points.size());
    insert(best_, {static_cast<std::int32_t>(segment)}, s);
    note_encroached_edges(best_);
    insert(best_beyond_, {static_cast<std::int32_t>(twin)}, t);
    note_encroached_edges(best_beyond_);
    shared_.add_copies(v, v + 1);
    outline_.lost_of_loop(segment) += orient2d(a, b, best_.p);
    outline_.lost_of_loop(twin) -= orient2d(a, b, best_.p);
    return true;
  }

  [[gnu::always_inline]] bool insert(Candidate& candidate, VertexOrigin origin, EdgeId split) {
    if (!mesh_.fill_cavity(candidate.cavity, candidate.p, split)) return false;
    origins_.push_back(origin);
    if (has_shared_) {
      for (std::size_t k = 0; k < candidate.cavity.rim().size(); ++k)
        shared_.note(mesh_, candidate.cavity.fresh_triangle(k));
    }
    InsertionLook::for_each_edge(candidate.cavity, &RimQuad::is_bad, [&](std::size_t k) {
      const std::uint32_t t = candidate.cavity.fresh_triangle(k);
      queue(t, true, shortest2(mesh_.triangles[t]));
    });
    return true;
  }

  // ---- inserting in the material ----

  void improve(std::uint32_t t) {
    const std::array<std::uint32_t, 3> v = mesh_.triangles[t].v;
    const TriangleShape shape = bounds_.shape(at(v[0]), at(v[1]), at(v[2]));
    const std::uint32_t shortest = shortest_edge({at(v[0]), at(v[1]), at(v[2])}).edge;
    if (!shape.is_large) {
      if (shape.shortest2 < kShortestEdge * kShortestEdge) return leave(t);
      if (const std::uint32_t corner = across_small_angle(v, shortest);
          corner != RefinementOutline::kNoCorner) {
        // Miller, Pav and Walkington: shortening this edge would not end. Where the input angle
        // allows the wanted one, closer shells reach it.
        if (outline_.angle_deg(corner) < min_angle_deg_ + kLatticeAllowance_deg) {
          mesh_.triangles[t].is_bad = 0;
          return;
        }
        if (split_shells(t, corner)) return;
      }
    }
    const double most_away =
        shape.is_sharp ? circle_.off_centre() * rounding_allowance(std::sqrt(shape.shortest2))
                       : std::numeric_limits<double>::infinity();
    const LatticePoint centre = centre_over(at(v[shortest]), at(v[next_corner(shortest)]),
                                            at(v[previous_corner(shortest)]), most_away);
    if (!mesh_.circumcircle_contains(t, centre)) return leave(t);
    const EdgeId in_the_way = find_in_the_way(t, centre, best_);
    const bool is_found = find_better(t, v, shortest, shape, in_the_way);
    const std::uint32_t generation = mesh_.triangles[t].generation;
    if (is_found || in_the_way == kNoEdge) {
      if (best_.growth == kImpossible || !insert(best_, {VertexOrigin::kFree}, kNoEdge)) leave(t);
    } else if (!split_edge(in_the_way)) {
      // A point that would encroach, or lies beyond the outline, splits an edge in its way instead.
      leave(t);
    } else if (mesh_.triangles[t].generation == generation) {
      queue(t, true, shape.shortest2);  // it still exists: try it again later
    }
  }

  // Leaves a bad triangle as it is: no lattice point improves it.
  void leave(std::uint32_t t) {
    mesh_.triangles[t].is_bad = 0;
    ++out_.bad_at_lattice_step;
  }

  // Tries other places, which may remove more bad triangles at once, or leave the outline as it is.
  // Puts the first that leaves two fewer bad triangles, or else the best, into best_; false if none
  // is better than best_.
  bool find_better(std::uint32_t t, const std::array<std::uint32_t, 3>& v, std::uint32_t shortest,
                   const TriangleShape& shape, EdgeId in_the_way) {
    if (shape.is_large) return in_the_way == kNoEdge && find_more_even(t, v);
    int growth = in_the_way == kNoEdge ? best_.growth : 0;
    bool is_found = false;
    if (growth < -1) return false;
    const LatticePoint a = at(v[shortest]), b = at(v[next_corner(shortest)]);
    const double allowance = rounding_allowance(std::sqrt(shape.shortest2));
    Places places;
    for (std::size_t k = 0; k < 4; ++k)
      places[k] = point_over(a, b, {aside_[k].along * allowance, aside_[k].away * allowance});
    // Like the off-centre, they keep the shortest edge's length as a distance from other vertices,
    // so that refinement ends as it does without them.
    unsigned left = bits_of(look_.allowed_by(best_.cavity, places, shape.shortest2));
    while (left != 0) {
      const auto k = static_cast<unsigned>(std::countr_zero(left));
      left &= left - 1;
      if (!is_allowed(t, places[k], shape.shortest2, trial_) || trial_.growth >= growth) continue;
      growth = trial_.growth;
      is_found = true;
      std::swap(best_, trial_);
      if (growth < -1) break;
      left = bits_of(look_.allowed_by(best_.cavity, places, shape.shortest2)) & (14U << k);
    }
    return is_found;
  }

  // The same for a triangle that is too large: the apexes of equilateral triangles over its edges,
  // and the edges' midpoints.
  bool find_more_even(std::uint32_t t, const std::array<std::uint32_t, 3>& v) {
    const double most = bounds_.largest_doubled_area(at(v[0]), at(v[1]), at(v[2]));
    const double even_edge = kEvenEdge * std::sqrt(2 / std::numbers::sqrt3 * most);
    const double even2 = even_edge * even_edge, min_distance2 = 0.25 * even2;
    // The first and the second edge; the third.
    Places two_edges, one_edge;
    Four is_in_two{-1, -1, -1, -1}, is_in_one{-1, -1, 0, 0};
    for (std::uint32_t i = 0; i < 3; ++i) {
      const LatticePoint a = at(v[i]), b = at(v[next_corner(i)]);
      const auto edge2 = static_cast<double>(distance2(a, b));
      const double leg2 = std::max(even2, 0.49 * edge2);
      const LatticePoint apex = point_over(a, b, {0, std::sqrt(leg2 / edge2 - 0.25)}),
                         middle = point_over(a, b, {0, 0});
      const std::int32_t is_inside = ~static_cast<std::int32_t>(mesh_.triangles[t].beyond[i]) >> 31;
      const std::size_t k = 2 * (i & 1);
      (i < 2 ? two_edges : one_edge)[k] = apex;
      (i < 2 ? two_edges : one_edge)[k + 1] = middle;
      (i < 2 ? is_in_two : is_in_one)[k + 1] = is_inside;
    }
    one_edge[2] = one_edge[3] = one_edge[0];
    const auto fewest = [&](const Places& places, Four is_place) {
      return InsertionLook::fewest_of(
          look_.flaws_of<Of::kFree>(places, best_.cavity),
          is_place & look_.allowed_by(best_.cavity, places, min_distance2));
    };
    const InsertionLook::Fewest of_two = fewest(two_edges, is_in_two),
                                of_one = fewest(one_edge, is_in_one);
    const bool is_third = of_one.flaws < of_two.flaws;
    if (std::min(of_one.flaws, of_two.flaws) >= best_.flaws ||
        !is_allowed(t, is_third ? one_edge[of_one.place] : two_edges[of_two.place], min_distance2,
                    trial_) ||
        trial_.growth >= best_.growth)
      return false;
    std::swap(best_, trial_);
    return true;
  }

  // The corner, if the shortest edge joins two input segments that meet there under a small angle,
  // at the same distance from it; else none.
  std::uint32_t across_small_angle(const std::array<std::uint32_t, 3>& v,
                                   std::uint32_t shortest) const {
    const std::uint32_t p = v[shortest], q = v[next_corner(shortest)];
    const std::uint32_t corner = outline_.small_corner(origins_[p].segment, origins_[q].segment);
    if (corner == RefinementOutline::kNoCorner ||
        std::abs(distance(p, corner) - distance(q, corner)) > kSameShell_steps)
      return RefinementOutline::kNoCorner;
    return corner;
  }

  // Splits an edge of the triangle that lies on a segment from the corner and spans more than one
  // shell, so that shells follow in the ratio sqrt(2).
  bool split_shells(std::uint32_t t, std::uint32_t corner) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      const EdgeId s = edge_id(t, i);
      if ((mesh_.beyond(s) & kOutline) == 0) continue;
      const auto [a, b] = mesh_.ends(s);
      const double da = distance(a, corner), db = distance(b, corner);
      if (std::min(da, db) > 0 && std::max(da, db) > 1.5 * std::min(da, db) && split_edge(s))
        return true;
    }
    return false;
  }

  // ---- filling large triangles ----

  // Where the largest area asks for many triangles, most of them can be those of a lattice of
  // equilateral triangles of that area: nothing has to be searched for inside it.
  void fill_large() {
    if (bounds_.has_area_at() || from_.mesh.triangles.empty()) return;
    const double wanted =
        static_cast<double>(doubled_area(from_.mesh)) / bounds_.everywhere().doubled_area;
    const double edge = fill_edge(bounds_.everywhere().doubled_area);
    if (edge < kLeastFillEdge_steps ||
        wanted < kLeastFilled * static_cast<double>(from_.mesh.vertices.size()))
      return;
    split_encroached();
    split_long(kFillPart * edge);
    split_encroached();
    list_fill_nodes(mesh_, bounds_.everywhere().doubled_area, wanted, nodes_);
    const double away2 = edge * edge * kFillAway * kFillAway;
    for (const FillNode& node : nodes_) {
      if (mesh_.points.size() >= max_vertices_) return;
      const std::uint32_t t = mesh_.find(node.triangle, node.p);
      if (t != RefinementMesh::kNone && is_allowed(t, node.p, away2, trial_) &&
          trial_.cavity.bad_triangles() > 0)
        insert(trial_, {VertexOrigin::kFree}, kNoEdge);
    }
  }

  // Splits edges of the outline into equal parts of about this length.
  void split_long(double part) {
    std::vector<EncroachedTicket>& edges = long_edges_;
    edges.clear();
    const auto parts = [&](std::uint32_t a, std::uint32_t b) {
      return std::floor(edge_length(at(a), at(b)) / part + 0.5);
    };
    const auto note = [&](std::uint32_t t) {
      const WorkingTriangle& tri = mesh_.triangles[t];
      for (std::uint32_t i = 0; i < 3; ++i) {
        if ((tri.beyond[i] & kOutline) == 0 || parts(tri.v[i], tri.v[next_corner(i)]) < 2) continue;
        const std::uint32_t segment = tri.beyond[i] ^ kOutline;
        if (!outline_.has_shells(segment) && outline_.twin(segment) == RefinementOutline::kNoTwin)
          edges.push_back({edge_id(t, i), tri.generation});
      }
    };
    for (std::uint32_t t = 0; t < mesh_.triangles.size(); ++t)
      note(t);
    while (!edges.empty() && mesh_.points.size() < max_vertices_) {
      const EncroachedTicket ticket = edges.back();
      edges.pop_back();
      if (mesh_.triangles[triangle_of(ticket.edge)].generation != ticket.generation) continue;
      const auto [a, b] = mesh_.ends(ticket.edge);
      const double n = parts(a, b);
      if (!split_edge(ticket.edge, std::floor(n / 2) / n)) continue;
      for (std::size_t k = 0; k < best_.cavity.rim().size(); ++k)
        note(best_.cavity.fresh_triangle(k));
    }
  }

  Refined finish() {
    if (out_.outcome == RefinementOutcome::kRefined && out_.bad_at_lattice_step > 0)
      out_.outcome = RefinementOutcome::kLatticeTooCoarse;
    out_.angle_deg = min_angle_deg_;
    out_.max_area_mm2 = max_area_mm2_;
    out_.mesh.vertices = mesh_.points;
    out_.origins = origins_;
    out_.segments = outline_.segments();
    out_.mesh.triangles.reserve(mesh_.triangles.size());
    // The corner opposite edge 0 comes first: the order of corners decides how an asset is encoded.
    for (const WorkingTriangle& t : mesh_.triangles)
      out_.mesh.triangles.push_back({t.v[2], t.v[0], t.v[1]});
    return std::move(out_);
  }

  const Triangulation& from_;
  RefinementMesh& mesh_;
  RefinementOutline& outline_;
  RefinementQueue& bad_;
  std::vector<VertexOrigin>& origins_;
  std::vector<EncroachedTicket>&encroached_, &long_edges_;
  std::vector<FillNode>& nodes_;
  Candidate &best_, &trial_;
  SharedEdges& shared_;
  Candidate &best_beyond_, &trial_beyond_;
  double min_angle_deg_, max_area_mm2_;
  std::uint32_t max_vertices_;
  bool keep_area_, has_shared_;
  double farthest2_;
  TriangleBounds bounds_;
  InsertionLook look_;
  AngleCircle circle_;  // for the wanted angle
  std::array<Place, kAside_deg.size()> aside_{};
  Refined out_;
};

// Far more vertices than refinement to a safe angle has needed on any input.
std::uint32_t ample_budget(const Triangulation& from, const Lattice& lattice,
                           const RefinementOptions& options) {
  const double step2 = lattice.step_mm() * lattice.step_mm();
  const double smallest_mm2 = options.area_mm2_at
                                  ? std::min(options.least_area_mm2, options.max_area_mm2)
                                  : options.max_area_mm2;
  const double doubled_area_bound = std::max(2 * smallest_mm2 / step2, 1.0);
  const double vertices = 10'000 + 200.0 * static_cast<double>(from.mesh.vertices.size()) +
                          4.0 * static_cast<double>(doubled_area(from.mesh)) / doubled_area_bound;
  return static_cast<std::uint32_t>(std::min(double{kMostVertices}, vertices));
}

// The wanted area, or the smallest that does not ask for too many triangles.
double affordable_area_mm2(const Triangulation& from, const Lattice& lattice, double wanted_mm2) {
  const double area_mm2 =
      0.5 * static_cast<double>(doubled_area(from.mesh)) * lattice.step_mm() * lattice.step_mm();
  return std::max(wanted_mm2, area_mm2 / kMostTrianglesByArea);
}

Refined refine_unrotated(const Triangulation& from, const Lattice& lattice,
                         const RefinementOptions& wanted, Workspace& memory) {
  RefinementOptions options = wanted;
  options.max_area_mm2 = affordable_area_mm2(from, lattice, wanted.max_area_mm2);
  options.least_area_mm2 = affordable_area_mm2(from, lattice, wanted.least_area_mm2);
  const auto refine_to = [&](double angle_deg, std::uint32_t max_vertices) {
    const RefinementOptions attempt{
        angle_deg,           options.max_area_mm2,   std::min(max_vertices, kMostVertices),
        options.keep_area,   options.shared_borders, options.farthest_steps,
        options.area_mm2_at, options.least_area_mm2};
    return Refiner(from, lattice, attempt, memory).run();
  };
  const double safe_deg = std::min(options.min_angle_deg, kSafeAngle_deg);
  Refined best =
      refine_to(safe_deg, options.max_vertices != 0 ? options.max_vertices
                                                    : ample_budget(from, lattice, options));
  if (safe_deg == options.min_angle_deg || best.outcome == RefinementOutcome::kVertexBudget)
    return best;

  // Above kSafeAngle_deg it depends on the outline whether refinement ends: bisection.
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

}  // namespace

bool is_angle_below(LatticePoint a, LatticePoint b, LatticePoint c, double sine2) {
  return shape_of(a, b, c, {sine2, 0}).is_sharp;
}

Refined refine(const Triangulation& from, const Lattice& lattice,
               const RefinementOptions& options) {
  thread_local Workspace memory;
  const auto refined = [&](const Triangulation& unrotated, const RefinementOptions& wanted) {
    Refined out = refine_unrotated(unrotated, lattice, wanted, memory);
    // What a large slice has taken is worth more to its next stages.
    if (memory.mesh.triangles.capacity() > kMostKeptTriangles) memory = {};
    return out;
  };
  const CanonicalRotation rotate = rotation_by_centroid(from.mesh.vertices);
  if (rotate.is_identity()) return refined(from, options);
  Triangulation rotated = from;
  for (LatticePoint& p : rotated.mesh.vertices)
    p = rotate(p);
  RefinementOptions rotated_too = options;
  if (options.area_mm2_at)
    rotated_too.area_mm2_at = [&](LatticePoint p) { return options.area_mm2_at(rotate.back(p)); };
  Refined out = refined(rotated, rotated_too);
  for (LatticePoint& p : out.mesh.vertices)
    p = rotate.back(p);
  return out;
}

}  // namespace trocar::pipeline
