// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/refinement.h"

#include <limits>
#include <numbers>

#include "formats/mesh/canonical_rotation.h"
#include "formats/mesh/refinement_outline.h"
#include "formats/mesh/regions.h"
#include "formats/mesh/steiner_points.h"

namespace trocar {
namespace {

// If a triangle is too large, a new point over one of its edges makes an equilateral triangle. The
// edges of that triangle have this fraction of the largest length allowed, and other vertices are
// at least half an edge away.
constexpr double kEvenEdge = 0.9;
// If the largest area requires at least kMinFilled triangles for each vertex of the input, a
// lattice of equilateral triangles fills the inside. Relative to the length of its edges, outline
// edges are split into parts of kFillPart, and its points keep kFillAway from other vertices. If
// its edges are shorter than kMinFillEdge_steps, rounding to the lattice would distort it too much.
constexpr double kMinFilled = 4, kFillPart = 0.85, kFillAway = 0.7, kMinFillEdge_steps = 32;
// Alternative positions over the shortest edge, as angles from the off-centre.
constexpr std::array kTrialAngles_deg = {30.0, -30.0, 60.0, -60.0};

// Edges have ids below 2^31.
constexpr std::uint32_t kMaxVertices = 100'000'000;
// Constants for angles above kSafeAngle_deg: the vertex budget as a multiple of the vertices of the
// mesh refined to that angle, and the accuracy of the search for the largest attainable angle.
constexpr std::size_t kSteepBudget = 4;
constexpr double kAngleStep_deg = 0.25;

// A workspace with more triangles than this, 8 MB, is not kept from slice to slice.
constexpr std::size_t kMaxKeptTriangles = 1 << 17;

// Improves bad triangles by new points in the material.
class Refiner : private OutlineSplitter {
  using Tally = InsertionTrial::Tally;

 public:
  Refiner(const Triangulation& from, double doubled_area, const Lattice& lattice,
          const RefinementOptions& options, RefinementWorkspace& memory)
      : OutlineSplitter(from, lattice, options, memory),
        input_vertices_(from.mesh.vertices.size()),
        doubled_area_(doubled_area),
        long_edges_(memory.long_edges),
        nodes_(memory.nodes),
        min_angle_deg_(options.min_angle_deg),
        max_area_mm2_(options.max_area_mm2),
        circle_(options.min_angle_deg * std::numbers::pi / 180) {
    for (std::size_t k = 0; k < trial_offsets_.size(); ++k) {
      const double angle = kTrialAngles_deg[k] * std::numbers::pi / 180;
      trial_offsets_[k] = circle_.at(std::sin(angle), std::cos(angle));
    }
  }

  Refined run() {
    for (std::uint32_t t = 0; t < mesh_.triangles.size(); ++t) {
      queue_encroached_edges(t);
      const std::array<std::uint32_t, 3>& v = mesh_.triangles[t].v;
      const TriangleShape shape = bounds_.shape(at(v[0]), at(v[1]), at(v[2]));
      queue(t, shape.is_bad(), shape.shortest2);
    }
    fill_large();
    while (true) {
      split_encroached();
      RefinementQueue::Entry bad{};
      const bool is_any = bad_.pop(bad, [&](const RefinementQueue::Entry& entry) {
        return mesh_.triangles[entry.triangle].generation == entry.generation;
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
  // ---- evaluating points in the material ----

  // Evaluates a point: does it lie in the circumcircle of t and in the material, encroach upon no
  // edge and keep its distance from other vertices?
  bool is_allowed(std::uint32_t t, LatticePoint p, double min_distance2, Candidate& out) {
    if (!mesh_.circumcircle_contains(t, p)) return false;
    out.p = p;
    mesh_.find_cavity(t, p, out.cavity);
    const Tally result = insertion_.evaluate<PointKind::kFree>(out, min_distance2);
    return !(result.is_turned | result.is_near | result.is_blocked);
  }

  // Evaluates a point within the circumcircle of t. Returns the longest edge of the outline that it
  // encroaches upon or lies beyond; kNoEdge if there is none.
  EdgeId find_blocking_edge(std::uint32_t t, LatticePoint p, Candidate& out) {
    out.p = p;
    mesh_.find_cavity(t, p, out.cavity);
    const Tally result = insertion_.evaluate<PointKind::kFree>(out, 0);
    if (result.is_turned) out.growth = kImpossible;
    if (!result.is_turned && !result.is_blocked) return kNoEdge;
    EdgeId longest = kNoEdge;
    std::int64_t length2 = 0;
    InsertionTrial::for_each_edge(out.cavity, &BoundaryQuad::is_blocked, [&](std::size_t k) {
      const BoundaryEdge& r = out.cavity.boundary()[k];
      const std::int64_t ab2 = distance2(at(r.a), at(r.b));
      if (ab2 > length2) length2 = ab2, longest = r.inside;
    });
    return longest;
  }

  // ---- inserting in the material ----

  void improve(std::uint32_t t) {
    const std::array<std::uint32_t, 3> v = mesh_.triangles[t].v;
    const TriangleShape shape = bounds_.shape(at(v[0]), at(v[1]), at(v[2]));
    const std::uint32_t shortest = shortest_edge({at(v[0]), at(v[1]), at(v[2])}).edge;
    if (!shape.is_large) {
      if (shape.shortest2 < kMinEdge_steps * kMinEdge_steps) return give_up(t);
      if (const std::uint32_t corner = across_small_angle(v, shortest);
          corner != RefinementOutline::kNoCorner) {
        // Miller, Pav and Walkington: shortening this edge would not terminate. If the input angle
        // allows the wanted one, closer shells reach it.
        if (outline_.angle_deg(corner) < min_angle_deg_ + kLatticeAllowance_deg) {
          mesh_.triangles[t].is_bad = 0;
          return;
        }
        if (split_shells(t, corner)) return;
      }
    }
    const double max_away = shape.is_sharp ? circle_.off_centre_distance() *
                                                 rounding_allowance(std::sqrt(shape.shortest2))
                                           : std::numeric_limits<double>::infinity();
    const LatticePoint centre = centre_over(at(v[shortest]), at(v[next_corner(shortest)]),
                                            at(v[previous_corner(shortest)]), max_away);
    if (!mesh_.circumcircle_contains(t, centre)) return give_up(t);
    const EdgeId blocking_edge = find_blocking_edge(t, centre, best_);
    const bool is_found = find_better(t, v, shortest, shape, blocking_edge);
    const std::uint32_t generation = mesh_.triangles[t].generation;
    if (is_found || blocking_edge == kNoEdge) {
      if (best_.growth == kImpossible || !insert(best_, {VertexOrigin::kFree}, kNoEdge)) give_up(t);
    } else if (!split_edge(blocking_edge)) {
      // If the point encroaches or lies beyond the outline, the blocking edge is split instead.
      give_up(t);
    } else if (mesh_.triangles[t].generation == generation) {
      queue(t, true, shape.shortest2);  // the triangle still exists: try it again later
    }
  }

  // Gives up a bad triangle that no lattice point improves.
  void give_up(std::uint32_t t) {
    mesh_.triangles[t].is_bad = 0;
    ++out_.bad_at_lattice_step;
  }

  // Tries another position, which may remove more bad triangles at once or leave the outline as it
  // is: the one of several that promises the fewest bad triangles. Puts it into best_ if it leaves
  // fewer than best_ does, else returns false.
  bool find_better(std::uint32_t t, const std::array<std::uint32_t, 3>& v, std::uint32_t shortest,
                   const TriangleShape& shape, EdgeId blocking_edge) {
    if (shape.is_large) return blocking_edge == kNoEdge && find_more_even(t, v);
    const int growth = blocking_edge == kNoEdge ? best_.growth : 0;
    if (growth < -1) return false;
    const LatticePoint a = at(v[shortest]), b = at(v[next_corner(shortest)]);
    const double allowance = rounding_allowance(std::sqrt(shape.shortest2));
    Positions positions;
    for (std::size_t k = 0; k < 4; ++k)
      positions[k] = point_over(
          a, b, {trial_offsets_[k].along * allowance, trial_offsets_[k].away * allowance});
    // Like the off-centre, these points keep the shortest edge's length as a distance from other
    // vertices, so that refinement terminates as it does without them.
    const InsertionTrial::Fewest best = InsertionTrial::fewest_of(
        insertion_.flaws_of<PointKind::kFree>(positions, best_.cavity, shape.shortest2),
        four_of(-1));
    if (best.flaws - best_.cavity.bad_triangles() >= growth ||
        !is_allowed(t, positions[best.position], shape.shortest2, trial_) ||
        trial_.growth >= growth)
      return false;
    std::swap(best_, trial_);
    return true;
  }

  // The same for a triangle that is too large. The positions are the apexes of equilateral
  // triangles over its edges, and the edges' midpoints.
  bool find_more_even(std::uint32_t t, const std::array<std::uint32_t, 3>& v) {
    const double most = bounds_.largest_doubled_area(at(v[0]), at(v[1]), at(v[2]));
    const double even_edge = kEvenEdge * std::sqrt(2 / std::numbers::sqrt3 * most);
    const double even2 = even_edge * even_edge, min_distance2 = 0.25 * even2;
    // The positions at the first and the second edge, and those at the third.
    Positions two_edges, one_edge;
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
    const auto fewest = [&](const Positions& positions, Four is_allowed_position) {
      return InsertionTrial::fewest_of(
          insertion_.flaws_of<PointKind::kFree>(positions, best_.cavity, min_distance2),
          is_allowed_position);
    };
    const InsertionTrial::Fewest of_two = fewest(two_edges, is_in_two),
                                 of_one = fewest(one_edge, is_in_one);
    const bool is_third = of_one.flaws < of_two.flaws;
    if (std::min(of_one.flaws, of_two.flaws) >= best_.flaws ||
        !is_allowed(t, is_third ? one_edge[of_one.position] : two_edges[of_two.position],
                    min_distance2, trial_) ||
        trial_.growth >= best_.growth)
      return false;
    std::swap(best_, trial_);
    return true;
  }

  // If the shortest edge joins two input segments that meet under a small angle, at the same
  // distance from their corner, returns that corner, else kNoCorner.
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

  // If the largest area requires many triangles, most of them can belong to a lattice of
  // equilateral triangles of that area, inside which no position has to be searched for.
  void fill_large() {
    if (bounds_.has_area_at() || mesh_.triangles.empty()) return;
    const double wanted = doubled_area_ / bounds_.everywhere().doubled_area;
    const double edge = fill_edge(bounds_.everywhere().doubled_area);
    if (edge < kMinFillEdge_steps || wanted < kMinFilled * static_cast<double>(input_vertices_))
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
  void split_long(double component) {
    std::vector<EncroachedEdge>& edges = long_edges_;
    edges.clear();
    const auto components = [&](std::uint32_t a, std::uint32_t b) {
      return std::floor(edge_length(at(a), at(b)) / component + 0.5);
    };
    const auto note = [&](std::uint32_t t) {
      const WorkingTriangle& tri = mesh_.triangles[t];
      for (std::uint32_t i = 0; i < 3; ++i) {
        if ((tri.beyond[i] & kOutline) == 0 || components(tri.v[i], tri.v[next_corner(i)]) < 2)
          continue;
        const std::uint32_t segment = tri.beyond[i] ^ kOutline;
        if (!outline_.has_shells(segment) && outline_.twin(segment) == RefinementOutline::kNoTwin)
          edges.push_back({edge_id(t, i), tri.generation});
      }
    };
    for (std::uint32_t t = 0; t < mesh_.triangles.size(); ++t)
      note(t);
    while (!edges.empty() && mesh_.points.size() < max_vertices_) {
      const EncroachedEdge entry = edges.back();
      edges.pop_back();
      if (mesh_.triangles[triangle_of(entry.edge)].generation != entry.generation) continue;
      const auto [a, b] = mesh_.ends(entry.edge);
      const double n = components(a, b);
      if (!split_edge(entry.edge, std::floor(n / 2) / n)) continue;
      for (std::size_t k = 0; k < best_.cavity.boundary().size(); ++k)
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

  std::size_t input_vertices_;
  double doubled_area_;  // of the input
  std::vector<EncroachedEdge>& long_edges_;
  std::vector<FillNode>& nodes_;
  double min_angle_deg_, max_area_mm2_;
  AngleCircle circle_;  // for the wanted angle
  std::array<EdgeOffset, kTrialAngles_deg.size()> trial_offsets_{};
  Refined out_;
};

// A vertex budget far above what refinement to a safe angle has needed on any input.
std::uint32_t ample_budget(std::size_t input_vertices, double doubled_area, const Lattice& lattice,
                           const RefinementOptions& options) {
  const double step2 = lattice.step_mm() * lattice.step_mm();
  const double smallest_mm2 = options.area_mm2_at
                                  ? std::min(options.min_area_mm2, options.max_area_mm2)
                                  : options.max_area_mm2;
  const double doubled_area_bound = std::max(2 * smallest_mm2 / step2, 1.0);
  const double vertices = 10'000 + 200.0 * static_cast<double>(input_vertices) +
                          4.0 * doubled_area / doubled_area_bound;
  return static_cast<std::uint32_t>(std::min(double{kMaxVertices}, vertices));
}

// The wanted area bound, or the smallest one that does not require too many triangles.
double affordable_area_mm2(double doubled_area, const Lattice& lattice, double wanted_mm2) {
  const double area_mm2 = 0.5 * doubled_area * lattice.step_mm() * lattice.step_mm();
  return std::max(wanted_mm2, area_mm2 / kMaxTrianglesByArea);
}

Refined refine_unrotated(const Triangulation& from, const Lattice& lattice,
                         const RefinementOptions& wanted, RefinementWorkspace& memory) {
  RefinementOptions options = wanted;
  const auto area = static_cast<double>(doubled_area(from.mesh));
  options.max_area_mm2 = affordable_area_mm2(area, lattice, wanted.max_area_mm2);
  options.min_area_mm2 = affordable_area_mm2(area, lattice, wanted.min_area_mm2);
  const auto refine_to = [&](double angle_deg, std::uint32_t max_vertices) {
    RefinementOptions attempt = options;
    attempt.min_angle_deg = angle_deg;
    attempt.max_vertices = std::min(max_vertices, kMaxVertices);
    return Refiner(from, area, lattice, attempt, memory).run();
  };
  const double safe_deg = std::min(options.min_angle_deg, kSafeAngle_deg);
  Refined best =
      refine_to(safe_deg, options.max_vertices != 0
                              ? options.max_vertices
                              : ample_budget(from.mesh.vertices.size(), area, lattice, options));
  if (safe_deg == options.min_angle_deg || best.outcome == RefinementOutcome::kVertexBudget)
    return best;

  // Above kSafeAngle_deg the outline decides whether refinement terminates, so the angle is
  // bisected.
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
  thread_local RefinementWorkspace memory;
  const auto refined = [&](const Triangulation& unrotated, const RefinementOptions& wanted) {
    Refined out = refine_unrotated(unrotated, lattice, wanted, memory);
    // Release the memory of a large slice, because its next stages need it more.
    if (memory.mesh.triangles.capacity() > kMaxKeptTriangles) memory = {};
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

}  // namespace trocar
