// SPDX-License-Identifier: GPL-3.0-or-later
// The part of refinement that concerns the outline. OutlineSplitter keeps lists of the bad
// triangles and of the encroached edges, and splits edges of the outline. (An edge of the outline
// is encroached upon if the apex of its triangle lies in the circle whose diameter is the edge.)
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <optional>
#include <utility>
#include <vector>

#include "formats/geometry/segment_split.h"
#include "formats/geometry/triangle_shape.h"
#include "pipeline/triangulation/fill_nodes.h"
#include "pipeline/triangulation/insertion_trial.h"
#include "pipeline/triangulation/refinement_mesh.h"
#include "pipeline/triangulation/refinement_outline.h"
#include "pipeline/triangulation/refinement_queue.h"
#include "pipeline/triangulation/shared_edges.h"
#include "pipeline/triangulation/triangle_bounds.h"

namespace trocar::pipeline {

// An edge of the outline that is shorter than twice this length, in lattice steps, is not split. A
// triangle with an edge shorter than this length is improved only if it is too large, because its
// angles depend on rounding to the lattice.
inline constexpr std::int64_t kMinEdge_steps = 4;

// Positions for a split of an edge of the outline, as fractions of the edge, the preferred one
// first.
inline constexpr std::array kSplits = {0.5, 0.42, 0.58, 0.34, 0.66};
// If a split at one position of kSplits creates flaws, later positions are tried too. For an edge
// of at least this length, they are tried only if its apex is not near (see split_edge()). A
// shorter edge can be split only a few times before its parts reach kMinEdge_steps, so a bad split
// can hardly be corrected later. The value comes from a trial on outlines with a grid of holes that
// are 1 to 40 steps wide: with half of this value, the meshes had more sharp angles.
inline constexpr std::int64_t kFewSplitsLeft_steps = 32 * kMinEdge_steps;

// An edge of the outline that is to be split. The entry is stale if the generation of the edge's
// triangle has changed.
struct EncroachedEdge {
  EdgeId edge;
  std::uint32_t generation;
};

// Memory that is reused for all slices. (Without this reuse, a fifth of the time of refinement went
// into fresh memory pages.)
struct RefinementWorkspace {
  RefinementMesh mesh;
  RefinementOutline outline;
  RefinementQueue bad;
  std::vector<VertexOrigin> origins;
  std::vector<EncroachedEdge> encroached, long_edges;
  std::vector<FillNode> nodes;
  Candidate best, trial;
  SharedEdges shared;
  Candidate best_beyond, trial_beyond;
};

/// The part of the refinement algorithm that concerns the outline. The derived class Refiner
/// (refinement.cpp) adds the points in the material. This class is defined in a header so that the
/// compiler can inline its functions into those of Refiner.
class OutlineSplitter {
 protected:
  using PointKind = InsertionTrial::PointKind;
  using Positions = InsertionTrial::Positions;
  using BoundaryEdge = InsertionCavity::BoundaryEdge;

  OutlineSplitter(const Triangulation& from, const Lattice& lattice,
                  const RefinementOptions& options, RefinementWorkspace& memory)
      : mesh_(memory.mesh),
        outline_(memory.outline),
        bad_(memory.bad),
        origins_(memory.origins),
        encroached_(memory.encroached),
        best_(memory.best),
        trial_(memory.trial),
        max_vertices_(options.max_vertices),
        bounds_(lattice, options),
        insertion_(memory.mesh, bounds_),
        shared_(memory.shared),
        best_beyond_(memory.best_beyond),
        trial_beyond_(memory.trial_beyond),
        keep_area_(options.keep_area),
        has_shared_(options.shared_borders),
        max_distance2_(options.max_distance_steps * options.max_distance_steps) {
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
    if (keep_area_) outline_.start_clearance(mesh_.points);
    origins_.reserve(mesh_.points.capacity());
    origins_.assign(mesh_.points.size(), {VertexOrigin::kCorner});
    encroached_.clear();
    bad_.clear();
  }

  LatticePoint at(std::uint32_t v) const { return mesh_.points[v]; }
  double distance(std::uint32_t a, std::uint32_t b) const { return edge_length(at(a), at(b)); }

  // ---- bad triangles and encroached edges ----

  bool is_encroached(std::uint32_t segment, std::uint32_t a, std::uint32_t b,
                     std::uint32_t apex) const {
    if (!encroaches(at(a), at(b), at(apex))) return false;
    // A shell is a circle around a corner. Where two segments of the outline meet at a small angle,
    // an apex on the other segment is ignored if it is on the same shell as a or b. Without
    // rounding, such an apex would not encroach upon the edge.
    const std::uint32_t corner =
        outline_.small_corner(static_cast<std::int32_t>(segment), origins_[apex].segment);
    if (corner == RefinementOutline::kNoCorner) return true;
    const double d = distance(apex, corner);
    return std::abs(d - distance(a, corner)) > kSameShell_steps &&
           std::abs(d - distance(b, corner)) > kSameShell_steps;
  }

  // Queues those edges of the triangle that are on the outline and encroached upon.
  [[gnu::always_inline]] void queue_encroached_edges(std::uint32_t t) {
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

  // ---- splitting edges of the outline ----

  void split_encroached() {
    while (!encroached_.empty() && mesh_.points.size() < max_vertices_) {
      const EncroachedEdge entry = encroached_.back();
      encroached_.pop_back();
      if (mesh_.triangles[triangle_of(entry.edge)].generation == entry.generation)
        split_edge(entry.edge);
    }
  }

  // Evaluates a split of the edge at p. Returns false if it is impossible.
  bool evaluate_split(EdgeId s, LatticePoint p, Candidate& out) {
    out.p = p;
    mesh_.find_split_cavity(s, p, out.cavity);
    return !insertion_.evaluate<PointKind::kSplit>(out, 0).is_turned;
  }

  // An input segment, with a limit on the distance of split points from it. Split points are
  // rounded to lattice points, so after repeated splits they can lie farther and farther
  // from the segment.
  struct Segment {
    LatticePoint from, to;
    double length2, max_area2;
    bool is_far(LatticePoint p) const {
      const auto area = static_cast<double>(orient2d(from, to, p));
      return area * area >= max_area2;
    }
    // Is the point on the void's side of the segment and more than one step away from it?
    bool is_outside(LatticePoint p) const {
      const auto area = static_cast<double>(orient2d(from, to, p));
      return area < 0 && area * area > length2;
    }
  };
  Segment segment_at(std::uint32_t segment) const {
    const Refined::Segment& input = outline_.segments()[segment];
    const LatticePoint from = at(input.from), to = at(input.to);
    const auto length2 = static_cast<double>(distance2(from, to));
    return {from, to, length2, max_distance2_ * length2};
  }

  // Finds a lattice point at which to split the edge ab of triangle t = abc, near the given
  // fraction of the way from a to b. Returns false if there is none. Four lattice points surround
  // the exact position. The function chooses the nearest one on the material's side. If keep_area_
  // is set and the segment has clearance (RefinementOutline::has_clearance()), it chooses from all
  // four the one that keeps the area of the loop best.
  bool find_split_position(std::uint32_t t, std::uint32_t segment, const Segment& input,
                           const TriangleCorners& v, double fraction, LatticePoint& out) {
    const LatticePoint a = v[0], b = v[1], c = v[2];
    SplitCell cell(a, b, fraction);
    // A point on the void's side must lie in the circumcircle, so that the mesh stays Delaunay.
    const auto is_usable = [&](std::size_t k, LatticePoint q) {
      return !input.is_far(q) && (cell.is_inside(k) ? may_split(a, b, c, q)
                                                    : encroaches(a, b, q) & !input.is_outside(q) &
                                                          mesh_.circumcircle_contains(t, q));
    };
    std::size_t p = cell.nearest_inside();
    const bool is_exact = cell.side(p) == 0;
    const bool any_side = keep_area_ && !is_exact && outline_.has_clearance(segment);
    const std::int64_t wanted = any_side ? -outline_.lost_of_loop(segment) : 0;
    if (any_side) p = cell.nearest_side(wanted);
    while (any_side ? !cell.is_excluded(p) : cell.is_inside(p)) {
      out = cell.point(p);
      if (is_usable(p, out)) [[likely]]
        return true;
      cell.exclude(p);
      p = any_side ? cell.nearest_side(wanted) : cell.nearest_inside();
    }
    return false;
  }

  // Splits an edge of the outline. If the edge's segment has shells, the split lies on a shell.
  // Otherwise it lies at the fraction `wanted` of the edge, or at the best position if `wanted` is
  // 0. Returns false if the edge cannot be split.
  bool split_edge(EdgeId s, double wanted = 0) {
    if (has_shared_) {
      if (const EdgeId beyond = shared_.beyond(s, mesh_, outline_); beyond != kNoEdge)
        return split_shared_edge(s, beyond);
    }
    const auto [ia, ib] = mesh_.ends(s);
    const LatticePoint a = at(ia), b = at(ib), c = at(mesh_.apex(s));
    if (distance2(a, b) < 4 * kMinEdge_steps * kMinEdge_steps) return false;
    const std::uint32_t segment = mesh_.beyond(s) ^ kOutline;
    const bool has_shells = outline_.has_shells(segment);
    const Segment input = segment_at(segment);
    const auto find_position = [&](double fraction, LatticePoint& p) {
      return find_split_position(triangle_of(s), segment, input, {a, b, c}, fraction, p);
    };
    const auto evaluate_at = [&](double fraction) {
      LatticePoint p;
      return find_position(fraction, p) && evaluate_split(s, p, best_);
    };
    if (has_shells || wanted > 0) {
      if (!evaluate_at(wanted > 0 && !has_shells
                           ? wanted
                           : outline_.shell_fraction(segment, a, b, mesh_.points)))
        return false;
    } else {
      std::size_t k = 0;
      while (!evaluate_at(kSplits[k])) {
        if (++k == kSplits.size()) return false;
      }
      // If the split creates flaws, other fractions are tried, unless the flaws are temporary. They
      // are temporary if the edge is long and the apex is nearer to the edge than half the edge's
      // length, because the halves will then be split again.
      const std::int64_t ab2 = distance2(a, b);
      if (best_.flaws > 0 &&
          (2 * orient2d(a, b, c) >= ab2 || ab2 < kFewSplitsLeft_steps * kFewSplitsLeft_steps)) {
        // At the other fractions, only the point on the material's side is tried.
        Positions positions;
        Four is_allowed_position{};
        positions.fill(best_.p);
        for (std::size_t i = k; i < 4; ++i) {
          const SplitCell cell(a, b, kSplits[i + 1]);
          positions[i] = cell.point(cell.nearest_inside());
          is_allowed_position[i] = -1;
        }
        const InsertionTrial::Fewest best = InsertionTrial::fewest_of(
            insertion_.flaws_of<PointKind::kSplit>(positions, best_.cavity, 0),
            is_allowed_position);
        LatticePoint p;
        if (best.flaws < best_.flaws && find_position(kSplits[best.position + 1], p) &&
            evaluate_split(s, p, trial_) && trial_.growth < best_.growth)
          std::swap(best_, trial_);
      }
    }
    if (!insert(best_, {static_cast<std::int32_t>(segment)}, s)) return false;
    if (keep_area_) outline_.lost_of_loop(segment) += orient2d(a, b, best_.p);
    queue_encroached_edges(best_);
    return true;
  }
  // After the insertion of a split, queues the edges that are encroached upon because of it.
  [[gnu::always_inline]] void queue_encroached_edges(const Candidate& split) {
    InsertionTrial::for_each_edge(split.cavity, &BoundaryQuad::is_blocked, [&](std::size_t k) {
      queue_encroached_edges(split.cavity.fresh_triangle(k));
    });
  }

  // ---- splitting edges that two regions share ----

  // Evaluates a split of the shared edge at p, in the meshes on both sides.
  bool evaluate_shared_split(EdgeId s, EdgeId t, LatticePoint p, Candidate& here,
                             Candidate& there) {
    const auto is_open_loop = [](const InsertionCavity& c) {
      return c.boundary().size() == c.size() + 1;
    };
    return may_split_either_way(mesh_, s, p) && may_split_either_way(mesh_, t, p) &&
           evaluate_split(s, p, here) && evaluate_split(t, p, there) && is_open_loop(here.cavity) &&
           is_open_loop(there.cavity);
  }

  // Splits a shared edge at one point for both sides. Returns false if there is no such point.
  // (Without noinline here and always_inline at insert(), slices without shared edges took
  // 2 % longer.)
  [[gnu::noinline]] bool split_shared_edge(EdgeId s, EdgeId t) {
    const auto [ia, ib] = mesh_.ends(s);
    const LatticePoint a = at(ia), b = at(ib), c = at(mesh_.apex(s)), d = at(mesh_.apex(t));
    if (distance2(a, b) < 4 * kMinEdge_steps * kMinEdge_steps) return false;
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
           shared_split_points(a, b, c, d, fraction, outline_.lost_of_loop(segment))) {
        if (!p || input.is_far(*p)) continue;
        if (!is_found) {
          is_found = evaluate_shared_split(s, t, *p, best_, best_beyond_);
          fewest = best_.flaws + best_beyond_.flaws;
          if (is_found) break;
        } else {
          const Positions position{*p, *p, *p, *p};
          const int flaws =
              insertion_.flaws_of<PointKind::kSplit>(position, best_.cavity, 0)[0] +
              insertion_.flaws_of<PointKind::kSplit>(position, best_beyond_.cavity, 0)[0];
          if (flaws < fewest) fewest = flaws, better = p;
        }
      }
      if (is_found && fewest == 0) break;
    }
    if (!is_found) return false;
    if (better && evaluate_shared_split(s, t, *better, trial_, trial_beyond_) &&
        trial_.growth + trial_beyond_.growth < best_.growth + best_beyond_.growth) {
      std::swap(best_, trial_);
      std::swap(best_beyond_, trial_beyond_);
    }
    const auto v = static_cast<std::uint32_t>(mesh_.points.size());
    insert(best_, {static_cast<std::int32_t>(segment)}, s);
    queue_encroached_edges(best_);
    insert(best_beyond_, {static_cast<std::int32_t>(twin)}, t);
    queue_encroached_edges(best_beyond_);
    shared_.add_copies(v, v + 1);
    outline_.lost_of_loop(segment) += orient2d(a, b, best_.p);
    outline_.lost_of_loop(twin) -= orient2d(a, b, best_.p);
    return true;
  }

  [[gnu::always_inline]] bool insert(Candidate& candidate, VertexOrigin origin, EdgeId split) {
    if (!mesh_.fill_cavity(candidate.cavity, candidate.p, split)) return false;
    origins_.push_back(origin);
    if (has_shared_) {
      for (std::size_t k = 0; k < candidate.cavity.boundary().size(); ++k)
        shared_.note(mesh_, candidate.cavity.fresh_triangle(k));
    }
    InsertionTrial::for_each_edge(candidate.cavity, &BoundaryQuad::is_bad, [&](std::size_t k) {
      const std::uint32_t t = candidate.cavity.fresh_triangle(k);
      queue(t, true, shortest2(mesh_.triangles[t]));
    });
    return true;
  }

  RefinementMesh& mesh_;
  RefinementOutline& outline_;
  RefinementQueue& bad_;
  std::vector<VertexOrigin>& origins_;
  std::vector<EncroachedEdge>& encroached_;
  Candidate &best_, &trial_;
  std::uint32_t max_vertices_;
  TriangleBounds bounds_;
  InsertionTrial insertion_;

 private:
  SharedEdges& shared_;
  Candidate &best_beyond_, &trial_beyond_;
  bool keep_area_, has_shared_;
  double max_distance2_;
};

}  // namespace trocar::pipeline
