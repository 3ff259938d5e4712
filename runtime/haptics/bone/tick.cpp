// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/bone/tick.h"

#include "runtime/haptics/bone/front.h"

namespace trocar::runtime {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

void add_coupling(const Tick& tick, bool majorise, Evaluation& e) noexcept {
  e.coupling_J = e.coupling_N = 0;
  e.is_saturated = false;
  e.coupling.setZero();
  if (tick.options.coupling.is_rigid) return;
  const auto add = [&](int at, const Vector3d& v, const StiffeningSpring& spring, double most) {
    const double length = v.norm();
    const StiffeningForce h = stiffening_force(spring, most, length);
    e.coupling_J += h.energy;
    e.is_saturated = e.is_saturated || h.yields;
    // A small stiffness is kept where the force is constant, so that H has an inverse.
    const double least = 1e-6 * spring.stiff,
                 across = majorise ? h.bound : std::max(h.across, least);
    for (int i = 0; i < 3; ++i)
      e.H(at + i, at + i) += across;
    if (length > 0) {
      const Vector3d unit = v / length;
      e.coupling.segment<3>(at) = -h.force * unit;
      if (!majorise)
        e.H.block<3, 3>(at, at) += (std::max(h.along, least) - across) * unit * unit.transpose();
    }
    return h.force;
  };
  const CuttingCoupling& coupling = tick.options.coupling;
  e.coupling_N = add(0, tick.plate.p_m - e.X.p_m, coupling.translation(), coupling.max_force_N);
  add(3, rotation_vector(tick.plate.q * e.X.q.conjugate()), coupling.rotation(),
      coupling.max_moment_Nm);
  e.g += e.coupling;
}

// Adds a force on the tip in a constant direction. `j`: derivative of the tip's displacement in this direction.
void add_at_tip(const Vector3d& direction, const Evaluation::Vector6& j, double force_N,
                double stiffness_N_per_m, const Vector3d& lever, bool majorise,
                Evaluation& e) noexcept {
  e.g += force_N * j;
  if (stiffness_N_per_m > 0) e.H += stiffness_N_per_m * j * j.transpose();
  // Geometric stiffness: the tip moves on a curved path when the tool rotates about
  // the plate's origin.
  if (force_N != 0 && !majorise) {
    const Matrix3d M = 0.5 * force_N * direction * lever.transpose();
    e.H.bottomRightCorner<3, 3>() += M + M.transpose();
    for (int i = 3; i < 6; ++i)
      e.H(i, i) -= force_N * direction.dot(lever);
  }
}

// Adds tip, layers and friction of the shaft. The angle around the shaft is measured as 2 sin(angle
// / 2), whose derivative is simple. The same measure is used throughout, so that energies agree.
void add_axial(const Tick& tick, const Vector3d& tip, const Vector3d& lever, bool majorise,
               Evaluation& e) noexcept {
  const Eigen::Quaterniond turned = e.X.q * tick.back;
  const double sign = turned.w() < 0 ? -2 : 2;
  const Vector3d half = sign * turned.vec();
  e.slide = {tick.axis.dot(tip - tick.tip), tick.options.tool.radius_m * tick.axis.dot(half)};
  e.along << tick.axis, lever.cross(tick.axis);
  const bool is_oblique = tick.is_on_surface() || tick.has_bevel();
  e.pressed_m = is_oblique ? tick.press.dot(tip - tick.tip) : e.slide[0];
  const double stretch = tick.state.stretch_m + e.pressed_m;
  e.tip_N = tick.options.tip_N_per_m * std::max(stretch, 0.0);
  double pressing = e.tip_N, tip_stiffness = stretch > 0 ? tick.options.tip_N_per_m : 0;
  e.hold_J = 0;
  if (const double slip_m = tick.state.hold_slip_m + e.pressed_m; tick.hold_N > 0 && slip_m < 0) {
    const YieldSpring h = yield_spring(tick.state.hold_N_per_m, tick.hold_N, -slip_m, majorise);
    e.hold_J = h.energy;
    pressing -= h.force;
    tip_stiffness += h.along;
  }
  double axial = 0, stiffness = 0;
  if (is_oblique) {
    e.press << tick.press, lever.cross(tick.press);
    add_at_tip(tick.press, e.press, pressing, tip_stiffness, lever, majorise, e);
  } else {
    e.press = e.along;
    axial = pressing;
    stiffness = tip_stiffness;
  }
  e.pressed_N_per_m = stretch > 0 ? tick.options.tip_N_per_m : 0;
  e.layer_J = 0;
  if (!tick.layers.empty()) {
    const SoftSpring layers = spring_of_layers(tick, e.slide[0]);
    e.layer_J = layers.energy_J;
    axial += layers.force_N;
    stiffness += layers.stiffness_N_per_m;
    e.pressed_N_per_m += layers.stiffness_N_per_m;
  }
  // A damper c dissipates the power c v^2. In a tick of length T with the slide s its potential is
  // c s^2 / (2 T).
  const double viscous_N_per_m = tick.viscous_N_s_per_m / tick.options.interval_s;
  e.viscous_J = 0.5 * viscous_N_per_m * e.slide[0] * e.slide[0];
  axial += viscous_N_per_m * e.slide[0];
  stiffness += viscous_N_per_m;
  if (tick.state.friction_N_per_m > 0 || tick.torsion_N > 0)
    e.around =
        0.5 * tick.options.tool.radius_m * (sign * turned.w() * tick.axis + half.cross(tick.axis));
  e.torsion_J = 0;
  if (tick.torsion_N > 0) {
    const double slip_m = tick.state.torsion_slip_m + e.slide[1];
    const YieldSpring h =
        yield_spring(tick.state.torsion_N_per_m, tick.torsion_N, std::abs(slip_m), majorise);
    e.torsion_J = h.energy;
    e.g.tail<3>() += std::copysign(h.force, slip_m) * e.around;
    e.H.bottomRightCorner<3, 3>() += h.along * e.around * e.around.transpose();
  }
  e.friction_J = 0;
  if (tick.state.friction_N_per_m > 0) {
    const Vector2d w = tick.state.presliding_m + e.slide;
    const double length = w.norm();
    const YieldSpring h =
        yield_spring(tick.state.friction_N_per_m, tick.friction_N, length, majorise);
    e.friction_J = h.energy;
    const Vector2d unit = length > 0 ? Vector2d(w / length) : Vector2d::Zero();
    const double less = h.across - h.along;
    axial += h.force * unit[0];
    stiffness += h.across - less * unit[0] * unit[0];
    const Vector3d& around = e.around;
    e.g.tail<3>() += h.force * unit[1] * around;
    const double around2 = h.across - less * unit[1] * unit[1];
    e.H.bottomRightCorner<3, 3>() += around2 * around * around.transpose();
    const double mixed = -less * unit[0] * unit[1];
    if (mixed != 0) {
      const Eigen::Matrix<double, 6, 3> M = mixed * e.along * around.transpose();
      e.H.rightCols<3>() += M;
      e.H.bottomRows<3>() += M.transpose();
    }
  }
  add_at_tip(tick.axis, e.along, axial, stiffness, lever, majorise, e);
}

// Adds the friction of the tip, which acts perpendicular to Tick::normal.
void add_tip_friction(const Tick& tick, const Vector3d& tip, const Vector3d& lever, bool majorise,
                      Evaluation& e) noexcept {
  const Matrix3d across =
      Matrix3d::Identity() - tick.normal * tick.normal.transpose() / tick.normal.squaredNorm();
  e.tip_slide = across * (tip - tick.tip);
  const Vector3d slip = tick.state.tip_slip_m + e.tip_slide;
  const double length = slip.norm();
  const YieldSpring h =
      yield_spring(tick.state.tip_friction_N_per_m, tick.tip_friction_N, length, majorise);
  e.tip_friction_J = h.energy;
  const Vector3d unit = length > 0 ? Vector3d(slip / length) : Vector3d::Zero();
  const Vector3d force = h.force * unit;
  e.g.head<3>() += force;
  e.g.tail<3>() += lever.cross(force);
  const Matrix3d H = h.across * across - (h.across - h.along) * unit * unit.transpose();
  Matrix3d turned;  // a rotation w moves the tip by turned * w
  turned << 0, lever.z(), -lever.y(), -lever.z(), 0, lever.x(), lever.y(), -lever.x(), 0;
  const Matrix3d mixed = H * turned;
  e.H.topLeftCorner<3, 3>() += H;
  e.H.topRightCorner<3, 3>() += mixed;
  e.H.bottomLeftCorner<3, 3>() += mixed.transpose();
  e.H.bottomRightCorner<3, 3>() += turned.transpose() * mixed;
  if (!majorise) {
    const Matrix3d M = 0.5 * force * lever.transpose();
    e.H.bottomRightCorner<3, 3>() += M + M.transpose();
    for (int i = 3; i < 6; ++i)
      e.H(i, i) -= force.dot(lever);
  }
}

using Vector6 = Evaluation::Vector6;
using Matrix6 = Evaluation::Matrix6;

constexpr double kRounding_J = 1e-15;

double size_of(const Vector6& g) noexcept {
  // A moment is converted to a force by a lever of 0.1 m.
  return std::max(g.head<3>().cwiseAbs().maxCoeff(), g.tail<3>().cwiseAbs().maxCoeff() / 0.1);
}
double allowed(const Tick& tick, const Evaluation& e) noexcept {
  return tick.options.tolerance * std::max(1.0, e.coupling_N);
}

// Makes one step of Newton's method that lowers the potential; returns false if none was found. If
// the step from the true second derivative fails, as it can where many elements yield, the
// majorising parabola is used.
bool step(const Tick& tick, Evaluation& e, CuttingResult& out) noexcept {
  Evaluation next;
  constexpr double kMinDecrease = 1e-4;
  constexpr int kMaxHalvings = 10;
  for (const bool majorise : {false, true}) {
    if (majorise) evaluate(tick, e.X, true, e, out);
    BlockInverse inverse;
    if (!inverse.of(e.H)) continue;
    const Vector6 towards = inverse.times(e.g);
    const double slope = -e.g.dot(towards);
    if (!(slope < 0)) continue;
    double share = 1;
    for (int k = 0; k < (majorise ? kMaxHalvings : 2); ++k, share *= 0.25) {
      evaluate(tick, moved(e.X, -share * towards), false, next, out);
      // Close to the minimum, differences of the potential are lost in rounding, so the
      // gradients are compared.
      if (next.V <= e.V + kMinDecrease * share * slope ||
          (next.V <= e.V + kRounding_J && size_of(next.g) < size_of(e.g))) {
        e = next;
        return true;
      }
    }
  }
  return false;
}

void minimise(const Tick& tick, Evaluation& e, CuttingResult& out) noexcept {
  while (true) {
    out.has_converged = size_of(e.g) <= allowed(tick, e);
    if (out.has_converged || out.steps >= tick.options.max_steps) return;
    ++out.steps;
    if (!step(tick, e, out)) {
      // The potential is as low as rounding permits.
      out.has_converged = size_of(e.g) <= 1e3 * allowed(tick, e);
      return;
    }
  }
}

// Linear model at one evaluation. `press`: displacement of the proxy per unit of the tip's force,
// at a fixed front. `K_s`: decrease of the tip's force per metre of advance of the front, if the
// proxy follows.
struct Model {
  Vector6 press = Vector6::Zero();
  double K_s = 0;
};
Model model_of(const Tick& tick, const Evaluation& e, const BlockInverse& inverse) noexcept {
  Model m{inverse.times(e.press), tick.options.tip_N_per_m};
  if (e.tip_N > 0)
    m.K_s = std::clamp(m.K_s * (1 - m.K_s * e.press.dot(m.press)), 1e-9 * m.K_s, m.K_s);
  return m;
}

// Computes Newton's step `-towards`. If friction is elastic but would slide in that step, the step
// is computed again with sliding friction, as in most ticks in which the tool moves.
bool newton(const Tick& tick, const Evaluation& e, BlockInverse& inverse,
            Vector6& towards) noexcept {
  if (!inverse.of(e.H)) return false;
  towards = inverse.times(e.g);
  if (tick.state.friction_N_per_m <= 0) return true;
  const Vector2d w = tick.state.presliding_m + e.slide;
  const double length = w.norm();
  if (length > tick.options.presliding_m) return true;
  const Vector2d next = w - Vector2d(e.along.dot(towards), e.around.dot(towards.tail<3>()));
  const double next_length = next.norm();
  if (next_length <= tick.options.presliding_m) return true;
  const Vector2d unit = next / next_length;
  Vector6 j = unit[0] * e.along;
  j.tail<3>() += unit[1] * e.around;
  const Matrix6 H = e.H - tick.state.friction_N_per_m * j * j.transpose();
  BlockInverse sliding;
  if (!sliding.of(H)) return true;
  inverse = sliding;
  towards = sliding.times(e.g + (tick.friction_N - tick.state.friction_N_per_m * w.dot(unit)) * j);
  return true;
}

// Moves proxy and front together, by the tip force that the linear model predicts. Returns false if
// the model does not hold; then `e` and the front are as before the front's last step.
bool step_together(Tick& tick, Evaluation& e, CuttingResult& out) noexcept {
  Evaluation before = e;
  FrontMemory was = remember(tick, out);
  double least_N = 0;  // with a smaller tip force, the front's last step went too far
  while (true) {
    out.has_converged = size_of(e.g) <= allowed(tick, e);
    if (out.has_converged && e.tip_N <= 0) return true;
    BlockInverse inverse;
    Vector6 towards;
    if (!newton(tick, e, inverse, towards)) return false;
    const Model m = model_of(tick, e, inverse);
    const double R = e.tip_N - tick.options.tip_N_per_m * e.press.dot(towards);
    if (least_N > 0 && R < least_N - std::max(allowed(tick, e), 1e-9 * least_N)) {
      take_back(tick, was, out);
      e = before;
      return false;
    }
    Advance a;
    if (e.tip_N > 0 && R > 0) a = scan(tick, R, m.K_s);
    // The advance is within the tolerance of Newton's method.
    if (m.K_s * a.length_m <= allowed(tick, e)) {
      if (out.has_converged) return true;
      a = {};
    } else if (e.is_saturated) {
      return false;
    }
    if (out.steps >= tick.options.max_steps) {
      out.has_converged = false;
      return true;
    }
    ++out.steps;
    const double V = e.V;
    const Pose X = moved(e.X, tick.options.tip_N_per_m * a.length_m * m.press - towards);
    if (a.length_m > 0) {
      before = e;
      was = remember(tick, out);
      least_N = a.strength_N;
      take(tick, a, out);
    }
    evaluate(tick, X, false, e, out);
    if (!(e.V + a.work_J <= V + kRounding_J)) {
      take_back(tick, was, out);
      e = before;
      return false;
    }
  }
}

// Alternates between Newton's method at a fixed front and steps of the front by the resulting tip
// force.
void step_in_turn(Tick& tick, Evaluation& e, CuttingResult& out) noexcept {
  minimise(tick, e, out);
  constexpr int kMaxAdvances = 24;
  for (int k = 0; k < kMaxAdvances && e.tip_N > 0; ++k) {
    // While the coupling is at its limit, the force does not fall as the front advances, so the
    // tangent would miss the point at which the coupling leaves its limit. The majorising parabola
    // acts like a secant, which stops before that point. It also serves for a tool that is about to
    // tilt over, where H has no inverse.
    BlockInverse inverse;
    bool has_model = !e.is_saturated && inverse.of(e.H);
    if (!has_model) {
      evaluate(tick, e.X, true, e, out);
      has_model = inverse.of(e.H);
    }
    Model m;
    m.K_s = tick.options.tip_N_per_m;
    if (has_model) m = model_of(tick, e, inverse);
    Advance a = scan(tick, e.tip_N, m.K_s);
    if (a.length_m <= 0) return;
    const Evaluation before = e;
    const FrontMemory was = remember(tick, out);
    constexpr int kMaxTries = 3;
    for (int tries = 0;; ++tries) {
      if (tries == kMaxTries || out.steps >= tick.options.max_steps || !has_model) {
        // If the proxy keeps its position, the tip's force falls fastest, so the front never
        // advances too far.
        a = scan(tick, before.tip_N, tick.options.tip_N_per_m);
        take(tick, a, out);
        evaluate(tick, before.X, false, e, out);
        minimise(tick, e, out);
        break;
      }
      take(tick, a, out);
      ++out.steps;
      evaluate(tick, moved(before.X, tick.options.tip_N_per_m * a.length_m * m.press), false, e,
               out);
      minimise(tick, e, out);
      const double slack = std::max(allowed(tick, e), 1e-9 * before.tip_N);
      const bool too_far = a.strength_N > 0 && e.tip_N < a.strength_N - slack;
      if (!too_far && e.V + a.work_J <= before.V + kRounding_J) break;
      const double secant = (before.tip_N - e.tip_N) / a.length_m;
      take_back(tick, was, out);
      a = scan(tick, before.tip_N, std::clamp(secant, m.K_s, tick.options.tip_N_per_m));
      e = before;
    }
    if (m.K_s * a.length_m <= allowed(tick, e))
      return;  // the advance is within the tolerance of Newton's method
    if (out.steps >= tick.options.max_steps) {
      out.has_converged =
          out.has_converged && scan(tick, e.tip_N, m.K_s).length_m * m.K_s <= allowed(tick, e);
      return;
    }
  }
}

void settle_front(Tick& tick, Evaluation& e, CuttingResult& out) noexcept {
  if (!step_together(tick, e, out)) step_in_turn(tick, e, out);
}

// Advances the front of the soft layer that the tip presses on; returns false if it stays. The tip
// follows according to the linear model. If that raises the potential, the step is repeated with
// the tip held in place, which never raises it.
bool advance_layer(Tick& tick, Evaluation& e, CuttingResult& out) noexcept {
  if (pressed_layer(tick, e.slide[0]) < 0) return false;
  constexpr double kMinFalling = 1e-3;
  double falling = 1;
  Vector6 along = Vector6::Zero();
  BlockInverse inverse;
  if (!e.is_saturated && inverse.of(e.H)) {
    along = inverse.times(e.along);
    falling = std::clamp(1 - e.pressed_N_per_m * e.along.dot(along), kMinFalling, 1.0);
  }
  LayerAdvance a = scan_layers(tick, e.slide[0], e.tip_N, falling, out);
  if (a.layer < 0) return false;
  if (!a.ends_layer && falling * a.stiffness_N_per_m * a.length_m <= allowed(tick, e)) return false;
  SoftLayerState& state = tick.state.layers[static_cast<std::size_t>(a.layer)];
  const double stretch_m = state.stretch_m, cut_m = state.cut_m, cut_J = out.layer_cut_J;
  take(tick, a, out);
  Evaluation next;
  const double follows_N = a.ends_layer ? 0 : a.stiffness_N_per_m * a.length_m;
  evaluate(tick, moved(e.X, follows_N * along), false, next, out);
  if (!(next.V + a.work_J <= e.V + kRounding_J)) {
    state.stretch_m = stretch_m;
    state.cut_m = cut_m;
    out.layer_cut_J = cut_J;
    a = scan_layers(tick, e.slide[0], e.tip_N, 1, out);
    take(tick, a, out);
    evaluate(tick, e.X, false, next, out);
  }
  e = next;
  return true;
}

}  // namespace

void evaluate(const Tick& tick, const Pose& X, bool majorise, Evaluation& e,
              CuttingResult& out) noexcept {
  ++out.evaluations;
  e.X = X;
  e.g.setZero();
  e.H.setZero();
  const Vector3d axis = X.q * tick.options.tool.inward_plate,
                 lever = X.q * tick.options.tool.tip_plate_m;
  const Vector3d tip = X.p_m + lever;
  add_coupling(tick, majorise, e);
  add_axial(tick, tip, lever, majorise, e);
  add_walls(tick, tip, axis, lever, majorise, e);
  e.tip_friction_J = 0;
  if (tick.tip_friction_N > 0) add_tip_friction(tick, tip, lever, majorise, e);
  const double stretch = tick.state.stretch_m + e.pressed_m;
  e.V = e.coupling_J + e.friction_J + e.wall_J + e.viscous_J +
        (stretch > 0 ? 0.5 * tick.options.tip_N_per_m * stretch * stretch : 0) + e.layer_J +
        e.tip_friction_J + e.hold_J + e.torsion_J;
}

void settle(Tick& tick, Evaluation& e, CuttingResult& out) noexcept {
  settle_front(tick, e, out);
  for (int k = 0; k < kMaxLayerAdvances && advance_layer(tick, e, out); ++k)
    settle_front(tick, e, out);
}

}  // namespace trocar::runtime
