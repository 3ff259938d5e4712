// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/local_refinement.h"

#include <limits>
#include <numbers>

namespace trocar {

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

bool circumcircle_contains(const SheetMesh& mesh, std::uint32_t t, LatticePoint p) noexcept {
  const auto [a, b, c] = corners(mesh, t);
  return in_circle(a, b, c, p) > 0;
}

bool is_acute(LatticePoint corner, LatticePoint next, LatticePoint previous) noexcept {
  if (orient2d(corner, next, previous) <= 0) return false;
  const double dot = static_cast<double>(diametral_dot(next, previous, corner));
  const double lengths2 = static_cast<double>(distance2(corner, next)) *
                          static_cast<double>(distance2(corner, previous));
  return dot > 0 && dot * dot > kAcuteCorner_cos * kAcuteCorner_cos * lengths2;
}

std::uint32_t edge_towards(const SheetMesh& mesh, std::uint32_t t, std::uint32_t from) noexcept {
  return mesh.across[t][0] == from ? 0 : mesh.across[t][1] == from ? 1 : 2;
}

// Returns the boundary edge that ends where the boundary edge e starts (`turn` is previous_corner), or
// that starts where e ends (next_corner). It is found by turning around that vertex.
template <typename Turn>
TriangleEdge next_to(const SheetMesh& mesh, TriangleEdge e, const Turn& turn) noexcept {
  std::uint32_t t = e.triangle, on = turn(e.edge);
  while (mesh.across[t][on] != kNoSlot) {
    const std::uint32_t next = mesh.across[t][on];
    on = turn(edge_towards(mesh, next, t));
    t = next;
  }
  return {t, on};
}

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
      if (task && removal_.plan(mesh_, t, previous_corner(task->edge)))
        remove_vertex();
      else
        give_up(t, kApexStays);
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
      if (boundary[k].inside.triangle == e.triangle && boundary[k].inside.edge == e.edge)
        number = k;
      else if (!options_.split_outline && blocks_point(boundary[k], *p))
        return Step::kOutline;
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

PointInsertion::PointInsertion(std::size_t vertex_slots, std::size_t triangle_slots)
    : visited_(triangle_slots, 0), starting_(vertex_slots, kNoSlot) {
  cavity_.reserve(kMaxCavity);
  boundary_.reserve(kMaxCavity + 2);
  star_.reserve(kMaxCavity + 2);
}

bool PointInsertion::find(const SheetMesh& mesh, std::uint32_t start, LatticePoint p) noexcept {
  cavity_.clear();
  boundary_.clear();
  if (!circumcircle_contains(mesh, start, p)) return false;
  if (++search_ == 0) {  // the counter has wrapped around: old marks could equal new ones
    std::fill(visited_.begin(), visited_.end(), 0);
    search_ = 1;
  }
  visited_[start] = search_;
  cavity_.push_back(start);
  for (std::size_t k = 0; k < cavity_.size(); ++k) {
    const std::uint32_t t = cavity_[k];
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t beyond = mesh.across[t][i];
      if (beyond != kNoSlot && visited_[beyond] == search_) continue;
      if (beyond != kNoSlot && circumcircle_contains(mesh, beyond, p)) {
        if (cavity_.size() == kMaxCavity) return false;
        visited_[beyond] = search_;
        cavity_.push_back(beyond);
        continue;
      }
      if (boundary_.size() == kMaxCavity + 2) return false;
      boundary_.push_back(
          {mesh.triangles[t][i], mesh.triangles[t][next_corner(i)], beyond, {t, i}});
    }
  }
  return true;
}

InsertionOutcome PointInsertion::insert(SheetMesh& mesh, SheetEdit& edit, LatticePoint p,
                                        std::uint32_t split) noexcept {
  // If the cavity's boundary is one loop, it has two edges more than the cavity has triangles.
  if (boundary_.size() != cavity_.size() + 2) return InsertionOutcome::kNotVisible;
  for (std::uint32_t k = 0; k < boundary_.size(); ++k) {
    if (k == split) continue;
    if (orient2d(mesh.vertices[boundary_[k].from], mesh.vertices[boundary_[k].to], p) <= 0)
      return InsertionOutcome::kNotVisible;
  }
  const std::size_t star_size = boundary_.size() - (split == kNoSlot ? 0 : 1);
  if (mesh.free_vertices.empty() || mesh.free_triangles.size() + cavity_.size() < star_size)
    return InsertionOutcome::kCapacity;

  vertex_ = edit.take_vertex(mesh, p);
  star_.clear();
  for (const std::uint32_t t : cavity_) {
    edit.touch_triangle(mesh, t);
    star_.push_back(t);
  }
  while (star_.size() < star_size)
    star_.push_back(edit.take_triangle(mesh, {vertex_, vertex_, vertex_}));
  // Link the neighbours outside first, because the triangles in the cavity are overwritten below.
  if (split != kNoSlot) {
    starting_[boundary_[split].from] = kNoSlot;  // no other edge starts there
    boundary_.erase(boundary_.begin() + split);
  }
  for (std::size_t k = 0; k < star_size; ++k) {
    const CavityEdge& r = boundary_[k];
    starting_[r.from] = star_[k];
    if (r.beyond == kNoSlot) continue;
    edit.touch_triangle(mesh, r.beyond);
    mesh.across[r.beyond][corner_of(mesh.triangles[r.beyond], r.to)] = star_[k];
  }
  for (std::size_t k = 0; k < star_size; ++k) {
    mesh.triangles[star_[k]] = {boundary_[k].from, boundary_[k].to, vertex_};
    mesh.across[star_[k]] = {boundary_[k].beyond, kNoSlot, kNoSlot};
  }
  for (std::size_t k = 0; k < star_size; ++k) {
    const std::uint32_t next = starting_[boundary_[k].to];
    if (next == kNoSlot) continue;  // the edge that was split
    mesh.across[star_[k]][1] = next;
    mesh.across[next][2] = star_[k];
  }
  return InsertionOutcome::kDone;
}

SplitAim aim_split(const SheetMesh& mesh, TriangleEdge e, int parts) noexcept {
  const LatticePoint a = mesh.vertices[mesh.triangles[e.triangle][e.edge]];
  const LatticePoint b = mesh.vertices[mesh.triangles[e.triangle][next_corner(e.edge)]];
  const TriangleEdge back = next_to(mesh, e, previous_corner), on = next_to(mesh, e, next_corner);
  const LatticePoint before = mesh.vertices[mesh.triangles[back.triangle][back.edge]];
  const LatticePoint after = mesh.vertices[mesh.triangles[on.triangle][next_corner(on.edge)]];
  const bool acute_at_a = is_acute(a, b, before), acute_at_b = is_acute(b, after, a);
  if (acute_at_a == acute_at_b) {
    const int before_it = parts / 2;
    return {static_cast<double>(before_it) / parts, false, false};
  }
  const double length = std::sqrt(static_cast<double>(distance2(a, b)));
  double shell = 1;  // the power of two in (1/3, 2/3] of the length
  while (shell <= length / 3)
    shell *= 2;
  return {acute_at_a ? shell / length : 1 - shell / length, acute_at_a, acute_at_b};
}

bool VertexRemoval::plan(const SheetMesh& mesh, std::uint32_t t, std::uint32_t corner) noexcept {
  // Turn counter-clockwise around the vertex; each triangle contributes the edge opposite to it.
  vertex_ = mesh.triangles[t][corner];
  degree_ = 0;
  std::uint32_t at = t;
  do {
    if (degree_ == kMaxDegree) return false;
    const std::uint32_t i = corner_of(mesh.triangles[at], vertex_);
    star_[degree_] = at;
    polygon_[degree_] = mesh.triangles[at][next_corner(i)];
    beyond_[degree_] = {false, mesh.across[at][next_corner(i)]};
    ++degree_;
    at = mesh.across[at][previous_corner(i)];
    if (at == kNoSlot) return false;
  } while (at != t);
  if (degree_ < 3) return false;

  std::size_t size = degree_;
  for (std::uint32_t number = 0; size > 3; ++number) {
    std::size_t k = 0;
    while (k < size && !is_ear(mesh, (k + size - 1) % size, k, (k + 1) % size, size))
      ++k;
    if (k == size) return false;
    const std::size_t previous = (k + size - 1) % size;
    ears_[number] = {{polygon_[previous], polygon_[k], polygon_[(k + 1) % size]},
                     {beyond_[previous], beyond_[k]}};
    beyond_[previous] = {true, number};
    std::copy(polygon_.begin() + k + 1, polygon_.begin() + size, polygon_.begin() + k);
    std::copy(beyond_.begin() + k + 1, beyond_.begin() + size, beyond_.begin() + k);
    --size;
  }
  if (!is_ear(mesh, 0, 1, 2, 3)) return false;
  ears_[degree_ - 3] = {{polygon_[0], polygon_[1], polygon_[2]}, {beyond_[0], beyond_[1]}};
  last_ = beyond_[2];
  return true;
}

bool VertexRemoval::is_ear(const SheetMesh& mesh, std::size_t previous, std::size_t at,
                           std::size_t next, std::size_t size) const noexcept {
  const LatticePoint a = mesh.vertices[polygon_[previous]], b = mesh.vertices[polygon_[at]],
                     c = mesh.vertices[polygon_[next]];
  if (orient2d(a, b, c) <= 0) return false;
  for (std::size_t k = 0; k < size; ++k) {
    if (k != previous && k != at && k != next && in_circle(a, b, c, mesh.vertices[polygon_[k]]) > 0)
      return false;
  }
  return true;
}

void VertexRemoval::remove(SheetMesh& mesh, SheetEdit& edit) noexcept {
  const std::size_t ears = degree_ - 2;
  for (std::size_t k = 0; k < ears; ++k)
    edit.touch_triangle(mesh, star_[k]);
  const auto link = [&](std::uint32_t ear, std::uint32_t edge, Beyond beyond) {
    const std::uint32_t own = star_[ear];
    if (beyond.is_ear) {
      mesh.across[own][edge] = star_[beyond.number];
      mesh.across[star_[beyond.number]][2] = own;
      return;
    }
    mesh.across[own][edge] = beyond.number;
    if (beyond.number == kNoSlot) return;
    edit.touch_triangle(mesh, beyond.number);
    const std::uint32_t to = ears_[ear].corners[next_corner(edge)];
    mesh.across[beyond.number][corner_of(mesh.triangles[beyond.number], to)] = own;
  };
  for (std::uint32_t ear = 0; ear < ears; ++ear)
    mesh.triangles[star_[ear]] = ears_[ear].corners;
  for (std::uint32_t ear = 0; ear < ears; ++ear) {
    link(ear, 0, ears_[ear].across[0]);
    link(ear, 1, ears_[ear].across[1]);
  }
  link(static_cast<std::uint32_t>(ears - 1), 2, last_);
  for (const std::uint32_t t : freed())
    edit.release_triangle(mesh, t);
  edit.release_vertex(mesh, vertex_);
}

}  // namespace trocar
