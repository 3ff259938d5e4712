// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/bone/cutting_law.h"

#include "runtime/haptics/bone/front.h"
#include "runtime/haptics/bone/holes.h"
#include "runtime/haptics/bone/tick.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;

// Sets the limit of the tip's friction, and its stiffness in proportion. If the stiffness grows,
// the force is kept, so the stored energy falls.
void hold_tip(Tick& tick) noexcept {
  CuttingState& state = tick.state;
  tick.tip_friction_N = tick.options.tip_friction * tick.options.tip_N_per_m *
                        std::max(state.stretch_m, 0.0) * tick.normal.norm();
  const double stiffness = tick.tip_friction_N / std::max(tick.options.tip_presliding_m, 1e-9);
  if (stiffness > state.tip_friction_N_per_m)
    state.tip_slip_m *= state.tip_friction_N_per_m / stiffness;
  state.tip_friction_N_per_m = stiffness;
  if (stiffness <= 0) state.tip_slip_m.setZero();
  tick.limit_tip_slip();
}

// Sets the limit of the hold of crushed bone on the tip, and its stiffness in proportion. If the
// stiffness grows, the force is kept, so the stored energy falls.
void hold_along(Tick& tick) noexcept {
  CuttingState& state = tick.state;
  const double tip_m = -tick.tip.z(), reach_m = 2 * tick.options.tool.radius_m;
  state.hold_depth_m = state.hold_tip_N > 0 ? std::max(state.hold_depth_m, tip_m) : tip_m;
  const double left = 1 - (state.hold_depth_m - tip_m) / (tick.down * reach_m);
  if (left <= 0) state.hold_tip_N = 0;
  tick.hold_N = tick.options.tip_hold * state.hold_tip_N * std::max(left, 0.0);
  const double presliding_m = std::max(tick.options.tip_presliding_m, 1e-9),
               stiffness = tick.hold_N / presliding_m;
  if (stiffness > state.hold_N_per_m) state.hold_slip_m *= state.hold_N_per_m / stiffness;
  state.hold_N_per_m = stiffness;
  state.hold_slip_m = stiffness > 0 ? std::clamp(state.hold_slip_m, -presliding_m, 0.0) : 0;
}

// Sets the limit of the tip's resistance to being turned, and its stiffness in proportion. If the
// stiffness grows, the force is kept, so the stored energy falls.
void hold_twist(Tick& tick) noexcept {
  CuttingState& state = tick.state;
  tick.torsion_N = state.stretch_m > 0
                       ? tick.options.torsion_Nm / std::max(tick.options.tool.radius_m, 1e-9)
                       : 0;
  const double presliding_m = std::max(tick.options.tip_presliding_m, 1e-9),
               stiffness = tick.torsion_N / presliding_m;
  if (stiffness > state.torsion_N_per_m) state.torsion_slip_m *= state.torsion_N_per_m / stiffness;
  state.torsion_N_per_m = stiffness;
  state.torsion_slip_m =
      stiffness > 0 ? std::clamp(state.torsion_slip_m, -presliding_m, presliding_m) : 0;
}

void finish_torsion(Tick& tick, double turned_m, CuttingResult& out) noexcept {
  CuttingState& state = tick.state;
  const double presliding_m = std::max(tick.options.tip_presliding_m, 1e-9);
  state.torsion_slip_m = std::clamp(state.torsion_slip_m + turned_m, -presliding_m, presliding_m);
  out.stored_J += 0.5 * state.torsion_N_per_m * state.torsion_slip_m * state.torsion_slip_m;
}

// Keeps the slip of the hold and the force with which the tip has crushed the bone around it.
// Behind a hard layer that force falls to the present one exponentially, over a diameter of the
// tool. Where no bone is under the tip, there is no such force, whatever lies below.
void finish_hold(Tick& tick, double pressed_m, CuttingResult& out) noexcept {
  CuttingState& state = tick.state;
  const double presliding_m = std::max(tick.options.tip_presliding_m, 1e-9);
  state.hold_slip_m =
      tick.hold_N > 0 ? std::clamp(state.hold_slip_m + pressed_m, -presliding_m, 0.0) : 0;
  out.stored_J += 0.5 * state.hold_N_per_m * state.hold_slip_m * state.hold_slip_m;
  if (tick.is_free) {
    state.hold_tip_N = 0;
    return;
  }
  // Below all bone both depths are infinite.
  const double advance_m =
      tick.front_m > tick.first_front_m ? (tick.front_m - tick.first_front_m) / tick.down : 0;
  const double forgotten = -std::expm1(-advance_m / (2 * tick.options.tool.radius_m));
  state.hold_tip_N =
      std::max(out.tip_N, state.hold_tip_N + forgotten * (out.tip_N - state.hold_tip_N));
}

// Keeps the depth by which the front has sunk without a cut, and adopts the slope for the next
// tick. `tip`, `axis`: the tool at the end of the tick.
void finish_surface(Tick& tick, const Vector3d& tip, const Vector3d& axis) noexcept {
  CuttingState& state = tick.state;
  if (tick.is_on_surface() && state.stretch_m > 0 && !tick.is_free)
    state.slid_m += -tip.z() + state.stretch_m * axis.z() - tick.front_m;
  else
    state.slid_m = 0;
  state.slope = tick.options.slope;
}

void finish(Tick& tick, const Evaluation& e, CuttingResult& out) noexcept {
  out.wrench_device = e.coupling;
  out.stored_J =
      e.V - e.friction_J - e.wall_J - e.viscous_J - e.tip_friction_J - e.hold_J - e.torsion_J;
  // Friction that has slid keeps its new rest position.
  if (tick.state.friction_N_per_m > 0) {
    tick.state.presliding_m += e.slide;
    const double length = tick.state.presliding_m.norm();
    if (length > tick.options.presliding_m)
      tick.state.presliding_m *= tick.options.presliding_m / length;
    out.stored_J += 0.5 * tick.state.friction_N_per_m * tick.state.presliding_m.squaredNorm();
  } else {
    tick.state.presliding_m.setZero();
  }
  if (tick.tip_friction_N > 0) {
    tick.state.tip_slip_m += e.tip_slide;
    tick.limit_tip_slip();
    out.stored_J += 0.5 * tick.state.tip_friction_N_per_m * tick.state.tip_slip_m.squaredNorm();
  }
  const Vector3d tip = e.X * tick.options.tool.tip_plate_m,
                 axis = e.X.q * tick.options.tool.inward_plate;
  out.stored_J += e.walls_yield ? yield_walls(tick, tip, axis) : e.wall_J;
  out.tip_N = tick.is_free ? 0 : e.tip_N;
  if (tick.torsion_N > 0) finish_torsion(tick, e.slide[1], out);
  if (tick.options.tip_hold > 0) finish_hold(tick, e.pressed_m, out);
  tick.state.stretch_m += e.pressed_m;
  // Remove the rounding error of a tip that touches nothing.
  if (tick.is_free) tick.state.stretch_m = std::min(tick.state.stretch_m, 0.0);
  tick.state.T_device_proxy = e.X;
  out.front_m = tick.front_m;
  out.embedded_m = tick.embedded_m;
  finish_layers(tick, e.slide[0], out);
  if (tick.front_m > tick.first_front_m) record_cut(tick, tip, axis, out);
  finish_surface(tick, tip, axis);
  tick.state.bearing = bearing_slab(tick);
  tick.state.front_m = tick.front_m;
  if (tick.options.coupling.is_rigid) {
    // The wrench is the derivative of the energy stored now, at the present pose of the shaft.
    tick.start_at(e.X);
    if (tick.tip_friction_N > 0) tick.limit_tip_slip();
    Evaluation now;
    evaluate(tick, e.X, false, now, out);
    const double viscous_N = tick.viscous_N_s_per_m * e.slide[0] / tick.options.interval_s;
    out.wrench_device = -now.g - viscous_N * now.along;
  }
}

void run(Tick& tick, CuttingResult& out) noexcept {
  ++tick.state.tick;
  choose_hole(tick);
  find_front(tick);
  find_layers(tick);
  if (tick.options.tip_friction > 0) hold_tip(tick);
  if (tick.options.tip_hold > 0) hold_along(tick);
  hold_twist(tick);
  record_drift(tick, out);
  enter_or_leave(tick);
  embed(tick);
  Evaluation e;
  if (tick.options.coupling.is_rigid) {
    evaluate(tick, tick.plate, false, e, out);
    const Advance a = scan(tick, e.tip_N, tick.options.tip_N_per_m);
    if (a.length_m > 0) {
      take(tick, a, out);
      evaluate(tick, tick.plate, false, e, out);
    }
    for (int k = 0; k < kMaxLayerAdvances; ++k) {
      const LayerAdvance layer = scan_layers(tick, e.slide[0], e.tip_N, 1, out);
      if (layer.layer < 0) break;
      take(tick, layer, out);
      evaluate(tick, tick.plate, false, e, out);
    }
  } else {
    evaluate(tick, tick.start, false, e, out);
    settle(tick, e, out);
  }
  finish(tick, e, out);
}

}  // namespace

CuttingState make_cutting_state(std::size_t slabs, std::size_t holes, std::size_t layers) {
  CuttingState state;
  state.holes.resize(holes);
  for (CuttingHole& hole : state.holes)
    hole.slabs.resize(slabs);
  state.wall_points.resize(slabs * kMaxWallPoints);
  state.layers.resize(layers);
  for (SoftLayerState& layer : state.layers)
    layer.holes.resize(holes);
  return state;
}

void release(CuttingState& state) noexcept {
  if (state.hole >= 0) {
    CuttingHole& hole = state.holes[static_cast<std::size_t>(state.hole)];
    for (int i = state.embedded_from; i < state.embedded_to; ++i)
      hole.slabs[static_cast<std::size_t>(i)].embedded_m = 0;
  }
  state.has_begun = false;
  state.stretch_m = state.slid_m = 0;
  state.bearing = -1;
  state.slope.reset();
  state.friction_N_per_m = 0;
  state.presliding_m.setZero();
  state.tip_friction_N_per_m = 0;
  state.tip_slip_m.setZero();
  state.hold_tip_N = state.hold_N_per_m = state.hold_slip_m = 0;
  state.torsion_N_per_m = state.torsion_slip_m = 0;
  for (SoftLayerState& layer : state.layers)
    layer.stretch_m = std::min(layer.stretch_m, 0.0);
  state.hole = -1;
  state.embedded_from = state.embedded_to = 0;
}

void cutting_tick(const CuttingOptions& options, const Pose& T_device_plate,
                  std::span<const CuttingSlab> slabs, CuttingState& state,
                  CuttingResult& result) noexcept {
  result = {};
  if (!state.has_begun) {
    state.has_begun = true;
    state.T_device_proxy = T_device_plate;
  }
  Tick tick{.options = options,
            .plate = T_device_plate,
            .slabs = slabs,
            .state = state,
            .layers = options.layers.first(std::min(options.layers.size(), state.layers.size()))};
  tick.start_at(state.T_device_proxy);
  run(tick, result);
}

}  // namespace trocar::runtime
