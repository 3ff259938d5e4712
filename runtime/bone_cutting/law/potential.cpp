// SPDX-License-Identifier: Apache-2.0
#include "runtime/bone_cutting/law/potential.h"

#include <cmath>

#include "runtime/bone_cutting/law/soft_layers.h"
#include "runtime/bone_cutting/law/yield_spring.h"

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
  const auto add = [&](int at, const Vector3d& v, double k, double most) {
    const double length = v.norm();
    const YieldSpring h = yield_spring(k, most, length, majorise);
    e.coupling_J += h.energy;
    e.is_saturated = e.is_saturated || k * length > most;
    // A small stiffness is kept where the force is constant, so that H has an inverse.
    for (int i = 0; i < 3; ++i)
      e.H(at + i, at + i) += std::max(h.across, 1e-6 * k);
    if (length > 0) {
      const Vector3d unit = v / length;
      e.coupling.segment<3>(at) = -h.force * unit;
      const double less = h.across - std::max(h.along, 1e-6 * k);
      if (less > 0) e.H.block<3, 3>(at, at) -= less * unit * unit.transpose();
    }
    return h.force;
  };
  e.coupling_N = add(0, tick.plate.p_m - e.X.p_m, tick.options.coupling.translation_N_per_m,
                     tick.options.coupling.max_force_N);
  add(3, rotation_vector(tick.plate.q * e.X.q.conjugate()),
      tick.options.coupling.rotation_Nm_per_rad, tick.options.coupling.max_moment_Nm);
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

}  // namespace trocar::runtime
