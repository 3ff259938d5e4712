// SPDX-License-Identifier: Apache-2.0
#include "runtime/local_refinement/local_refinement.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "formats/geometry/edge_predicates.h"
#include "formats/geometry/segment_split.h"
#include "formats/geometry/steiner_points.h"
#include "formats/geometry/triangle_shape.h"
#include "runtime/local_refinement/split_aim.h"

namespace trocar::runtime {

LocalRefinementWorkspace::LocalRefinementWorkspace(std::size_t vertex_slots,
                                                   std::size_t triangle_slots)
    : insertion_(vertex_slots, triangle_slots),
      queue_(triangle_slots),
      marks_(triangle_slots, 0),
      is_new_(vertex_slots, 0) {}

namespace {

// The largest minimum angle: with a larger one the method might not terminate before
// max_new_vertices.
constexpr double kMaxAngle_deg = 30;
// A triangle whose shortest edge is shorter than this, in steps, is left as it is, because rounding
// to the lattice would determine its angles.
constexpr double kMinEdge = 4;
// Boundary edges are not split into edges shorter than this, in steps.
constexpr double kMinSplitEdge = 1;
// Largest ratio of a new edge that is inserted because of the size to the edge at which it starts.
constexpr double kMaxGrowth = 2;
// A boundary edge longer than this times the wanted length is split.
constexpr double kLongEdge = 1.5;
// A lattice point exactly on an edge is used if its distance from the aim is at most this fraction
// of the edge. Otherwise a point next to the edge is used, if that is allowed.
constexpr double kNearEnough = 0.02;

// The marks of a triangle, one bit each. kInspected: it was inspected. kEdgesLeft: its boundary
// edges are left as they are. kAtOutline, kAtLattice, kSizeLeft: the triangle is left as it is
// because of the outline, because of the lattice, or because only its size is too large.
// kApexStays: its apex is not removed.
constexpr std::uint8_t kInspected = 1, kEdgesLeft = 2, kAtOutline = 4, kAtLattice = 8,
                       kSizeLeft = 16, kApexStays = 32;
constexpr std::uint8_t kLeft = kAtOutline | kAtLattice | kSizeLeft;

// Further positions for a new point, between the AngleCircle over the shortest edge and the edge.
// They are given by factors of the distance from the edge, and by sine and cosine of the angle
// from the off-centre.
constexpr std::array<double, 3> kDistanceFactors{0.95, 0.66, 0.4};
constexpr std::array<std::array<double, 2>, 5> kDirections{
    {{0, 1}, {-0.5, 0.8660254}, {0.5, 0.8660254}, {-0.8660254, 0.5}, {0.8660254, 0.5}}};

}  // namespace

class LocalRefiner {
 public:
  LocalRefiner(SheetMesh& mesh, SheetEdit& edit, const LocalRefinementOptions& options,
               LocalRefinementWorkspace& workspace) noexcept
      : mesh_(mesh),
        edit_(edit),
        options_(options),
        insertion_(workspace.insertion_),
        removal_(workspace.removal_),
        queue_(workspace.queue_),
        marks_(workspace.marks_),
        is_new_(workspace.is_new_) {
    if (!(options.min_angle_deg > 0)) return;
    const double angle = std::min(options.min_angle_deg, kMaxAngle_deg) * std::numbers::pi / 180;
    cos2_ = std::cos(angle) * std::cos(angle);
    circle_ = AngleCircle(angle);
  }

  LocalRefinementResult run(std::span<const std::uint32_t> seeds) noexcept {
    if (mesh_.triangles.size() > marks_.size() || mesh_.vertices.size() > is_new_.size()) {
      result_.outcome = LocalRefinementOutcome::kCapacity;
      return result_;
    }
    for (const std::uint32_t t : seeds) {
      if (t < mesh_.triangles.size() && mesh_.in_use(t)) inspect(t);
    }
    while (!queue_.empty()) {
      if (result_.vertices_added >= options_.max_new_vertices) {
        result_.outcome = LocalRefinementOutcome::kBudget;
        break;
      }
      const std::uint32_t t = queue_.top();
      const bool fits = queue_.top_key() < 0 ? work_at_edges(t) : work_at_triangle(t);
      if (!fits) {
        result_.outcome = LocalRefinementOutcome::kCapacity;
        break;
      }
    }
    queue_.clear();
    count(seeds);
    return result_;
  }

 private:
  enum class Step { kDone, kOutline, kLattice, kLargeEnough, kCapacity };

  LatticePoint start_of(TriangleEdge e) const noexcept {
    return mesh_.vertices[mesh_.triangles[e.triangle][e.edge]];
  }
  LatticePoint end_of(TriangleEdge e) const noexcept {
    return mesh_.vertices[mesh_.triangles[e.triangle][next_corner(e.edge)]];
  }
  LatticePoint apex_of(TriangleEdge e) const noexcept {
    return mesh_.vertices[mesh_.triangles[e.triangle][previous_corner(e.edge)]];
  }
  bool is_boundary(TriangleEdge e) const noexcept {
    return mesh_.across[e.triangle][e.edge] == kNoSlot;
  }
  bool is_kept(TriangleEdge e) const noexcept {
    return options_.keep_edge &&
           options_.keep_edge(mesh_.triangles[e.triangle][e.edge],
                              mesh_.triangles[e.triangle][next_corner(e.edge)]);
  }
  double wanted_length(double x, double y) const noexcept {
    return options_.size ? options_.size(x, y) : std::numeric_limits<double>::infinity();
  }

  // ---- sharp or large triangles, long or obtuse edges ----

  bool is_obtuse(TriangleEdge e) const noexcept {
    return encroaches(start_of(e), end_of(e), apex_of(e));
  }

  // Returns true if an edge is more obtuse than rounding to the lattice can make it. Rounding can
  // make edges obtuse that lie on one shell around their common corner.
  bool is_encroached(TriangleEdge e) const noexcept {
    const double own = edge_length(start_of(e), end_of(e));
    for (const std::uint32_t other : {next_corner(e.edge), previous_corner(e.edge)}) {
      const TriangleEdge o{e.triangle, other};
      if (is_boundary(o) && own - edge_length(start_of(o), end_of(o)) <= kSameShell_steps)
        return false;
    }
    return true;
  }

  // Returns the number of edges of the wanted length into which an edge should be split.
  int split_count(TriangleEdge e) const noexcept {
    if (!options_.size) return 1;
    const LatticePoint a = start_of(e), b = end_of(e);
    const double wanted = wanted_length(0.5 * (static_cast<double>(a.x) + b.x),
                                        0.5 * (static_cast<double>(a.y) + b.y));
    const double ratio = edge_length(a, b) / wanted;
    return ratio >= kLongEdge ? static_cast<int>(std::lrint(std::min(ratio, 1e6))) : 1;
  }

  struct Task {
    enum What { kSplit, kClear } what;
    std::uint32_t edge;
    std::int64_t length2;
  };

  // Returns the task for the longest boundary edge of the triangle that is too long or obtuse. If
  // an inner vertex that is not new makes it obtuse, the task is to remove that vertex; otherwise,
  // to split the edge.
  std::optional<Task> task_at_edges(std::uint32_t t) const noexcept {
    std::optional<Task> task;
    for (std::uint32_t i = 0; i < 3; ++i) {
      const TriangleEdge e{t, i};
      if (!is_boundary(e)) continue;
      const std::int64_t length2 = distance2(start_of(e), end_of(e));
      if (task && task->length2 >= length2) continue;
      const bool may_split = options_.split_outline && (marks_[t] & kEdgesLeft) == 0;
      const bool is_long = may_split && split_count(e) > 1, is_obtuse = this->is_obtuse(e);
      if ((!is_long && !is_obtuse) || is_kept(e)) continue;
      if (!is_long && (marks_[t] & kApexStays) == 0 &&
          is_new_[mesh_.triangles[t][previous_corner(i)]] == 0) {
        task = {Task::kClear, i, length2};
      } else if (is_long || (may_split && is_encroached(e))) {
        task = {Task::kSplit, i, length2};
      }
    }
    return task;
  }

  bool is_sharp(const TriangleCorners& v) const noexcept { return is_angle_below_cosine(v, cos2_); }

  bool is_too_large(const TriangleCorners& v) const noexcept {
    if (!options_.size) return false;
    const double x = (static_cast<double>(v[0].x) + v[1].x + v[2].x) / 3,
                 y = (static_cast<double>(v[0].y) + v[1].y + v[2].y) / 3;
    const double largest = kMaxRadius * wanted_length(x, y);
    return circumradius2(v) > largest * largest;
  }

  // Inspects a triangle, and queues it if it has a defect that has not been given up. Boundary
  // edges are treated first, the longest first. Triangles follow, the finest first, so that sizes
  // grow outwards from the finest triangles.
  void inspect(std::uint32_t t) noexcept {
    marks_[t] |= kInspected;
    if (const std::optional<Task> task = task_at_edges(t)) {
      queue_.put(t, -task->length2);
      return;
    }
    if ((marks_[t] & kLeft) == 0) {
      const TriangleCorners v = corners(mesh_, t);
      if (is_sharp(v) || is_too_large(v)) {
        queue_.put(t, shortest_edge(v).length2);
        return;
      }
    }
    queue_.remove(t);
  }

  void inspect_new(std::uint32_t t) noexcept {
    marks_[t] = 0;
    inspect(t);
  }

  void give_up(std::uint32_t t, std::uint8_t mark) noexcept {
    marks_[t] |= mark;
    inspect(t);
  }

  // ---- insertion, removal, splits ----

  Step insert(LatticePoint p, std::uint32_t split) noexcept {
    switch (insertion_.insert(mesh_, edit_, p, split)) {
      case InsertionOutcome::kNotVisible:
        return Step::kLattice;
      case InsertionOutcome::kCapacity:
        return Step::kCapacity;
      case InsertionOutcome::kDone:
        break;
    }
    ++result_.vertices_added;
    is_new_[insertion_.vertex()] = 1;
    for (const std::uint32_t t : insertion_.star())
      inspect_new(t);
    return Step::kDone;
  }

  // Carries out the task at the triangle's boundary edges. Returns false if the capacity
  // does not suffice.
  bool work_at_edges(std::uint32_t t) noexcept {
    const std::optional<Task> task = task_at_edges(t);
    if (!task || task->what == Task::kClear) {
      if (task && removal_.plan(mesh_, t, previous_corner(task->edge))) {
        remove_vertex();
      } else {
        give_up(t, kApexStays);
      }
      return true;
    }
    const TriangleEdge e{t, task->edge};
    const Step step = split(e, std::max(split_count(e), 2), kMinSplitEdge);
    if (step != Step::kDone && step != Step::kCapacity) give_up(t, kEdgesLeft);
    return step != Step::kCapacity;
  }

  bool work_at_triangle(std::uint32_t t) noexcept {
    const Step step = improve(t);
    if (step == Step::kOutline) give_up(t, kAtOutline);
    if (step == Step::kLattice) give_up(t, kAtLattice);
    if (step == Step::kLargeEnough) give_up(t, kSizeLeft);
    return step != Step::kCapacity;
  }

  // Removes an end of a sharp triangle's shortest edge if it is an inner vertex and not new, and if
  // the removal leaves fewer sharp triangles.
  bool remove_crowding(std::uint32_t t) noexcept {
    const TriangleCorners v = corners(mesh_, t);
    if (!is_sharp(v)) return false;
    const std::uint32_t edge = shortest_edge(v).edge;
    for (const std::uint32_t corner : {edge, next_corner(edge)}) {
      if (is_new_[mesh_.triangles[t][corner]] != 0 || !removal_.plan(mesh_, t, corner)) continue;
      int growth = 0;
      for (std::size_t k = 0; k < removal_.ears(); ++k) {
        const Triangle& ear = removal_.ear(k);
        const TriangleCorners e{mesh_.vertices[ear[0]], mesh_.vertices[ear[1]],
                                mesh_.vertices[ear[2]]};
        growth += is_sharp(e) ? 1 : 0;
      }
      for (const std::uint32_t s : removal_.star())
        growth -= is_sharp(corners(mesh_, s)) ? 1 : 0;
      if (growth >= 0) continue;
      remove_vertex();
      return true;
    }
    return false;
  }

  void remove_vertex() noexcept {
    removal_.remove(mesh_, edit_);
    ++result_.vertices_removed;
    for (const std::uint32_t t : removal_.freed()) {
      marks_[t] = 0;
      queue_.remove(t);
    }
    for (const std::uint32_t t : removal_.filled())
      inspect_new(t);
  }

  // Splits a boundary edge, unless one of the new edges would be shorter than `shortest`.
  Step split(TriangleEdge e, int into, double shortest) noexcept {
    if (is_kept(e)) return Step::kOutline;
    const LatticePoint a = start_of(e), b = end_of(e);
    const SplitAim aim = aim_split(mesh_, e, into);
    std::optional<LatticePoint> p = split_on_edge(a, b, aim);
    if (options_.split_outline) {
      const double full = edge_length(a, b);
      if (!p || std::abs(edge_length(a, *p) - aim.fraction * full) > kNearEnough * full)
        p = split_beside_edge(a, b, apex_of(e), aim);
    }
    if (!p) return Step::kOutline;
    if (std::min(edge_length(a, *p), edge_length(*p, b)) < shortest) return Step::kOutline;
    if (!insertion_.find(mesh_, e.triangle, *p)) return Step::kLattice;
    std::uint32_t number = kNoSlot;
    const std::span<const CavityEdge> boundary = insertion_.boundary();
    for (std::uint32_t k = 0; k < boundary.size(); ++k) {
      if (boundary[k].inside.triangle == e.triangle && boundary[k].inside.edge == e.edge) {
        number = k;
      } else if (!options_.split_outline && blocks_point(boundary[k], *p)) {
        return Step::kOutline;
      }
    }
    const Step step = insert(*p, number);
    if (step == Step::kDone) result_.doubled_area_lost += orient2d(a, b, *p);
    return step;
  }

  bool blocks_point(const CavityEdge& r, LatticePoint p) const noexcept {
    return r.beyond == kNoSlot && blocks(mesh_.vertices[r.from], mesh_.vertices[r.to], p);
  }

  // Inserts a point on the bisector of the shortest edge, as far out as angle and size
  // allow, but no farther than the circumcentre. If a boundary edge blocks the point, that
  // edge is split instead.
  Step improve(std::uint32_t t) noexcept {
    const TriangleCorners v = corners(mesh_, t);
    const auto [edge, shortest2] = shortest_edge(v);
    const double shortest = std::sqrt(static_cast<double>(shortest2));
    if (shortest < kMinEdge) return Step::kLattice;
    const bool is_too_sharp = is_sharp(v);

    const LatticePoint p = v[edge], q = v[next_corner(edge)], r = v[previous_corner(edge)];
    // Compute the position of the opposite corner relative to the edge's middle, along the edge and
    // perpendicular to it, in units of the edge's length.
    const double qx = static_cast<double>(q.x) - p.x, qy = static_cast<double>(q.y) - p.y;
    const double rx = static_cast<double>(r.x) - p.x, ry = static_cast<double>(r.y) - p.y;
    const double along = (qx * rx + qy * ry) / (shortest * shortest) - 0.5;
    const double out = (qx * ry - qy * rx) / (shortest * shortest);
    const double circumcentre = (along * along + out * out - 0.25) / (2 * out);
    double height = circumcentre;
    if (is_too_sharp)
      height = std::min(height, circle_.off_centre_distance() * rounding_allowance(shortest));
    const double mx = 0.5 * qx, my = 0.5 * qy;
    if (is_too_large(v)) {
      const double guess = std::min(height, 1.0);
      const double wanted =
          wanted_length(p.x + (mx - guess * qy), p.y + (my + guess * qx)) / shortest;
      if (wanted * kLongEdge >= 1) {
        const double legs = std::clamp(wanted, std::numbers::sqrt2 / 2, kMaxGrowth);
        height = std::min(height, std::sqrt(legs * legs - 0.25));
      }
    }
    const double x = mx - height * qy, y = my + height * qx;
    if (!(std::abs(p.x + x) < kMaxCoordinate && std::abs(p.y + y) < kMaxCoordinate))
      return Step::kOutline;
    const LatticePoint position = round_half_away(p, x, y);
    if (!insertion_.find(mesh_, t, position)) return Step::kLattice;

    std::optional<TriangleEdge> blocking_edge;
    std::int64_t longest2 = 0;
    for (const CavityEdge& e : insertion_.boundary()) {
      if (!blocks_point(e, position)) continue;
      const std::int64_t length2 = distance2(mesh_.vertices[e.from], mesh_.vertices[e.to]);
      if (length2 > longest2) blocking_edge = e.inside, longest2 = length2;
    }
    if (!blocking_edge) return insert(position, kNoSlot);
    // If only the size is too large, the boundary edge is not split. (If it is too long itself, it
    // is split elsewhere.)
    if (!is_too_sharp) return Step::kLargeEnough;
    // The new edges must not be shorter than those of the triangle; otherwise splits at acute
    // corners would not end.
    const Step step = split(*blocking_edge, 2, shortest);
    if (step != Step::kOutline) return step;
    return remove_crowding(t) ? Step::kDone : insert_elsewhere(t);
  }

  // Tries other positions, from which the shortest edge subtends at least the wanted angle and
  // which no boundary edge blocks. Uses the position that leaves the fewest sharp triangles, if
  // there are fewer than before.
  Step insert_elsewhere(std::uint32_t t) noexcept {
    const TriangleCorners v = corners(mesh_, t);
    const std::uint32_t edge = shortest_edge(v).edge;
    const LatticePoint p = v[edge], q = v[next_corner(edge)];
    const double qx = static_cast<double>(q.x) - p.x, qy = static_cast<double>(q.y) - p.y;
    std::optional<LatticePoint> best;
    int least = 0;
    for (const double factor : kDistanceFactors) {
      for (const auto [sine, cosine] : kDirections) {
        const double along = 0.5 + factor * circle_.radius * sine;
        const double out = factor * (circle_.centre + circle_.radius * cosine);
        const LatticePoint at = round_half_away(p, along * qx - out * qy, along * qy + out * qx);
        if (!insertion_.find(mesh_, t, at)) continue;
        if (const std::optional<int> growth = growth_of_sharp(at); growth && *growth < least)
          best = at, least = *growth;
      }
    }
    if (!best) return Step::kOutline;
    insertion_.find(mesh_, t, *best);
    return insert(*best, kNoSlot);
  }

  // Returns the change of the number of sharp triangles if p is inserted; none if a boundary
  // edge blocks p.
  std::optional<int> growth_of_sharp(LatticePoint p) const noexcept {
    int growth = 0;
    for (const CavityEdge& r : insertion_.boundary()) {
      if (blocks_point(r, p)) return std::nullopt;
      growth += is_sharp({mesh_.vertices[r.from], mesh_.vertices[r.to], p}) ? 1 : 0;
    }
    for (const std::uint32_t t : insertion_.cavity())
      growth -= is_sharp(corners(mesh_, t)) ? 1 : 0;
    return growth;
  }

  // ---- the result ----

  void count(std::span<const std::uint32_t> seeds) noexcept {
    for (const std::uint32_t t : seeds) {
      if (t < mesh_.triangles.size()) count(t);
    }
    for (const SheetEdit::OldTriangle& old : edit_.triangles())
      count(old.slot);
    for (const SheetEdit::OldVertex& old : edit_.vertices())
      is_new_[old.slot] = 0;
    if (result_.outcome == LocalRefinementOutcome::kDone &&
        result_.sharp + result_.obtuse_edges > 0)
      result_.outcome = LocalRefinementOutcome::kLimitedByOutline;
  }

  void count(std::uint32_t t) noexcept {
    const std::uint8_t marks = marks_[t];
    marks_[t] = 0;
    if ((marks & kInspected) == 0) return;
    ++result_.inspected;
    const TriangleCorners v = corners(mesh_, t);
    if (is_sharp(v)) {
      ++result_.sharp;
      result_.sharp_at_outline += (marks & kAtOutline) != 0 ? 1 : 0;
      result_.sharp_at_lattice += (marks & kAtLattice) != 0 ? 1 : 0;
    }
    result_.too_large += is_too_large(v) ? 1 : 0;
    for (std::uint32_t i = 0; i < 3; ++i)
      result_.obtuse_edges += is_boundary({t, i}) && is_obtuse({t, i}) && !is_kept({t, i}) ? 1 : 0;
  }

  SheetMesh& mesh_;
  SheetEdit& edit_;
  const LocalRefinementOptions& options_;
  PointInsertion& insertion_;
  VertexRemoval& removal_;
  TriangleQueue& queue_;
  std::vector<std::uint8_t>&marks_, &is_new_;
  double cos2_ = std::numeric_limits<double>::infinity();  // squared cosine of the wanted angle
  AngleCircle circle_;                                     // circle of the wanted angle
  LocalRefinementResult result_;
};

LocalRefinementResult refine_locally(SheetMesh& mesh, SheetEdit& edit,
                                     std::span<const std::uint32_t> seeds,
                                     const LocalRefinementOptions& options,
                                     LocalRefinementWorkspace& workspace) noexcept {
  return LocalRefiner(mesh, edit, options, workspace).run(seeds);
}

}  // namespace trocar::runtime
