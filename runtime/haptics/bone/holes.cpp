// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/bone/holes.h"

#include "runtime/haptics/bone/front.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// True if, in this slab, the axis is within `same_hole_m` of the hole's slot.
bool is_near(const CuttingOptions& options, const CuttingSlab& slab, const CuttingHoleSlab& hole,
             const Vector3d& tip, const Vector3d& axis) noexcept {
  return hole.walls[0].is_open() &&
         hole.walls[0]
                 .reach(crossing(tip, axis, gauss_depth(slab, 0, options.wall_points)))
                 .distance_m <= options.same_hole_m;
}

bool is_near(const Tick& tick, const CuttingHoleSlab& hole, std::size_t i) noexcept {
  return is_near(tick.options, tick.slabs[i], hole, tick.tip, tick.axis);
}

void enter(Tick& tick, int slab) noexcept {
  if (tick.hole < 0 && !tick.state.holes.empty()) {
    const auto oldest =
        std::min_element(tick.state.holes.begin(), tick.state.holes.end(),
                         [](const auto& a, const auto& b) { return a.last_used < b.last_used; });
    tick.hole = static_cast<int>(oldest - tick.state.holes.begin());
    oldest->first = slab;
    for (CuttingHoleSlab& s : oldest->slabs) {
      s.cut_m = -kInfinity;
      s.embedded_m = 0;
      s.free_version = 0;
      for (Slot& wall : s.walls)
        wall.close();
    }
  }
  if (tick.hole < 0) return;
  tick.state.hole = tick.hole;
  CuttingHole& hole = tick.state.holes[static_cast<std::size_t>(tick.hole)];
  hole.first = std::min(hole.first, slab);
  hole.last_used = tick.state.tick;
}

// Renews the walls of a slab that the shaft now fills: walls that begin, get stiffer, or have a new admissible
// region. They keep their force.
void renew_walls(const Tick& tick, std::size_t i, double before_m, double stiffness,
                 bool has_new_free, CuttingHoleSlab& s) noexcept {
  const CuttingSlab& slab = tick.slabs[i];
  // If the coupling is rigid, the plate feels the walls directly, and the wrench is held for a tick. So a new
  // region replaces the walls only when the shaft presses on none of them.
  if (has_new_free && before_m > 0 && tick.options.coupling.is_rigid) {
    for (std::size_t g = 0; g < tick.options.wall_points; ++g)
      has_new_free = has_new_free &&
                     s.walls[g].reach(crossing(tick.tip, tick.axis, s.depth_m[g])).distance_m <= 0;
  }
  if (before_m > 0 && stiffness <= s.wall_N_per_m && !has_new_free) return;
  // A tool that enters the slab beside the hole starts a new slot at its present position.
  const bool is_new = before_m <= 0 && !is_near(tick, s, i);
  if (is_new) s.cut_m = std::min(slab.top_m + s.embedded_m, slab.bottom_m);
  for (std::size_t g = 0; g < tick.options.wall_points; ++g) {
    s.depth_m[g] = gauss_depth(slab, g, tick.options.wall_points);
    const Vector2d at = crossing(tick.tip, tick.axis, s.depth_m[g]);
    Slot& wall = s.walls[g];
    if (is_new || has_new_free) {
      const double pressed = before_m > 0 ? wall.reach(at).distance_m : 0;
      if (has_new_free)
        wall = *slab.free;
      else
        wall.open(at, slab.clearance_m);
      const Slot::Reach r = wall.reach(at);
      if (r.distance_m > pressed) wall.include(at - r.away * pressed);
    }
    if (before_m <= 0) {
      wall.include(at);
    } else {
      const Slot::Reach r = wall.reach(at);
      wall.include(at - r.away * (r.distance_m * s.wall_N_per_m / stiffness));
    }
  }
  if (has_new_free) s.free_version = slab.free_version;
}

void embed(const Tick& tick, std::size_t i, double low, CuttingHoleSlab& s) noexcept {
  const CuttingSlab& slab = tick.slabs[i];
  const double before = s.embedded_m;
  s.embedded_m = slab.bottom_m > slab.top_m
                     ? std::clamp(low - slab.top_m, 0.0, slab.bottom_m - slab.top_m)
                 : low > slab.top_m ? slab.hole_m
                                    : 0;
  const double per_point = 1.0 / static_cast<double>(tick.options.wall_points);
  s.wall_most_N = per_point * slab.wall_strength_N_per_m * s.embedded_m;
  const double stiffness = per_point * slab.wall_N_per_m2 * s.embedded_m;
  const bool has_new_free = slab.free != nullptr && s.free_version != slab.free_version;
  if (s.embedded_m > 0 && (before <= 0 || stiffness > s.wall_N_per_m || has_new_free))
    renew_walls(tick, i, before, stiffness, has_new_free, s);
  s.wall_N_per_m = stiffness;
}

// Records that the front has moved from this depth to its present one.
void record_cut_from(Tick& tick, double from_m, const Vector3d& tip, const Vector3d& axis,
                     CuttingResult& out) noexcept {
  for (int i = tick.slab_at(from_m); i < tick.slab_count(); ++i) {
    const CuttingSlab& slab = tick.slab(i);
    if (slab.top_m >= tick.front_m) break;
    if (tick.state.hole < 0) enter(tick, i);
    if (tick.state.hole < 0) return;
    CuttingHoleSlab& s = tick.hole_in_use().slabs[static_cast<std::size_t>(i)];
    if (s.embedded_m <= 0 && !is_near(tick, s, static_cast<std::size_t>(i))) {
      s.cut_m = -kInfinity;
      for (std::size_t g = 0; g < tick.options.wall_points; ++g)
        s.walls[g].open(crossing(tip, axis, gauss_depth(slab, g, tick.options.wall_points)),
                        slab.clearance_m);
    }
    const double passed = slab.bottom_m - 1e-9;  // rounding may stop the front above it
    const bool was_passed = s.cut_m >= passed;
    s.cut_m = std::max(s.cut_m, std::min(tick.front_m, slab.bottom_m));
    if (!was_passed && s.cut_m >= passed) {
      if (out.passed_from == out.passed_to) out.passed_from = i;
      out.passed_to = i + 1;
    }
  }
}

}  // namespace

double core_friction_factor(const CuttingOptions& options, double embedded_m) noexcept {
  const double x = std::min(options.core_growth_per_m * embedded_m, kMaxCoreExponent);
  return x > 0 ? 1 + options.core_fraction * (std::expm1(x) / x - 1) : 1;
}

void choose_hole(Tick& tick) noexcept {
  tick.hole = tick.state.hole;
  if (tick.hole >= 0) return;
  const int next = tick.slab_at(-tick.tip.z());
  for (std::size_t h = 0; h < tick.state.holes.size(); ++h) {
    const CuttingHole& hole = tick.state.holes[h];
    if (hole.first < 0) continue;
    // Compare positions in the slab that holds the tip, and in the one above it, which may be a sheet of
    // thickness 0 that the tip has passed.
    for (const int slab : {std::max(next, hole.first), next - 1}) {
      if (slab < hole.first || slab >= tick.slab_count()) continue;
      const auto i = static_cast<std::size_t>(slab);
      if (!is_near(tick, hole.slabs[i], i)) continue;
      tick.hole = static_cast<int>(h);
      return;
    }
  }
}

double cut_of(const Tick& tick, int slab) noexcept {
  if (tick.hole < 0) return -kInfinity;
  const auto i = static_cast<std::size_t>(slab);
  const CuttingHoleSlab& s = tick.state.holes[static_cast<std::size_t>(tick.hole)].slabs[i];
  return s.embedded_m > 0 || is_near(tick, s, i) ? s.cut_m : -kInfinity;
}

double cut_by_any_hole(const CuttingOptions& options, const CuttingState& state,
                       const CuttingSlab& slab, std::size_t index, const Vector3d& tip,
                       const Vector3d& axis) noexcept {
  double deepest_m = -kInfinity;
  for (const CuttingHole& hole : state.holes) {
    if (hole.first < 0) continue;
    const CuttingHoleSlab& s = hole.slabs[index];
    if (s.cut_m > deepest_m && is_near(options, slab, s, tip, axis)) deepest_m = s.cut_m;
  }
  return deepest_m;
}

void enter_or_leave(Tick& tick) noexcept {
  const double low = tick.filled_to_m();
  if (tick.state.hole >= 0) {
    CuttingHole& hole = tick.hole_in_use();
    if (low > tick.slabs[static_cast<std::size_t>(hole.first)].top_m) {
      hole.last_used = tick.state.tick;
      return;
    }
    for (int i = tick.state.embedded_from; i < tick.state.embedded_to; ++i)
      hole.slabs[static_cast<std::size_t>(i)].embedded_m = 0;
    tick.state.embedded_from = tick.state.embedded_to = 0;
    tick.state.hole = -1;
    return;
  }
  const int slab = tick.slab_at(low);
  if (slab < tick.slab_count() && low > tick.slab(slab).top_m) {
    enter(tick, slab);
  } else if (tick.hole >= 0 && slab > 0 && low > tick.slab(slab - 1).top_m) {
    enter(tick, slab - 1);  // the tip is below a sheet of thickness 0
  }
}

void embed(Tick& tick) noexcept {
  const double low = tick.filled_to_m();
  double friction = 0, viscous = 0;
  int from = 0, to = 0;
  if (tick.state.hole >= 0) {
    CuttingHole& hole = tick.hole_in_use();
    from = hole.first;
    to = from;
    while (to < tick.slab_count() && tick.slab(to).top_m < low)
      ++to;
    for (int i = from; i < std::max(to, tick.state.embedded_to); ++i)
      embed(tick, static_cast<std::size_t>(i), low, hole.slabs[static_cast<std::size_t>(i)]);
    for (int i = from; i < to; ++i) {
      const auto k = static_cast<std::size_t>(i);
      tick.embedded_m += hole.slabs[k].embedded_m;
      friction += tick.slabs[k].friction_N_per_m * hole.slabs[k].embedded_m;
      viscous += tick.slabs[k].viscous_N_s_per_m2 * hole.slabs[k].embedded_m;
    }
  }
  tick.state.embedded_from = from;
  tick.state.embedded_to = to;
  tick.embedded_m /= tick.down;
  tick.friction_N = friction / tick.down * core_friction_factor(tick.options, tick.embedded_m);
  tick.viscous_N_s_per_m = viscous / tick.down;
  if (!tick.layers.empty()) tick.friction_N += friction_of_layers(tick);
  const double stiffness = tick.friction_N / std::max(tick.options.presliding_m, 1e-9);
  if (stiffness > tick.state.friction_N_per_m)
    tick.state.presliding_m *= tick.state.friction_N_per_m / stiffness;
  tick.state.friction_N_per_m = stiffness;
}

double yield_walls(Tick& tick, const Vector3d& tip, const Vector3d& axis) noexcept {
  double stored = 0;
  tick.walls.forget();
  CuttingHole& hole = tick.hole_in_use();
  for (int i = tick.state.embedded_from; i < tick.state.embedded_to; ++i) {
    CuttingHoleSlab& s = hole.slabs[static_cast<std::size_t>(i)];
    if (s.wall_N_per_m <= 0) continue;
    const double kept = s.wall_most_N / s.wall_N_per_m;
    for (std::size_t g = 0; g < tick.options.wall_points; ++g) {
      const Vector2d at = crossing(tip, axis, s.depth_m[g]);
      Slot::Reach r = s.walls[g].reach(at);
      if (r.distance_m > kept) {
        s.walls[g].include(at - kept * r.away);
        r.distance_m = kept;
      }
      stored += 0.5 * s.wall_N_per_m * r.distance_m * r.distance_m;
    }
  }
  return stored;
}

void record_cut(Tick& tick, const Vector3d& tip, const Vector3d& axis,
                CuttingResult& out) noexcept {
  record_cut_from(tick, tick.first_front_m, tip, axis, out);
}

void record_drift(Tick& tick, CuttingResult& out) noexcept {
  if (!tick.has_bevel() || tick.is_on_surface() || tick.state.stretch_m <= 0) return;
  if (tick.front_m > tick.state.front_m)
    record_cut_from(tick, tick.state.front_m, tick.tip, tick.axis, out);
}

}  // namespace trocar::runtime
