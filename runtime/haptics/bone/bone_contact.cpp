// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/bone/bone_contact.h"

#include <cstdlib>

#include "runtime/haptics/bone/admissible_region.h"
#include "runtime/haptics/bone/holes.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;

constexpr double kLimit_m = 1e-3 * EdgeDistance::kReach_mm * (1 - 1e-6);

/// The contact passes from the surface to the face of the tip between kMaxSlope and twice that tangent.
double limited(double steepness, const ToolShape& tool) noexcept {
  const double face = std::clamp(1 / std::tan(tool.half_angle_rad), 0.0, kMaxSlope);
  const double part = std::clamp(steepness / kMaxSlope - 1, 0.0, 1.0);
  return std::min(steepness, kMaxSlope) * (1 - part) + face * part;
}

/// Downhill, away from the material. A gradient of 0 has no direction.
Vector2d downhill(const Vector2d& inwards, double steepness, const ToolShape& tool) noexcept {
  const double length = inwards.norm();
  return length > 0 ? Vector2d(inwards * (-limited(steepness, tool) / length)) : Vector2d::Zero();
}

/// Straight line through distances over depth, and the mean of their gradients.
class LineFit {
 public:
  void add(double depth_m, const EdgeDistance::Sample& at) noexcept {
    ++count_;
    depth_m_ += depth_m;
    distance_m_ += at.distance_m;
    depths_m2_ += depth_m * depth_m;
    mixed_m2_ += depth_m * at.distance_m;
    gradient_ += at.gradient;
  }
  /// Growth of the distance per depth. Needs two depths.
  double growth() const noexcept {
    return (count_ * mixed_m2_ - depth_m_ * distance_m_) /
           (count_ * depths_m2_ - depth_m_ * depth_m_);
  }
  Vector2d gradient() const noexcept { return gradient_ / count_; }

 private:
  double count_ = 0, depth_m_ = 0, distance_m_ = 0, depths_m2_ = 0, mixed_m2_ = 0;
  Vector2d gradient_ = Vector2d::Zero();
};

constexpr double kAhead_m = 3e-3;  // sheets down to this depth below the tip are evaluated
constexpr int kMinSheetsAhead = 3;
constexpr std::int32_t kNewOutline_steps =
    4;  // a sheet is evaluated again after a corner of the outline has moved farther
constexpr double kMostlyMaterial = 0.5;
// A surface is level under the tool if at least this fraction of the area of the tool's outline
// lies over material of the slices below it, and at most the rest over material of the slice above
// it.
constexpr double kLevel = 0.95;
constexpr double kNewRegion_m = 2e-4;
constexpr int kCheckedInTick = 2;   // number of sheets around the shaft evaluated per tick
constexpr double kWidening = 0.25;  // a yielded wall is cut in steps of this many radii
// A sheet has a hole under the tool if holes have reduced the coverage by at least this value.
constexpr double kHole = 0.25;
constexpr double kRounding_m = 1e-9;
constexpr double kTwist_s = 0.02;

bool has_moved(const LatticeOutline& a, const LatticeOutline& b) noexcept {
  if (a.size != b.size) return true;
  for (int i = 0; i < a.size; ++i) {
    if (std::abs(a.points[i].x - b.points[i].x) > kNewOutline_steps ||
        std::abs(a.points[i].y - b.points[i].y) > kNewOutline_steps)
      return true;
  }
  return false;
}

class BoneContactTick {
 public:
  // `T_device_tool`: pose of the tool in the tissue. `plate_tip_m`: depth of the tip on the plate,
  // to which the coupling can pull the tool within the tick.
  BoneContactTick(const BoneVolume& bone, std::span<const Sheet* const> sheets,
                  const Pose& T_device_tool, double plate_tip_m, std::span<SheetTrack> tracks,
                  BoneContactState& state) noexcept
      : bone_(bone),
        sheets_(sheets),
        tool_(T_device_tool),
        tracks_(tracks),
        state_(state),
        law_{.options = state.options,
             .plate = T_device_tool,
             .slabs = state.slabs,
             .state = state.law,
             .layers = {}} {
    tip_m_ = -(T_device_tool * bone.tool.tip_plate_m).z();
    low_m_ = std::max(tip_m_, plate_tip_m);
    law_.start_at(state.law.has_begun ? state.law.T_device_proxy : T_device_tool);
    choose_hole(law_);
    if (bone.twists)
      slice_push_ = slice_push(bone.shape, state.twist_rad_per_s, state.feed_m_per_s);
  }

  // Evaluates the sheets from the front (or from the tip, if it is not under load) down to kAhead_m
  // below the depth that the tip can reach in the tick, and at least kMinSheetsAhead of them.
  void evaluate_below() noexcept {
    const double front_m = state_.law.stretch_m > 0 ? state_.front_m : tip_m_;
    const int count = static_cast<int>(sheets_.size());
    int first = 0;
    while (first < count && bone_.sheets[first].bottom_m < front_m - 1e-6)
      ++first;
    int end = first;
    while (end < count &&
           (end - first < kMinSheetsAhead || bone_.sheets[end].top_m < low_m_ + kAhead_m))
      ++end;
    // Whether a slab is in a cortical shell depends on how far below it the material ends.
    int seen = end;
    while (seen < count &&
           bone_.sheets[seen].top_m < bone_.sheets[end - 1].bottom_m + bone_.shell_m)
      ++seen;
    for (int i = std::max(0, first - 1); i < std::min(count, seen + 1); ++i)
      refresh(i);
    for (int i = std::max(0, first - 1); i < std::min(count, end + 1); ++i) {
      SheetInContact& own = state_.sheets[i];
      own.strength_N = own.has_hu ? bone_.sheets[i].strength_N(bone_.shape, own.hu, slice_push_)
                                  : bone_.sheets[i].nominal_N;
    }
    for (int i = first; i < end; ++i)
      set_strength(i);
    state_.options.torsion_Nm =
        slice_push_ > 0 && first < count
            ? state_.sheets[first].share *
                  bone_.sheets[first].torsion_Nm(bone_.shape, state_.sheets[first].hu, slice_push_)
            : 0;
    if (state_.law.stretch_m <= 0 && first < count)
      state_.options.tip_N_per_m = bone_.sheets[first].tip_N_per_m;
  }

  // Finds the surface under the tip. Only slabs have one; sheets without thickness do not.
  void evaluate_surface() noexcept {
    state_.options.slope.reset();
    const int count = static_cast<int>(sheets_.size());
    int i = 0;
    while (i < count && bone_.sheets[i].bottom_m < state_.front_m - 1e-6)
      ++i;
    if (i == count || bone_.sheets[i].bottom_m <= bone_.sheets[i].top_m) return;
    if (bone_.sheets[i].top_m > low_m_ + kAhead_m) return;
    const Eigen::Vector3d tip = tool_ * bone_.tool.tip_plate_m;
    state_.options.slope = surface_slope(bone_, sheets_, i, state_.front_m, tip.head<2>());
  }

  // Takes the sheets around the shaft in turn, kCheckedInTick of them in a tick. Updates the
  // admissible region if the tool is beside the material, and cuts where a wall has yielded.
  void evaluate_around() noexcept {
    const int count = static_cast<int>(sheets_.size());
    for (int checked = 0, passed = 0; checked < kCheckedInTick && passed < count; ++passed) {
      const int i = state_.next_checked = (state_.next_checked + 1) % count;
      if (bone_.sheets[i].top_m > tip_m_ || bone_.sheets[i].bottom_m <= bone_.sheets[i].top_m)
        continue;
      ++checked;
      if (state_.sheets[i].is_beside) find_free(i, kNewRegion_m);
      cut_yielded(i);
    }
  }

  void request_passed() noexcept {
    const CuttingResult& result = state_.result;
    for (int k = result.passed_from; k < result.passed_to; ++k) {
      const int i = bone_.sheet_of_slab[k];
      const BoneSheet& sheet = bone_.sheets[i];
      if (k + 1 < sheet.first_slab + sheet.slabs) continue;  // not yet the sheet's last slab
      if (!(state_.sheets[i].share > kMinCoverage)) continue;
      request(i, outline_at(i, state_.law.T_device_proxy), true);
    }
  }

  bool backlog() const noexcept { return backlog_; }

 private:
  LatticeOutline outline_at(int i, const Pose& T_device_tool) const noexcept {
    return outline_on_lattice(bone_.tool, T_device_tool, sheets_[i]->transform, sheets_[i]->z_m);
  }

  // Whether the uncut sheet has material under the whole outline, so that only holes reduce the
  // coverage. Here `true` is certain, `false` is not. The time does not depend on the number of
  // triangles.
  bool is_deep_inside(int i, const LatticeOutline& outline,
                      const Eigen::Vector2d& at_m) const noexcept {
    const Sheet& sheet = *sheets_[i];
    double reach_m = 0;
    for (int k = 0; k < outline.size; ++k) {
      const Eigen::Vector2d corner_m = sheet.transform.to_scene(
          {static_cast<double>(outline.points[k].x), static_cast<double>(outline.points[k].y)});
      reach_m = std::max(reach_m, (corner_m - at_m).norm());
    }
    const EdgeDistance::Sample edge = sheet.edge->at(sheet.transform, at_m);
    return edge.distance_m > reach_m + sheet.edge->max_error_m();
  }

  void refresh(int i) noexcept {
    SheetInContact& own = state_.sheets[i];
    const SheetTrack& track = tracks_[i];
    const LatticeOutline outline = outline_at(i, tool_);
    const bool same_place = own.is_known && !has_moved(outline, own.outline);
    if (same_place && own.cuts == sheets_[i]->cuts && own.cuts_requested == track.cuts_requested)
      return;
    const Eigen::Vector2d at_m = axis_in(i, tool_);
    if (track.cuts_requested <= kMaxPendingHoles && is_deep_inside(i, outline, at_m)) {
      own.share = outline_outside(bone_.tool, outline, {own.holes.data(), track.cuts_requested});
    } else {
      own.share = overlap(*sheets_[i], bone_.tool, outline,
                          {track.pending.data(), static_cast<std::size_t>(track.pending_count)})
                      .coverage;
    }
    own.cuts = sheets_[i]->cuts;
    own.cuts_requested = track.cuts_requested;
    if (same_place) return;
    own.outline = outline;
    own.is_known = true;
    const SliceField::Mean under =
        sheets_[i]->field->mean(sheets_[i]->transform, at_m, bone_.radius_m);
    own.uncut_coverage = under.share;
    own.is_presented = under.share >= kMostlyMaterial;
    own.hu = under.hu;
    own.has_hu = under.share > 0;
  }

  // Thickness of the material above the slabs of the i-th sheet, up to where the tool entered it
  // (`step` -1); or below them, down to where the tool would leave it (`step` 1). The sum stops at
  // the thickness of the shell.
  double material_m(int i, int step) const noexcept {
    double sum = 0;
    for (; sum < bone_.shell_m; i += step) {
      const bool meets = step < 0 ? bone_.sheets[i].meets_above : bone_.sheets[i].meets_below;
      if (!meets || !state_.sheets[i + step].is_presented) break;
      sum += bone_.sheets[i + step].bottom_m - bone_.sheets[i + step].top_m;
    }
    return sum;
  }

  bool is_over_bone(int i) const noexcept { return state_.sheets[i].uncut_coverage >= kLevel; }
  bool is_over_none(int i) const noexcept { return state_.sheets[i].uncut_coverage <= 1 - kLevel; }

  // Puts a cortical wall into the slab of the i-th sheet, at the face where the tool enters the
  // bone or would leave it. The bone behind the wall is that of the sheet on the other side. On a
  // slope a slice's HU do not tell how thick the wall is, so there is no wall.
  void set_walls(int i, CuttingSlab& slab) const noexcept {
    const BoneSheet& sheet = bone_.sheets[i];
    const SheetInContact& own = state_.sheets[i];
    slab.upper_wall_to_m = -std::numeric_limits<double>::infinity();
    slab.lower_wall_from_m = std::numeric_limits<double>::infinity();
    slab.cortex_N = 0;
    if (!(sheet.cortex_HU > 0) || !is_over_bone(i)) return;
    const bool above = sheet.meets_above && is_over_bone(i - 1),
               below = sheet.meets_below && is_over_bone(i + 1);
    if (above == below) return;
    if (above ? sheet.meets_below && !is_over_none(i + 1)
              : sheet.meets_above && !is_over_none(i - 1))
      return;
    const double inside_HU = state_.sheets[above ? i - 1 : i + 1].hu;
    const double wall_m =
        wall_thickness_m(own.hu, inside_HU, sheet.cortex_HU, sheet.bottom_m - sheet.top_m);
    if (!(wall_m > 0)) return;
    if (above)
      slab.lower_wall_from_m = sheet.bottom_m - wall_m;
    else
      slab.upper_wall_to_m = sheet.top_m + wall_m;
    const auto strength_N = [&](double hu) {
      return own.share * sheet.strength_N(bone_.shape, hu, slice_push_);
    };
    slab.cortex_N = strength_N(std::max(sheet.cortex_HU, own.hu));
    slab.strength_top_N = slab.strength_bottom_N = strength_N(inside_HU);
  }

  void set_strength(int i) noexcept {
    const BoneSheet& sheet = bone_.sheets[i];
    SheetInContact& own = state_.sheets[i];
    own.is_in_hole = !own.has_cut && own.uncut_coverage - own.share >= kHole && is_cut_through(i);
    own.is_beside = own.share < kMostlyMaterial && !own.has_cut && !own.is_in_hole;
    const double N = own.strength_N;
    std::array<double, 2> ends{N, N};
    if (sheet.meets_above || sheet.meets_below) {
      const bool above = sheet.meets_above && state_.sheets[i - 1].is_presented,
                 below = sheet.meets_below && state_.sheets[i + 1].is_presented;
      ends = strength_ends(N, above ? state_.sheets[i - 1].strength_N : N,
                           above ? sheets_[i - 1]->z_m - sheets_[i]->z_m : 0,
                           below ? state_.sheets[i + 1].strength_N : N,
                           below ? sheets_[i]->z_m - sheets_[i + 1]->z_m : 0,
                           sheet.bottom_m - sheet.top_m);
    }
    const double shell_N = sheet.shell_N(bone_.shape, own.hu, N);
    const bool has_shell = bone_.shell_m > 0 && own.is_presented;
    const double above_m = has_shell ? material_m(i, -1) : 0,
                 below_m = has_shell ? material_m(i, 1) : 0;
    const double slope =
        sheet.bottom_m > sheet.top_m ? (ends[1] - ends[0]) / (sheet.bottom_m - sheet.top_m) : 0;
    for (int k = sheet.first_slab; k < sheet.first_slab + sheet.slabs; ++k) {
      CuttingSlab& slab = state_.slabs[k];
      const double down_m = slab.top_m - sheet.top_m, up_m = sheet.bottom_m - slab.bottom_m;
      const double length_m = slab.bottom_m - slab.top_m;
      const bool is_shell =
          has_shell && (above_m + down_m + length_m <= bone_.shell_m + kMinPart_m ||
                        below_m + up_m + length_m <= bone_.shell_m + kMinPart_m);
      const double nominal = bone_.slabs[k].friction_N_per_m;
      slab.friction_N_per_m =
          own.uncut_coverage * (own.has_hu ? sheet.friction_N_per_m(own.hu, nominal) : nominal);
      slab.viscous_N_s_per_m2 = own.uncut_coverage * bone_.slabs[k].viscous_N_s_per_m2;
      slab.strength_top_N = own.share * (is_shell ? shell_N : ends[0] + slope * down_m);
      slab.strength_bottom_N =
          own.share * (is_shell ? shell_N : ends[0] + slope * (down_m + length_m));
      set_walls(i, slab);
      // A region of an earlier place must not become the walls of a new hole. Walls in use stay.
      if (!own.is_beside) slab.free = nullptr;
    }
    // A tool that reaches a sheet from the side needs the admissible region in the same tick.
    if (own.is_beside && sheet.bottom_m > sheet.top_m) find_free(i, kNewRegion_m);
  }

  // Returns whether the law remembers that a sheet is cut through at the tool's position, by the
  // hole that the tool is in or would enter.
  bool is_cut_through(int i) const noexcept {
    const BoneSheet& sheet = bone_.sheets[i];
    return cut_of(law_, sheet.first_slab + sheet.slabs - 1) >= sheet.bottom_m - kRounding_m;
  }

  // Returns the axis position in a sheet, moved back into the slot if the shaft presses on a wall.
  Eigen::Vector2d touching(int i) const noexcept {
    const CuttingState& law = state_.law;
    Eigen::Vector2d at_m = axis_in(i, law.has_begun ? law.T_device_proxy : tool_);
    const Slot* wall = wall_of(i);
    if (wall == nullptr) return at_m;
    const Slot::Reach reach = wall->reach(at_m);
    return at_m - reach.distance_m * reach.away;
  }
  // Returns the slot of the hole in the i-th sheet; null if the shaft is not in that sheet.
  const Slot* wall_of(int i) const noexcept {
    const CuttingState& law = state_.law;
    if (law.hole < 0 || !law.has_begun) return nullptr;
    const CuttingHoleSlab& slab = law.holes[law.hole].slabs[bone_.sheets[i].first_slab];
    return slab.embedded_m > 0 && slab.walls[0].is_open() ? &slab.walls[0] : nullptr;
  }

  Eigen::Vector2d axis_in(int i, const Pose& T_device_tool) const noexcept {
    return axis_at(bone_.tool, T_device_tool, sheets_[i]->z_m).head<2>();
  }

  void find_free(int i, double moved_m) noexcept {
    SheetInContact& own = state_.sheets[i];
    const BoneSheet& sheet = bone_.sheets[i];
    const Eigen::Vector2d at_m = touching(i);
    CuttingSlab& first = state_.slabs[sheet.first_slab];
    if (first.free != nullptr && (at_m - own.free_at_m).norm() < moved_m) return;
    own.free = admissible_region(*sheets_[i], at_m, bone_.radius_m);
    own.free_at_m = at_m;
    for (int k = sheet.first_slab; k < sheet.first_slab + sheet.slabs; ++k) {
      state_.slabs[k].free = &own.free;
      ++state_.slabs[k].free_version;
    }
  }

  // Cuts a sheet in which the wall has yielded, so that the slot of the axis has grown: requests a
  // hole with the outline that the tool has at the slot's boundary.
  void cut_yielded(int i) noexcept {
    SheetInContact& own = state_.sheets[i];
    if (wall_of(i) == nullptr) return;
    const Eigen::Vector2d wall_m = touching(i);
    if (bone_.sheets[i].bottom_m > state_.front_m) return;  // the front is still in this sheet
    const bool has_hole = own.has_cut || own.is_in_hole;
    if (has_hole && (wall_m - own.cut_at_m).norm() < kWidening * bone_.radius_m) return;
    if (!has_hole && own.share > kMinCoverage) return;
    SheetTrack& track = tracks_[i];
    if (track.pending_count == kMaxPendingHoles) return;
    Pose moved = state_.law.T_device_proxy;
    moved.p_m.head<2>() += wall_m - axis_in(i, state_.law.T_device_proxy);
    const LatticeOutline outline = outline_at(i, moved);
    const double share =
        overlap(*sheets_[i], bone_.tool, outline,
                std::span(track.pending.data(), static_cast<std::size_t>(track.pending_count)))
            .coverage;
    const double least = (own.is_beside || own.is_in_hole ? 0.5 : 0.1) * kWidening;
    if (share < least) return;
    request(i, outline, false);
    own.cut_at_m = wall_m;
  }

  void request(int i, const LatticeOutline& outline, bool is_front) noexcept {
    SheetTrack& track = tracks_[i];
    SheetInContact& own = state_.sheets[i];
    if (track.pending_count == kMaxPendingHoles || state_.cuts.size() == state_.cuts.capacity()) {
      backlog_ = true;
      return;
    }
    track.pending[track.pending_count++] = outline;
    if (track.cuts_requested < kMaxPendingHoles) own.holes[track.cuts_requested] = outline;
    state_.cuts.push_back(
        {static_cast<std::int32_t>(i), ++track.cuts_requested, outline, is_front});
    if (!is_front) return;
    own.has_cut = true;
    own.cut_at_m = axis_in(i, state_.law.T_device_proxy);
  }

  const BoneVolume& bone_;
  std::span<const Sheet* const> sheets_;
  const Pose& tool_;
  std::span<SheetTrack> tracks_;
  BoneContactState& state_;
  Tick law_;  // the law's view of the tool before this tick, to ask holes.h about the tool's hole
  // Depth of the tip, and the largest depth that the tip can reach in this tick.
  double tip_m_ = 0, low_m_ = 0;
  double slice_push_ = 0;
  bool backlog_ = false;
};

/// Call this when the tool has left its hole or entered another one. The meshes keep the cuts.
void forget_hole(const BoneVolume& bone, BoneContactState& state) noexcept {
  for (std::size_t i = 0; i < state.sheets.size(); ++i) {
    state.sheets[i].has_cut = state.sheets[i].is_in_hole = false;
    const BoneSheet& sheet = bone.sheets[i];
    for (int k = sheet.first_slab; k < sheet.first_slab + sheet.slabs; ++k)
      state.slabs[k].free = nullptr;
  }
}

// Runs the law where the tool is now.
void evaluate(const BoneVolume& bone, std::span<const Sheet* const> sheets,
              const Pose& T_device_evaluated, std::span<SheetTrack> tracks, BoneContactState& state,
              ContactOutput& output) noexcept {
  // The tissue acts on the tool. A coupling can hold the tool far from the plate, so the sheets are
  // evaluated where the tool was at the end of the last tick.
  const bool is_apart = state.law.has_begun && !state.options.coupling.is_rigid &&
                        is_upright(bone.tool, state.law.T_device_proxy);
  const Pose T_device_tool = is_apart ? state.law.T_device_proxy : T_device_evaluated;
  BoneContactTick tick(bone, sheets, T_device_tool,
                       -(T_device_evaluated * bone.tool.tip_plate_m).z(), tracks, state);
  tick.evaluate_below();
  tick.evaluate_around();
  tick.evaluate_surface();
  cutting_tick(state.options, T_device_evaluated, state.slabs, state.law, state.result);
  if (state.last_hole >= 0 && state.law.hole != state.last_hole) forget_hole(bone, state);
  state.last_hole = state.law.hole;
  tick.request_passed();
  output.backlog = tick.backlog();
}

// Keeps the forces of the last tick in a tick without a new pose. If the law were evaluated at the
// same pose again, the tool would seem to rest, and viscous friction would vanish.
void hold(CuttingResult& result) noexcept {
  result.cut_J = result.layer_cut_J = 0;
  result.layers_punctured = 0;
  result.passed_from = result.passed_to = 0;
  result.steps = result.evaluations = 0;
  result.has_converged = true;
}

constexpr double kSlabRounding_m = 1e-9;

/// Updates the velocities of twist and feed, averaged over about 20 ms, so that single encoder steps
/// have little effect. `interval_s`: time since the pose state.T_device_plate.
void follow_twist(const BoneVolume& bone, const Pose& T_device_plate, double interval_s,
                  BoneContactState& state) noexcept {
  const Twist way = displacement(state.T_device_plate, T_device_plate);
  const Eigen::Vector3d inward = T_device_plate.q * -bone.tool.axis_plate;
  const Eigen::Vector3d tip_way =
      T_device_plate * bone.tool.tip_plate_m - state.T_device_plate * bone.tool.tip_plate_m;
  const double share = std::min(1.0, interval_s / kTwist_s);
  state.twist_rad_per_s += share * (way.tail<3>().dot(inward) / interval_s - state.twist_rad_per_s);
  state.feed_m_per_s += share * (tip_way.dot(inward) / interval_s - state.feed_m_per_s);
}

/// Returns true if uncut material lies under the tool's outline.
bool has_material(const BoneVolume& bone, const Sheet& sheet, const Pose& T_device_plate) noexcept {
  const Eigen::Vector2d at_m = axis_at(bone.tool, T_device_plate, sheet.z_m).head<2>();
  if (!(sheet.field->mean(sheet.transform, at_m, bone.radius_m).share > 0)) return false;
  const LatticeOutline outline =
      outline_on_lattice(bone.tool, T_device_plate, sheet.transform, sheet.z_m);
  return overlap(sheet, bone.tool, outline, {}).coverage > kMinCoverage;
}

}  // namespace

std::optional<Vector2d> surface_slope(const BoneVolume& bone, std::span<const Sheet* const> sheets,
                                      int sheet, double front_m, const Vector2d& at_m) noexcept {
  const auto sample = [&](int i) { return sheets[i]->edge->at(sheets[i]->transform, at_m); };
  const EdgeDistance::Sample front = sample(sheet);
  if (front.distance_m <= -kLimit_m) return std::nullopt;
  const Vector2d face = downhill(front.gradient, 2 * kMaxSlope, bone.shape);
  // The surface lies between the sheets `above` and `above + 1`.
  int above = sheet;
  EdgeDistance::Sample high = front, low = front;
  if (front.distance_m >= 0) {
    if (!bone.sheets[sheet].meets_above) return Vector2d::Zero();
    high = sample(--above);
    if (high.distance_m >= 0) return std::nullopt;
  } else {
    for (int left = kMaxSlopeSheets;; ++above) {
      if (left-- == 0 || !bone.sheets[above].meets_below) return face;
      low = sample(above + 1);
      if (low.distance_m >= 0) break;
      high = low;
    }
  }
  const double high_m = -sheets[above]->z_m, low_m = -sheets[above + 1]->z_m,
               difference_m = low.distance_m - high.distance_m;
  const double surface_m = low_m - (low_m - high_m) * low.distance_m / difference_m;
  if (surface_m - front_m > 2 * bone.radius_m) return face;
  if (high.distance_m <= -kLimit_m) return Vector2d::Zero();
  LineFit line;
  line.add(high_m - surface_m, high);
  line.add(low_m - surface_m, low);
  const auto add = [&](int i) {
    const double depth_m = -sheets[i]->z_m - surface_m;
    const EdgeDistance::Sample at = sample(i);
    if (std::abs(depth_m) > kSlopeWindow_m || std::abs(at.distance_m) >= kLimit_m) return false;
    line.add(depth_m, at);
    return true;
  };
  for (int i = above; i > above - kMaxSlopeSheets && bone.sheets[i].meets_above && add(i - 1);)
    --i;
  for (int i = above + 1; i <= above + kMaxSlopeSheets && bone.sheets[i].meets_below && add(i + 1);)
    ++i;
  const double nearest = difference_m / (low_m - high_m),
               growth = std::max(line.growth(), nearest / kMostSteeper);
  const Vector2d inwards = line.gradient();
  return downhill(inwards, inwards.norm() / std::max(growth, 1e-9), bone.shape);
}

void update_bone_contact(const BoneVolume& bone, std::span<const Sheet* const> sheets,
                         const Pose& T_device_plate, const Pose& T_device_evaluated,
                         double pose_interval_s, std::span<SheetTrack> tracks,
                         BoneContactState& state, ContactOutput& output) noexcept {
  output = ContactOutput{};
  output.tip_device_m = T_device_plate * bone.tool.tip_plate_m;
  output.not_upright = !is_upright(bone.tool, T_device_evaluated);
  if (output.not_upright) return;
  for (std::size_t i = 0; i < sheets.size(); ++i)
    drop_published(*sheets[i], tracks[i]);
  state.cuts.clear();
  if (pose_interval_s > 0) state.options.interval_s = pose_interval_s;

  state.must_retract = state.is_released = false;
  if (bone.twists && state.has_plate && pose_interval_s > 0)
    follow_twist(bone, T_device_plate, pose_interval_s, state);
  const bool was_loaded = state.law.stretch_m > 0;
  const double front_before_m = state.front_m;
  if (state.has_plate && !(pose_interval_s > 0))
    hold(state.result);
  else
    evaluate(bone, sheets, T_device_evaluated, tracks, state, output);
  const CuttingResult& result = state.result;

  // Energy account: add the work of the last tick's wrench over the displacement of the plate since
  // then.
  BoneEnergyAccount& energy = state.energy;
  if (state.has_plate && pose_interval_s > 0)
    energy.absorbed_J -=
        state.wrench_device.dot(displacement(state.T_device_plate, T_device_plate));
  if (pose_interval_s > 0 || !state.has_plate) state.T_device_plate = T_device_plate;
  state.has_plate = true;
  state.T_device_evaluated = T_device_evaluated;
  state.wrench_device = result.wrench_device;
  energy.cut_J += result.cut_J;
  energy.stored_J = result.stored_J;
  energy.released_max_J = std::max(energy.released_max_J, -energy.absorbed_J);

  output.cut_list = state.cuts;
  output.punctured_now = std::any_of(state.cuts.begin(), state.cuts.end(),
                                     [](const CutRequest& cut) { return cut.is_puncture; });
  output.wrench_device = result.wrench_device;
  output.local.stored_J = result.stored_J;
  output.force_N = result.tip_N + result.layer_N;
  for (int k = result.passed_from; k < result.passed_to; ++k)
    output.trial_force_N = std::max({output.trial_force_N, state.slabs[k].strength_top_N,
                                     state.slabs[k].strength_bottom_N, state.slabs[k].cortex_N});
  const double tip_m = -output.tip_device_m.z();
  const double front_m = state.front_m = result.front_m;
  if (output.punctured_now && was_loaded)
    output.penetration_m = std::max(0.0, tip_m - front_before_m);
  else if (result.tip_N > 0)
    output.penetration_m = std::max(0.0, tip_m - front_m);
  const auto at_front = std::lower_bound(
      bone.sheets.begin(), bone.sheets.end(), front_m - 1e-9,
      [](const BoneSheet& sheet, double depth_m) { return sheet.bottom_m < depth_m; });
  const auto above_tip = std::upper_bound(
      bone.sheets.begin(), bone.sheets.end(), tip_m,
      [](double depth_m, const BoneSheet& sheet) { return depth_m < sheet.top_m; });
  constexpr double kAir_HU = -1000;
  const auto front_sheet = static_cast<std::size_t>(at_front - bone.sheets.begin());
  const bool is_in_material = at_front != bone.sheets.end() && state.sheets[front_sheet].has_hu;
  state.front_HU = is_in_material ? state.sheets[front_sheet].hu : kAir_HU;
  if (result.tip_N > 0 && at_front != bone.sheets.end()) {
    output.phase = ContactPhase::kContact;
    output.active_sheet = static_cast<std::int32_t>(at_front - bone.sheets.begin());
  } else if (result.layer_N > 0) {
    output.phase = ContactPhase::kContact;
  } else if (above_tip != bone.sheets.begin()) {
    output.active_sheet = static_cast<std::int32_t>(above_tip - bone.sheets.begin()) - 1;
    output.phase = state.sheets[output.active_sheet].has_cut ? ContactPhase::kPunctured
                                                             : ContactPhase::kMissed;
  }
}

BoneContactState make_bone_contact_state(const BoneVolume& bone) {
  BoneContactState state;
  state.law = make_cutting_state(bone.slabs.size(), kMaxRememberedHoles, bone.layers.size());
  state.slabs = bone.slabs;
  state.sheets.resize(bone.sheets.size());
  for (std::size_t i = 0; i < bone.sheets.size(); ++i)
    state.sheets[i].strength_N = bone.sheets[i].nominal_N;
  state.cuts.reserve(2 * bone.sheets.size());
  state.options = bone.options;
  state.options.layers = bone.layers;
  return state;
}

void reset_motion(BoneContactState& state) noexcept {
  state.is_released = true;
  for (const SoftLayerState& layer : state.law.layers) {
    if (!(layer.stretch_m > 0)) continue;
    state.retract_to_depth_m =
        state.must_retract ? std::min(state.retract_to_depth_m, layer.cut_m) : layer.cut_m;
    state.must_retract = true;
  }
  state.twist_rad_per_s = state.feed_m_per_s = 0;
  release(state.law);
  state.has_plate = false;
  state.wrench_device.setZero();
  state.result = {};
}

double retract_distance_m(const BoneVolume& bone, std::span<const Sheet* const> sheets,
                          const Pose& T_device_plate, const BoneContactState& state) noexcept {
  if (!state.is_released) return 0;
  const Eigen::Vector3d tip = T_device_plate * bone.tool.tip_plate_m,
                        axis = T_device_plate.q * -bone.tool.axis_plate;
  double free_m = state.must_retract ? state.retract_to_depth_m : -tip.z();
  int empty = -1;  // sheet without uncut material under the tool
  for (std::size_t k = 0; k < bone.slabs.size() && bone.slabs[k].top_m < free_m - kSlabRounding_m;
       ++k) {
    const CuttingSlab& slab = bone.slabs[k];
    const double cut_m = cut_by_any_hole(bone.options, state.law, slab, k, tip, axis);
    if (cut_m >= std::min(slab.bottom_m, free_m) - kSlabRounding_m) continue;
    const int i = bone.sheet_of_slab[k];
    if (i == empty || !has_material(bone, *sheets[static_cast<std::size_t>(i)], T_device_plate)) {
      empty = i;
      continue;
    }
    free_m = std::max(slab.top_m, cut_m);
  }
  return std::max(0.0, -tip.z() - free_m);
}

}  // namespace trocar::runtime
