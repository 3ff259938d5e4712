// SPDX-License-Identifier: Apache-2.0
// Holds the input of refinement: the segments of the outline and the angles between them.
// Near an acute corner, this header also determines where segments are split: on shells,
// which are concentric circles around the corner. The two segments that meet at the corner
// are thus split at equal distances from it, and their parts do not encroach upon each other
// (Ruppert, 1995; Shewchuk).
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "formats/mesh/predicates.h"
#include "formats/mesh/refinement.h"
#include "formats/mesh/refinement_mesh.h"
#include "formats/mesh/regions.h"
#include "formats/mesh/segment_grid.h"
#include "formats/mesh/slice_mesh.h"
#include "formats/mesh/steiner_points.h"

namespace trocar {

class RefinementOutline {
 public:
  static constexpr std::uint32_t kNoCorner = 0xffffffff, kNoTwin = 0xffffffff;

  /// Removes all segments and keeps the memory. `vertices` is the number of input vertices.
  void clear(std::size_t vertices);
  /// Adds a segment between two input vertices and returns its number. Numbers count from 0.
  std::uint32_t add(std::uint32_t from, std::uint32_t to);
  /// Measures the angles between the segments. Call it once, after the last add().
  void close(const std::vector<LatticePoint>& points);

  /// Finds the segments that two regions share (twins). Call it after close(). Without this call no
  /// segment has a twin.
  void find_twins(const std::vector<LatticePoint>& points);
  /// The segment that coincides with this one in the opposite direction, or kNoTwin.
  std::uint32_t twin(std::uint32_t segment) const {
    return twins_.empty() ? kNoTwin : twins_[segment];
  }

  /// Finds the loops that the segments form. lost_of_loop() keeps the area by which splits reduce
  /// each loop. If regions share borders, a loop is divided where the region on its other side
  /// changes. Each part then counts as a loop, and has only one region, or only the void (the area
  /// without material), on its other side.
  void find_loops();
  /// Prepares has_clearance().
  void start_clearance(const std::vector<LatticePoint>& points);
  /// Returns true if no other part of the outline can meet this segment even after splits. When the
  /// points of splits are rounded, they may move by up to one step to the void's side, and by up to
  /// three steps to the material's side. Valid after start_clearance(). The answer is computed when
  /// it is first needed, because most segments are never split.
  bool has_clearance(std::uint32_t segment) {
    if (clearance_[segment] == Clearance::kUnknown) [[unlikely]]
      find_clearance(segment);
    return clearance_[segment] == Clearance::kYes;
  }
  /// Twice the area, in steps^2, by which splits have reduced the segment's loop so far; negative
  /// if the loop has grown. The caller adds the effect of each split. Valid after find_loops().
  std::int64_t& lost_of_loop(std::uint32_t segment) { return lost_[loop_[segment]]; }

  const std::vector<Refined::Segment>& segments() const { return segments_; }
  /// The angle in the material at an input vertex, in degrees. 360 stands for all angles of 90
  /// degrees or more, because they play no role in refinement.
  double angle_deg(std::uint32_t vertex) const { return angle_deg_[vertex]; }

  /// Returns the corner at which the segments s and t meet under an angle below 60 degrees in the
  /// material. Returns kNoCorner if there is no such corner, or if s or t is negative. (A negative
  /// number is no segment, as in VertexOrigin.)
  std::uint32_t small_corner(std::int32_t s, std::int32_t t) const {
    return s < 0 || t < 0 || s == t ? kNoCorner : small_corner_of_two(s, t);
  }

  /// Returns true if a segment starts or ends in an acute corner (below kAcuteCorner_deg of
  /// steiner_points.h). The segment's splits must then lie on shells. If two regions share the
  /// segment, it suffices that the corner is acute in one of them.
  bool has_shells(std::uint32_t segment) const {
    return is_acute_from(segment) || is_acute_to(segment);
  }
  /// The position at which to split the edge ab of a segment that has shells, as a fraction of the
  /// way from a to b. The position lies on a shell around the segment's acute corner. If both ends
  /// of the segment are acute corners, the corner nearer to the edge is chosen. The two segments
  /// that meet in this corner are thus split at equal distances from it.
  double shell_fraction(std::uint32_t segment, LatticePoint a, LatticePoint b,
                        const std::vector<LatticePoint>& points) const;

 private:
  bool is_acute(std::uint32_t vertex) const { return angle_deg_[vertex] < kAcuteCorner_deg; }
  bool is_acute_from(std::uint32_t segment) const {
    return is_acute(segments_[segment].from) ||
           (twin(segment) != kNoTwin && is_acute(segments_[twin(segment)].to));
  }
  bool is_acute_to(std::uint32_t segment) const {
    return is_acute(segments_[segment].to) ||
           (twin(segment) != kNoTwin && is_acute(segments_[twin(segment)].from));
  }
  bool is_one_loop_with_previous(std::uint32_t segment) const;
  std::uint32_t small_corner_of_two(std::int32_t s, std::int32_t t) const;
  void find_clearance(std::uint32_t segment);

  std::vector<Refined::Segment> segments_;
  std::vector<std::int32_t> into_;  // for each input vertex: the segment that ends there
  std::vector<std::uint32_t> twins_;
  std::vector<double> angle_deg_;
  enum class Clearance : std::uint8_t { kUnknown, kNo, kYes };
  std::vector<Clearance> clearance_;
  std::vector<std::uint32_t> next_;   // for each segment: the one that starts at its end
  std::vector<LatticeSegment> ends_;  // for each segment: its ends, for has_clearance()
  std::optional<SegmentGrid> grid_;   // grid of ends_, made when has_clearance() first needs it
  std::vector<std::uint32_t> loop_;   // for each segment: its loop
  std::vector<std::int64_t> lost_;    // for each loop: see lost_of_loop()
};

// Evaluates what the insertion of a vertex would change, without inserting it. The insertion would
// replace the triangles of a cavity by new triangles between the cavity's boundary and the point.
// This header evaluates the new triangles, four at a time.

/// A point that may be inserted, and the effect of its insertion.
struct Candidate {
  LatticePoint p;
  InsertionCavity cavity;
  /// `flaws` minus the number of bad triangles that the insertion removes. kImpossible: the point
  /// cannot be inserted.
  int growth = 0;
  /// Number of bad triangles that the insertion creates. If the point splits an edge, the number
  /// includes the edges that are encroached upon after the split.
  int flaws = 0;
};
/// A value of Candidate::growth: the point cannot be inserted.
inline constexpr int kImpossible = std::numeric_limits<int>::max();

/// Evaluates insertions of points.
class InsertionTrial {
 public:
  /// Evaluates insertions into `mesh` by the limits in `bounds`. The mesh may grow between two
  /// evaluations. Both objects must outlive this object.
  InsertionTrial(const RefinementMesh& mesh, const TriangleBounds& bounds)
      : mesh_(mesh), bounds_(bounds), anywhere_(bounds.anywhere()) {}

  /// Results for all triangles between a cavity's boundary and a point.
  struct Tally {
    int flaws = 0;            ///< see Candidate::flaws
    bool is_turned = false;   ///< the point lies on or beyond an edge of the boundary: not allowed
    bool is_near = false;     ///< the point is too near to a vertex of the boundary
    bool is_blocked = false;  ///< an edge is blocked (BoundaryQuad::is_blocked)
  };
  enum class PointKind {
    kFree,   ///< a point in the material
    kSplit,  ///< a point that splits an edge of the outline
  };
  /// Evaluates the insertion of the candidate. Precondition: the candidate's cavity has been
  /// found. `min_distance2` is the square of the smallest distance that is allowed between the
  /// point and other vertices. Sets the candidate's flaws and growth, and marks edges of the
  /// boundary (BoundaryQuad::is_bad, is_blocked).
  template <PointKind kKind>
  [[gnu::always_inline]] Tally evaluate(Candidate& candidate, double min_distance2) const {
    InsertionCavity& cavity = candidate.cavity;
    const Clearance clearance(min_distance2);
    Four flaws{}, is_turned{}, is_near{}, is_blocked{};
    const std::span<BoundaryQuad> quads = cavity.quads();
    for (std::size_t k = 0; k < quads.size(); ++k) {
      BoundaryQuad& r = quads[k];
      const FourPoints origin{};  // coordinates are relative to the point
      const FourResults result =
          evaluate_four(cavity.is_near_origin(), r.a, r.b, origin, clearance, [&] {
            const InsertionCavity::BoundaryEdge* const boundary = cavity.edges_of_quad(k);
            FourTriangles out;
            for (std::size_t i = 0; i < 4; ++i)
              out[i] = {at(boundary[i].a), at(boundary[i].b), candidate.p};
            return out;
          });
      r.is_bad = result.is_bad & r.is_edge;
      if (kKind == PointKind::kSplit) {
        const Four here = r.is_outline & r.is_edge & result.is_obtuse_at_p,
                   before = r.is_before & result.is_obtuse_at_a,
                   after = r.is_after & result.is_obtuse_at_b;
        r.is_blocked = here | before | after;
        flaws += r.is_bad + here + before + after;
      } else {
        r.is_blocked = r.is_outline & r.is_edge & (result.is_turned | result.is_obtuse_at_p);
        flaws += r.is_bad;
      }
      is_blocked |= r.is_blocked;
      is_turned |= result.is_turned;
      is_near |= result.is_near;
    }
    const Tally out{count_of(flaws), is_any(is_turned), is_any(is_near), is_any(is_blocked)};
    candidate.flaws = out.flaws;
    candidate.growth = out.flaws - cavity.bad_triangles();
    return out;
  }

  /// Four alternative positions for one new point. They are evaluated with the cavity of another
  /// position nearby, because positions close to each other have nearly the same cavity. (All four
  /// are evaluated even if the first is good enough, because a processor could not predict a branch
  /// on this condition.)
  using Positions = std::array<LatticePoint, 4>;

  /// flaws_of() returns at least this number for a position that is not allowed.
  static constexpr std::int32_t kManyFlaws = 1 << 20;
  /// Returns the number of flaws (Candidate::flaws) that a point at each position would have if it
  /// replaced this cavity. For positions that are not allowed, the number is at least kManyFlaws. A
  /// position is not allowed if it lies on or beyond an edge of the boundary, or is too near to a
  /// vertex. For a point in the material, a position that encroaches upon the outline is not
  /// allowed either.
  template <PointKind kKind>
  [[gnu::always_inline]] Four flaws_of(const Positions& positions, const InsertionCavity& cavity,
                                       double min_distance2) const {
    const LatticePoint o = cavity.origin;
    const FourPoints p = narrowed(from_origin(positions[0], positions[1], o),
                                  from_origin(positions[2], positions[3], o));
    const bool is_near_origin = cavity.is_near_origin() && !is_any(is_beyond_max_offset(p));
    const Clearance clearance(min_distance2);
    Four flaws{}, is_excluded{};
    const std::span<const BoundaryQuad> quads = cavity.quads();
    for (std::size_t k = 0; k < cavity.boundary().size(); ++k) {
      const BoundaryQuad& r = quads[k / 4];
      const FourResults result = evaluate_four(
          is_near_origin, four_times(r.a, k % 4), four_times(r.b, k % 4), p, clearance, [&] {
            const InsertionCavity::BoundaryEdge& edge = cavity.boundary()[k];
            FourTriangles out;
            for (std::size_t i = 0; i < 4; ++i)
              out[i] = {at(edge.a), at(edge.b), positions[i]};
            return out;
          });
      flaws += result.is_bad;
      is_excluded |= result.is_turned | result.is_near;
      if (kKind == PointKind::kSplit) {
        flaws += (four_of(r.is_outline[k % 4]) & result.is_obtuse_at_p) +
                 (four_of(r.is_before[k % 4]) & result.is_obtuse_at_a) +
                 (four_of(r.is_after[k % 4]) & result.is_obtuse_at_b);
      } else {
        is_excluded |= four_of(r.is_outline[k % 4]) & result.is_obtuse_at_p;
      }
    }
    return -flaws | (is_excluded & four_of(kManyFlaws));
  }
  /// The result of fewest_of(): among the positions that `is_allowed_position` marks, the one with
  /// the fewest flaws. If several have equally few flaws, it is the first of them.
  struct Fewest {
    std::int32_t flaws;
    std::size_t position;
  };
  static Fewest fewest_of(Four flaws, Four is_allowed_position) {
    const Four keys = 4 * (flaws | (~is_allowed_position & four_of(kManyFlaws))) + Four{0, 1, 2, 3};
    const std::int32_t key = std::min(std::min(keys[0], keys[1]), std::min(keys[2], keys[3]));
    return {key >> 2, static_cast<std::size_t>(key & 3)};
  }
  /// Calls visit(k) for each edge k of the boundary that `mask` marks. `mask` is a member of
  /// BoundaryQuad, for example is_bad.
  template <typename Visit>
  [[gnu::always_inline]] static void for_each_edge(const InsertionCavity& cavity,
                                                   Four BoundaryQuad::*mask, Visit visit) {
    const std::span<const BoundaryQuad> quads = cavity.quads();
    for (std::size_t k = 0; k < quads.size(); ++k) {
      for (unsigned bits = bits_of(quads[k].*mask); bits != 0; bits &= bits - 1)
        visit(4 * k + static_cast<std::size_t>(std::countr_zero(bits)));
    }
  }

 private:
  LatticePoint at(std::uint32_t v) const { return mesh_.points[v]; }

  // Results for four triangles between edges of the boundary and points, as masks.
  struct FourResults {
    Four is_bad, is_turned, is_near, is_obtuse_at_p, is_obtuse_at_a, is_obtuse_at_b;
  };
  using FourTriangles = std::array<TriangleCorners, 4>;
  // Evaluates triangles one by one. This is slow, but sets no limit on the coordinates.
  [[gnu::noinline]] FourResults evaluate_each(const FourTriangles& triangles,
                                              double min_distance2) const {
    FourResults out{};
    for (std::size_t k = 0; k < 4; ++k) {
      const auto [a, b, p] = triangles[k];
      const TriangleShape shape = bounds_.shape(a, b, p);
      const auto mask = [](bool is) { return is ? -1 : 0; };
      out.is_bad[k] = mask(shape.is_bad());
      out.is_turned[k] = mask(shape.doubled_area <= 0);
      out.is_near[k] = mask(static_cast<double>(distance2(a, p)) < min_distance2);
      out.is_obtuse_at_p[k] = mask(diametral_dot(a, b, p) < 0);
      out.is_obtuse_at_a[k] = mask(diametral_dot(b, p, a) < 0);
      out.is_obtuse_at_b[k] = mask(diametral_dot(p, a, b) < 0);
    }
    return out;
  }
  [[gnu::noinline]] Four is_each_large(const FourTriangles& triangles) const {
    Four out{};
    for (std::size_t k = 0; k < 4; ++k)
      out[k] = bounds_.shape(triangles[k][0], triangles[k][1], triangles[k][2]).is_large ? -1 : 0;
    return out;
  }

  // The square of the least allowed distance from other vertices.
  struct Clearance {
    explicit Clearance(double distance2)
        : exact(distance2), whole(static_cast<std::int32_t>(std::min(distance2, 0x1p30))) {
      whole += whole < distance2 ? 1 : 0;
    }
    double exact;
    std::int32_t whole;  // `exact`, rounded up
  };
  // Evaluates the four triangles from[k], to[k], p[k]. `triangles` returns the same four triangles
  // with full coordinates. It is called only if 16-bit coordinates or floats do not suffice, or if
  // the bound on the area depends on the position and may be violated.
  template <typename Triangles>
  [[gnu::always_inline]] FourResults evaluate_four(bool is_near_origin, FourPoints from,
                                                   FourPoints to, FourPoints p,
                                                   const Clearance& clearance,
                                                   Triangles triangles) const {
    if (!is_near_origin) [[unlikely]]
      return evaluate_each(triangles(), clearance.exact);
    const BoundaryTriangles v = boundary_triangles(from, to, p);
    const Sharpness sharp = sharpness(v, anywhere_);
    if (is_any(sharp.is_unsure)) [[unlikely]]
      return evaluate_each(triangles(), clearance.exact);
    Four is_large = v.doubled_area > anywhere_.doubled_area;
    if (bounds_.has_area_at() && is_any(is_large)) [[unlikely]]
      is_large = is_each_large(triangles());
    return {sharp.is_sharp | is_large,
            v.doubled_area <= 0,
            v.pa2 < four_of(clearance.whole),
            v.at_p < 0,
            v.at_a < 0,
            v.at_b < 0};
  }

  const RefinementMesh& mesh_;
  const TriangleBounds& bounds_;
  QuickShapeLimits anywhere_;
};

// Finds, for an edge that two regions share during refinement, the same edge in the other region.
// Each region has its own vertices, so a shared edge exists twice. SharedEdges therefore records
// which vertices of the two regions are copies of each other. The header also chooses the points at
// which a shared edge is split.

/// Returns up to two positions at which to split a shared edge ab near the given fraction of the
/// way from a to b. The triangles on the two sides of the edge are (a, b, c) and (b, a, d). The
/// positions are the nearest lattice points on either side of ab at which the edge may be split. A
/// split beside the edge takes area from one region and gives it to the other. `lost` is twice the
/// area, in steps^2, that the region of c has lost along this border so far; it is negative if that
/// region has gained area. The position that leaves the smaller loss or gain comes first.
std::array<std::optional<LatticePoint>, 2> shared_split_points(LatticePoint a, LatticePoint b,
                                                               LatticePoint c, LatticePoint d,
                                                               double fraction, std::int64_t lost);

/// Returns true if an edge of the outline may be split at p. If p lies on the edge or on its
/// inner side, may_split() decides. If p lies beyond the edge, p must lie in the circle whose
/// diameter is the edge, and in the circumcircle of the edge's triangle. (The mesh would
/// otherwise cease to be Delaunay.)
bool may_split_either_way(const RefinementMesh& mesh, EdgeId edge, LatticePoint p);

class SharedEdges {
 public:
  void clear() {
    leaving_.clear();
    copies_.clear();
  }

  /// Records the edges of a new triangle that are on the outline.
  void note(const RefinementMesh& mesh, std::uint32_t t) {
    leaving_.resize(mesh.points.size(), kNoEdge);
    for (std::uint32_t i = 0; i < 3; ++i) {
      if ((mesh.triangles[t].beyond[i] & kOutline) != 0)
        leaving_[mesh.triangles[t].v[i]] = edge_id(t, i);
    }
  }
  /// Records that a shared edge was split: `here` and `there` are the new vertices on its two
  /// sides. Precondition: here < there.
  void add_copies(std::uint32_t here, std::uint32_t there) {
    copies_.resize(there + 1, 0);
    copies_[here] = there;
    copies_[there] = here;
  }

  /// The edge of the other region that coincides with e; kNoEdge if there is none.
  EdgeId beyond(EdgeId e, const RefinementMesh& mesh, const RefinementOutline& outline) const {
    const std::uint32_t segment = mesh.beyond(e) ^ kOutline, twin = outline.twin(segment);
    if (twin == RefinementOutline::kNoTwin) return kNoEdge;
    const std::uint32_t end = mesh.ends(e).second;
    return leaving_[end == outline.segments()[segment].to ? outline.segments()[twin].from
                                                          : copies_[end]];
  }

 private:
  std::vector<EdgeId> leaving_;  // for each vertex: the outline's edge that starts there
  // The copy, in the other region, of each vertex at which a shared edge was split.
  std::vector<std::uint32_t> copies_;
};

// The part of refinement that concerns the outline. OutlineSplitter keeps lists of the bad
// triangles and of the encroached edges, and splits edges of the outline. (An edge of the outline
// is encroached upon if the apex of its triangle lies in the circle whose diameter is the edge.)

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

// Finds the boundary of a refined mesh, with one ring for each ring of the outline that was meshed.

/// Returns one ring for each ring of `outline`, in the same order. `outline` is the outline that
/// was meshed to obtain `refined`. A returned ring contains the vertices of the corresponding ring
/// of `outline` and, between them, the points at which refinement split the ring's edges. Together
/// the returned rings are the boundary of the mesh. O(n log n).
Pslg refined_rings(const Refined& refined, const Pslg& outline);

}  // namespace trocar
