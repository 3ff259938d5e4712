// SPDX-License-Identifier: Apache-2.0
#include "runtime/refine/local_refinement.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

#include "runtime/refine/outline_split.h"
#include "runtime/refine/triangle_shape.h"

namespace trocar::runtime {

double GradedSize::operator()(double x, double y) const noexcept {
  const double dx = x - centre.x, dy = y - centre.y;
  const double beyond = std::sqrt(dx * dx + dy * dy) - radius;
  return std::min(at_radius + growth * std::max(beyond, 0.0), largest);
}

LocalRefinementWorkspace::LocalRefinementWorkspace(std::size_t vertex_slots,
                                                   std::size_t triangle_slots)
    : insertion_(vertex_slots, triangle_slots),
      queue_(triangle_slots),
      marks_(triangle_slots, 0),
      is_new_(vertex_slots, 0) {}

namespace {

// With larger angles the method might not end before its budget.
constexpr double kLargestAngle_deg = 30;
// A shorter side is not improved upon: rounding to the lattice would decide the angles.
constexpr double kShortestSide = 4;
// Boundary sides are not split into shorter ones.
constexpr double kShortestPiece = 1;
// By how many steps an off-centre is drawn nearer to its side, for rounding not to make its angle
// too small.
constexpr double kRounding = 1.5;
// New sides for the sake of size are no longer than this times the side that they start from.
constexpr double kLargestStep = 2;
// A boundary side longer than this times the wanted length is split.
constexpr double kLongSide = 1.5;
// A lattice point exactly on a side is taken if it is off the place aimed at by no more than this
// part of the side; else one beside the side, if that is allowed.
constexpr double kNearEnough = 0.02;
// Two boundary sides of a triangle whose lengths differ by no more than this are on one shell: the
// angle between one of them and the third side is above 90 degrees by rounding alone.
constexpr double kSameShell = 2;

// What is known of a triangle, by bits.
constexpr std::uint8_t kLookedAt = 1, kSidesLeft = 2, kAtOutline = 4, kAtLattice = 8,
                       kSizeLeft = 16, kApexStays = 32;
constexpr std::uint8_t kLeft = kAtOutline | kAtLattice | kSizeLeft;

// Other places for a new point, on the shortest side's bisector and turned away from it about the
// centre of the circle that sees the side under the wanted angle: in parts of that circle's radius,
// by the turn's sine and cosine.
constexpr std::array<double, 3> kReaches{0.95, 0.66, 0.4};
constexpr std::array<std::array<double, 2>, 5> kTurns{
    {{0, 1}, {-0.5, 0.8660254}, {0.5, 0.8660254}, {-0.8660254, 0.5}, {0.8660254, 0.5}}};

// The lattice point nearest to p + (x, y), of two the farther from p: rounded from p on, which is
// alike wherever p lies and however the plane is turned by right angles.
LatticePoint nearest(LatticePoint p, double x, double y) noexcept {
  return {p.x + static_cast<std::int32_t>(std::lround(x)),
          p.y + static_cast<std::int32_t>(std::lround(y))};
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
    const double angle =
        std::min(options.min_angle_deg, kLargestAngle_deg) * std::numbers::pi / 180;
    cos2_ = std::cos(angle) * std::cos(angle);
    radius_ = 0.5 / std::sin(angle);
    centre_ = 0.5 / std::tan(angle);
  }

  RefinementResult run(std::span<const std::uint32_t> seeds) noexcept {
    if (mesh_.triangles.size() > marks_.size() || mesh_.vertices.size() > is_new_.size()) {
      result_.outcome = RefinementOutcome::kNoRoom;
      return result_;
    }
    for (const std::uint32_t t : seeds) {
      if (t < mesh_.triangles.size() && mesh_.in_use(t)) look_at(t);
    }
    while (!queue_.empty()) {
      if (result_.vertices_added >= options_.max_new_vertices) {
        result_.outcome = RefinementOutcome::kBudget;
        break;
      }
      const std::uint32_t t = queue_.top();
      const bool has_room = queue_.top_key() < 0 ? work_at_sides(t) : work_at_triangle(t);
      if (!has_room) {
        result_.outcome = RefinementOutcome::kNoRoom;
        break;
      }
    }
    queue_.clear();
    count(seeds);
    return result_;
  }

 private:
  enum class Step { kDone, kOutline, kLattice, kLargeEnough, kNoRoom };

  struct Side {
    std::uint32_t triangle, side;
  };

  LatticePoint start_of(Side s) const noexcept {
    return mesh_.vertices[mesh_.triangles[s.triangle][s.side]];
  }
  LatticePoint end_of(Side s) const noexcept {
    return mesh_.vertices[mesh_.triangles[s.triangle][(s.side + 1) % 3]];
  }
  bool is_boundary(Side s) const noexcept { return mesh_.across[s.triangle][s.side] == kNone; }
  bool is_kept(Side s) const noexcept {
    return options_.keep_side && options_.keep_side(mesh_.triangles[s.triangle][s.side],
                                                    mesh_.triangles[s.triangle][(s.side + 1) % 3]);
  }
  double wanted_length(double x, double y) const noexcept {
    return options_.size ? options_.size(x, y) : std::numeric_limits<double>::infinity();
  }

  // ---- what is wrong with a triangle ----

  bool is_obtuse(Side s) const noexcept {
    const LatticePoint apex = mesh_.vertices[mesh_.triangles[s.triangle][(s.side + 2) % 3]];
    return diametral_dot(start_of(s), end_of(s), apex) < 0;
  }

  // Of an obtuse side: by more than what the lattice does to two sides on one shell around their
  // corner?
  bool is_encroached(Side s) const noexcept {
    const double own = side_length(start_of(s), end_of(s));
    for (const std::uint32_t other : {(s.side + 1) % 3, (s.side + 2) % 3}) {
      const Side o{s.triangle, other};
      if (is_boundary(o) && own - side_length(start_of(o), end_of(o)) <= kSameShell) return false;
    }
    return true;
  }

  // Into how many sides of the wanted length a side should be split.
  int pieces(Side s) const noexcept {
    if (!options_.size) return 1;
    const LatticePoint a = start_of(s), b = end_of(s);
    const double wanted = wanted_length(0.5 * (static_cast<double>(a.x) + b.x),
                                        0.5 * (static_cast<double>(a.y) + b.y));
    const double ratio = side_length(a, b) / wanted;
    return ratio >= kLongSide ? static_cast<int>(std::lrint(std::min(ratio, 1e6))) : 1;
  }

  struct Task {
    enum What { kSplit, kClear } what;
    std::uint32_t side;
    std::int64_t length2;
  };

  // What is to be done for the sake of a boundary side of the triangle, the longest first: clear it
  // of the vertex that makes it obtuse, if that is an inner one and not ours; else split it.
  std::optional<Task> task_at_sides(std::uint32_t t) const noexcept {
    std::optional<Task> task;
    for (std::uint32_t i = 0; i < 3; ++i) {
      const Side s{t, i};
      if (!is_boundary(s)) continue;
      const std::int64_t length2 = distance2(start_of(s), end_of(s));
      if (task && task->length2 >= length2) continue;
      const bool may_split = options_.split_outline && (marks_[t] & kSidesLeft) == 0;
      const bool is_long = may_split && pieces(s) > 1, is_obtuse = this->is_obtuse(s);
      if ((!is_long && !is_obtuse) || is_kept(s)) continue;
      if (!is_long && (marks_[t] & kApexStays) == 0 &&
          is_new_[mesh_.triangles[t][(i + 2) % 3]] == 0) {
        task = {Task::kClear, i, length2};
      } else if (is_long || (may_split && is_encroached(s))) {
        task = {Task::kSplit, i, length2};
      }
    }
    return task;
  }

  bool is_too_large(const Corners& v) const noexcept {
    if (!options_.size) return false;
    const double x = (static_cast<double>(v[0].x) + v[1].x + v[2].x) / 3,
                 y = (static_cast<double>(v[0].y) + v[1].y + v[2].y) / 3;
    const double largest = kLargestRadius * wanted_length(x, y);
    return circumradius2(v) > largest * largest;
  }

  // Queues the triangle if something is wrong with it and worth a try. Sides come first, the
  // longest before others; then triangles, the finest first: so size grows outwards from what is
  // fine.
  void look_at(std::uint32_t t) noexcept {
    marks_[t] |= kLookedAt;
    if (const std::optional<Task> task = task_at_sides(t)) {
      queue_.put(t, -task->length2);
      return;
    }
    if ((marks_[t] & kLeft) == 0) {
      const Corners v = corners(mesh_, t);
      if (is_sharp(v, cos2_) || is_too_large(v)) {
        queue_.put(t, shortest_side(v).length2);
        return;
      }
    }
    queue_.remove(t);
  }

  void look_at_new(std::uint32_t t) noexcept {
    marks_[t] = 0;
    look_at(t);
  }

  void give_up(std::uint32_t t, std::uint8_t mark) noexcept {
    marks_[t] |= mark;
    look_at(t);
  }

  // ---- what is done about it ----

  Step insert(LatticePoint p, std::uint32_t split) noexcept {
    switch (insertion_.insert(mesh_, edit_, p, split)) {
      case Insertion::kNotInSight:
        return Step::kLattice;
      case Insertion::kNoRoom:
        return Step::kNoRoom;
      case Insertion::kDone:
        break;
    }
    ++result_.vertices_added;
    is_new_[insertion_.vertex()] = 1;
    for (const std::uint32_t t : insertion_.star())
      look_at_new(t);
    return Step::kDone;
  }

  // False if there is no room.
  bool work_at_sides(std::uint32_t t) noexcept {
    const std::optional<Task> task = task_at_sides(t);
    if (!task || task->what == Task::kClear) {
      if (task && removal_.plan(mesh_, t, (task->side + 2) % 3)) {
        remove_vertex();
      } else {
        give_up(t, kApexStays);
      }
      return true;
    }
    const Side s{t, task->side};
    const Step step = split(s, std::max(pieces(s), 2), kShortestPiece);
    if (step != Step::kDone && step != Step::kNoRoom) give_up(t, kSidesLeft);
    return step != Step::kNoRoom;
  }

  bool work_at_triangle(std::uint32_t t) noexcept {
    const Step step = improve(t);
    if (step == Step::kOutline) give_up(t, kAtOutline);
    if (step == Step::kLattice) give_up(t, kAtLattice);
    if (step == Step::kLargeEnough) give_up(t, kSizeLeft);
    return step != Step::kNoRoom;
  }

  // Removes an end of a sharp triangle's shortest side, if that is an inner vertex and not ours and
  // fewer sharp triangles are left so.
  bool remove_crowding(std::uint32_t t) noexcept {
    const Corners v = corners(mesh_, t);
    if (!is_sharp(v, cos2_)) return false;
    const std::uint32_t side = shortest_side(v).side;
    for (const std::uint32_t corner : {side, (side + 1) % 3}) {
      if (is_new_[mesh_.triangles[t][corner]] != 0 || !removal_.plan(mesh_, t, corner)) continue;
      int growth = 0;
      for (std::size_t k = 0; k < removal_.ears(); ++k) {
        const Triangle& ear = removal_.ear(k);
        const Corners e{mesh_.vertices[ear[0]], mesh_.vertices[ear[1]], mesh_.vertices[ear[2]]};
        growth += is_sharp(e, cos2_) ? 1 : 0;
      }
      for (const std::uint32_t s : removal_.star())
        growth -= is_sharp(corners(mesh_, s), cos2_) ? 1 : 0;
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
      look_at_new(t);
  }

  // Splits a boundary side, unless a piece would be shorter than `shortest`.
  Step split(Side s, int into, double shortest) noexcept {
    if (is_kept(s)) return Step::kOutline;
    const LatticePoint a = start_of(s), b = end_of(s);
    const SplitAim aim = aim_split(mesh_, s.triangle, s.side, into);
    std::optional<LatticePoint> p = point_on_side(a, b, aim);
    if (options_.split_outline) {
      const double full = side_length(a, b);
      if (!p || std::abs(side_length(a, *p) - aim.fraction * full) > kNearEnough * full) {
        const LatticePoint apex = mesh_.vertices[mesh_.triangles[s.triangle][(s.side + 2) % 3]];
        p = point_beside_side(a, b, apex, aim);
      }
    }
    if (!p) return Step::kOutline;
    if (std::min(side_length(a, *p), side_length(*p, b)) < shortest) return Step::kOutline;
    if (!insertion_.find(mesh_, s.triangle, *p)) return Step::kLattice;
    std::uint32_t number = kNone;
    const std::span<const RimSide> rim = insertion_.rim();
    for (std::uint32_t k = 0; k < rim.size(); ++k) {
      if (rim[k].inside == s.triangle && rim[k].side == s.side) {
        number = k;
      } else if (!options_.split_outline && encroaches(rim[k], *p)) {
        return Step::kOutline;
      }
    }
    const Step step = insert(*p, number);
    if (step == Step::kDone) {
      ++result_.sides_split;
      result_.doubled_area_lost += orient2d(a, b, *p);
    }
    return step;
  }

  // Would p lie in the diametral circle of a boundary side, or on its other side?
  bool encroaches(const RimSide& r, LatticePoint p) const noexcept {
    if (r.beyond != kNone) return false;
    const LatticePoint a = mesh_.vertices[r.from], b = mesh_.vertices[r.to];
    return diametral_dot(a, b, p) < 0 || orient2d(a, b, p) <= 0;
  }

  // A new point on the bisector of the shortest side: as far out as angle and size allow, but no
  // farther than the circumcentre. If a boundary side is in its way, that is split instead.
  Step improve(std::uint32_t t) noexcept {
    const Corners v = corners(mesh_, t);
    const auto [side, shortest2] = shortest_side(v);
    const double shortest = std::sqrt(static_cast<double>(shortest2));
    if (shortest < kShortestSide) return Step::kLattice;
    const bool is_too_sharp = is_sharp(v, cos2_);

    const LatticePoint p = v[side], q = v[(side + 1) % 3], r = v[(side + 2) % 3];
    // From the side's middle, in units of the side: along it and out from it.
    const double qx = static_cast<double>(q.x) - p.x, qy = static_cast<double>(q.y) - p.y;
    const double rx = static_cast<double>(r.x) - p.x, ry = static_cast<double>(r.y) - p.y;
    const double along = (qx * rx + qy * ry) / (shortest * shortest) - 0.5;
    const double out = (qx * ry - qy * rx) / (shortest * shortest);
    const double circumcentre = (along * along + out * out - 0.25) / (2 * out);
    double height = circumcentre;
    if (is_too_sharp)
      height = std::min(height, (centre_ + radius_) * (1 - std::min(0.4, kRounding / shortest)));
    const double mx = 0.5 * qx, my = 0.5 * qy;
    if (is_too_large(v)) {
      const double guess = std::min(height, 1.0);
      const double wanted =
          wanted_length(p.x + (mx - guess * qy), p.y + (my + guess * qx)) / shortest;
      if (wanted * kLongSide >= 1) {
        const double legs = std::clamp(wanted, std::numbers::sqrt2 / 2, kLargestStep);
        height = std::min(height, std::sqrt(legs * legs - 0.25));
      }
    }
    const double x = mx - height * qy, y = my + height * qx;
    if (!(std::abs(p.x + x) < kMaxCoordinate && std::abs(p.y + y) < kMaxCoordinate))
      return Step::kOutline;
    const LatticePoint place = nearest(p, x, y);
    if (!insertion_.find(mesh_, t, place)) return Step::kLattice;

    std::optional<Side> in_the_way;
    std::int64_t longest2 = 0;
    for (const RimSide& s : insertion_.rim()) {
      if (!encroaches(s, place)) continue;
      const std::int64_t length2 = distance2(mesh_.vertices[s.from], mesh_.vertices[s.to]);
      if (length2 > longest2) in_the_way = Side{s.inside, s.side}, longest2 = length2;
    }
    if (!in_the_way) return insert(place, kNone);
    // For size alone no side is split that is not too long itself.
    if (!is_too_sharp) return Step::kLargeEnough;
    // Nor one into sides shorter than the triangle has: at sharp corners that would go on and on.
    const Step step = split(*in_the_way, 2, shortest);
    if (step != Step::kOutline) return step;
    return remove_crowding(t) ? Step::kDone : insert_elsewhere(t);
  }

  // Another place that sees the shortest side under the wanted angle or a wider one, is in no
  // boundary side's way, and leaves fewer sharp triangles; of such the one that leaves the fewest.
  Step insert_elsewhere(std::uint32_t t) noexcept {
    const Corners v = corners(mesh_, t);
    const std::uint32_t side = shortest_side(v).side;
    const LatticePoint p = v[side], q = v[(side + 1) % 3];
    const double qx = static_cast<double>(q.x) - p.x, qy = static_cast<double>(q.y) - p.y;
    std::optional<LatticePoint> best;
    int least = 0;
    for (const double reach : kReaches) {
      for (const auto [sine, cosine] : kTurns) {
        const double along = 0.5 + reach * radius_ * sine;
        const double out = reach * (centre_ + radius_ * cosine);
        const LatticePoint at = nearest(p, along * qx - out * qy, along * qy + out * qx);
        if (!insertion_.find(mesh_, t, at)) continue;
        if (const std::optional<int> growth = growth_of_sharp(at); growth && *growth < least)
          best = at, least = *growth;
      }
    }
    if (!best) return Step::kOutline;
    insertion_.find(mesh_, t, *best);
    return insert(*best, kNone);
  }

  // How many sharp triangles more there would be with p; none if p is in a boundary side's way.
  std::optional<int> growth_of_sharp(LatticePoint p) const noexcept {
    int growth = 0;
    for (const RimSide& r : insertion_.rim()) {
      if (encroaches(r, p)) return std::nullopt;
      growth += is_sharp({mesh_.vertices[r.from], mesh_.vertices[r.to], p}, cos2_) ? 1 : 0;
    }
    for (const std::uint32_t t : insertion_.cavity())
      growth -= is_sharp(corners(mesh_, t), cos2_) ? 1 : 0;
    return growth;
  }

  // ---- the end ----

  void count(std::span<const std::uint32_t> seeds) noexcept {
    for (const std::uint32_t t : seeds) {
      if (t < mesh_.triangles.size()) count(t);
    }
    for (const SheetEdit::OldTriangle& old : edit_.triangles())
      count(old.slot);
    for (const SheetEdit::OldVertex& old : edit_.vertices())
      is_new_[old.slot] = 0;
    if (result_.outcome == RefinementOutcome::kDone && result_.sharp + result_.obtuse_sides > 0)
      result_.outcome = RefinementOutcome::kOutlineInTheWay;
  }

  void count(std::uint32_t t) noexcept {
    const std::uint8_t marks = marks_[t];
    marks_[t] = 0;
    if ((marks & kLookedAt) == 0) return;
    ++result_.looked_at;
    const Corners v = corners(mesh_, t);
    if (is_sharp(v, cos2_)) {
      ++result_.sharp;
      result_.sharp_at_outline += (marks & kAtOutline) != 0 ? 1 : 0;
      result_.sharp_at_lattice += (marks & kAtLattice) != 0 ? 1 : 0;
    }
    result_.too_large += is_too_large(v) ? 1 : 0;
    for (std::uint32_t i = 0; i < 3; ++i)
      result_.obtuse_sides += is_boundary({t, i}) && is_obtuse({t, i}) && !is_kept({t, i}) ? 1 : 0;
  }

  SheetMesh& mesh_;
  SheetEdit& edit_;
  const LocalRefinementOptions& options_;
  PointInsertion& insertion_;
  VertexRemoval& removal_;
  TriangleQueue& queue_;
  std::vector<std::uint8_t>&marks_, &is_new_;
  // Of the wanted angle the squared cosine; and of the circle that sees a side of length 1 under it
  // the radius, and the centre's distance from the side.
  double cos2_ = std::numeric_limits<double>::infinity(), radius_ = 0, centre_ = 0;
  RefinementResult result_;
};

RefinementResult refine_locally(SheetMesh& mesh, SheetEdit& edit,
                                std::span<const std::uint32_t> seeds,
                                const LocalRefinementOptions& options,
                                LocalRefinementWorkspace& workspace) noexcept {
  return LocalRefiner(mesh, edit, options, workspace).run(seeds);
}

}  // namespace trocar::runtime
