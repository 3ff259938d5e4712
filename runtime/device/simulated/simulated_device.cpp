// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/simulated/simulated_device.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;

constexpr int kMaxSubsteps = 100000;  // kMaxStep_s / shortest maximum_substep_s

Vector3d plate_inertia(const DeviceDescription& device) noexcept {
  return Vector3d(device.plate_inertia_kg_m2.data());
}

double plate_energy(const DeviceDescription& device, const Pose& T, const Twist& twist) noexcept {
  const Vector3d omega_plate = T.q.conjugate() * Vector3d(twist.tail<3>());
  return 0.5 * (device.plate_mass_kg * twist.head<3>().squaredNorm() +
                omega_plate.dot(plate_inertia(device).cwiseProduct(omega_plate)));
}

/// Returns an approximately normal number with standard deviation 1. It is the sum of four
/// uniform numbers from 64 random bits, and is at most 3.5. (std::normal_distribution
/// differs between libraries.)
double approximately_normal(std::uint64_t bits) noexcept {
  double sum = 0;
  for (int i = 0; i < 4; ++i)
    sum += (static_cast<double>((bits >> (16 * i)) & 0xffff) + 0.5) / 65536 - 0.5;
  return sum * std::numbers::sqrt3;
}

Result<void> check_mechanics(const SimulatedDeviceOptions& options) {
  if (!options.mechanics) return {};
  const MechanicsOptions& m = *options.mechanics;
  const auto good = [](double value) { return std::isfinite(value) && value >= 0; };
  if (!std::all_of(m.link_mass_kg.begin(), m.link_mass_kg.end(), good) ||
      !good(m.rotor_inertia_kg_m2) || !good(m.coulomb_friction_Nm) || !good(m.presliding_rad) ||
      !(m.presliding_rad > 0) || !good(m.presliding_damping_s) || !good(m.current_lag_s) ||
      !good(m.encoder_noise_rad)) {
    return refused(
        "simulated device: masses, friction, lag and noise must be finite and not "
        "negative, the presliding angle positive");
  }
  return {};
}

/// Returns the largest eigenvalue of M^-1 A. A is the translational and rotational damping, or
/// stiffness, of a hand that holds the tip. M is the inertia of the plate without links and motors.
/// The result is in 1/s for a damping and in 1/s^2 for a stiffness. `lever_m`: the vector from the
/// plate's origin to the tip, in the plate's frame.
double max_rate(const DeviceDescription& device, const Vector3d& lever_m, double translation,
                double rotation) {
  MassMatrix tip = MassMatrix::Identity();  // maps the twist of the plate to that of the tip
  tip.topRightCorner<3, 3>() << 0, lever_m.z(), -lever_m.y(), -lever_m.z(), 0, lever_m.x(),
      lever_m.y(), -lever_m.x(), 0;
  Wrench at_tip, inertia;
  at_tip << Vector3d::Constant(translation), Vector3d::Constant(rotation);
  inertia << Vector3d::Constant(device.plate_mass_kg), plate_inertia(device);
  const MassMatrix about_plate = tip.transpose() * at_tip.asDiagonal() * tip;
  return Eigen::GeneralizedSelfAdjointEigenSolver<MassMatrix>(
             about_plate, MassMatrix(inertia.asDiagonal()), Eigen::EigenvaluesOnly)
      .eigenvalues()
      .maxCoeff();
}

Twist moved_to(const Twist& twist, const Vector3d& lever_m) noexcept {
  Twist moved = twist;
  moved.head<3>() += Vector3d(twist.tail<3>()).cross(lever_m);
  return moved;
}

constexpr double kLongestSubstep_s = 1e-4;

double rounded_to(double value, double resolution) noexcept {
  return resolution > 0 ? std::round(value / resolution) * resolution : value;
}

}  // namespace

Result<SimulatedDevice> SimulatedDevice::make(const DeviceDescription& device,
                                              const HandMotion& motion,
                                              const HandImpedance& impedance,
                                              const SimulatedDeviceOptions& options) {
  if (auto checked = check_hand(motion, impedance); !checked) return checked.error();
  if (auto checked = check_mechanics(options); !checked) return checked.error();
  SimulatedDevice simulated(device, motion, impedance, options);
  Pose& T = simulated.truth_.T_device_plate;
  if (options.T_device_plate_start)
    T = *options.T_device_plate_start;
  else if (const std::optional<Pose> T_device_tool = hand_start(motion))
    T = *T_device_tool * inverse(options.T_plate_tool);
  else
    T.p_m.z() = kSimulatedHomeHeight_m;
  const InverseResult start = inverse_kinematics(device, T);
  if (!start.status) {
    return refused("simulated device: the start pose is " +
                   std::string(to_string(start.status.failure)) + " (leg " +
                   std::to_string(start.status.leg) + ", theta" +
                   std::to_string(start.status.joint) + ")");
  }
  simulated.truth_.joints = start.joints;
  simulated.hand_mass_attached_ = hand_holds(motion, impedance, 0);
  const Vector3d& lever_m = options.T_plate_tool.p_m;
  simulated.damping_rate_per_s_ = max_rate(device, lever_m, impedance.damping_Ns_per_m,
                                           impedance.rotational_damping_Nms_per_rad);
  simulated.stiffness_rate_per_s2_ = max_rate(device, lever_m, impedance.stiffness_N_per_m,
                                              impedance.rotational_stiffness_Nm_per_rad);
  if (options.mechanics) simulated.noise_.seed(options.mechanics->seed);
  return simulated;
}

DeviceStatus SimulatedDevice::read(DeviceState& state) noexcept {
  state.t_s = std::round(truth_.t_s * 1e9) / 1e9;
  state.encoder_rad = encoder_angles(truth_.joints);
  const double own_rad = options_.mechanics ? options_.mechanics->encoder_noise_rad : 0,
               noise_rad = own_rad > 0 ? own_rad : device_.encoder_noise_rad;
  if (noise_rad > 0) {
    for (double& angle : state.encoder_rad)
      angle += noise_rad * approximately_normal(noise_());
  }
  if (device_.encoder_counts_per_revolution > 0) {
    const double count_rad = 2 * std::numbers::pi / device_.encoder_counts_per_revolution;
    for (double& angle : state.encoder_rad)
      angle = std::round(angle / count_rad) * count_rad;
  }
  return DeviceStatus::kOk;
}

DeviceStatus SimulatedDevice::write(const DeviceCommand& command) noexcept {
  MotorVector tau(command.tau_motor_Nm.data());
  if (!tau.allFinite()) tau.setZero();
  const double peak = device_.motor_peak_torque_Nm;
  tau = tau.cwiseMin(peak).cwiseMax(-peak);
  std::copy(tau.data(), tau.data() + kMotors, command_Nm_.begin());
  if (!device_.delay_s) truth_.tau_motor_Nm = tau;
  return DeviceStatus::kOk;
}

TrueTip SimulatedDevice::tip() const noexcept {
  const Vector3d lever_m = truth_.T_device_plate.q * options_.T_plate_tool.p_m;
  return {truth_.T_device_plate.p_m + lever_m, moved_to(truth_.twist_device, lever_m).head<3>()};
}

bool SimulatedDevice::step(double dt_s) noexcept {
  if (!(dt_s > 0 && dt_s <= kMaxStep_s)) return false;
  const double wanted = std::ceil(dt_s / device_.maximum_substep_s);
  int substeps =
      std::max(device_.minimum_substeps, static_cast<int>(std::min<double>(wanted, kMaxSubsteps)));
  // Semi-implicit Euler is stable if 2 h d + h^2 k < 4 (Jury's criterion), where h is the substep,
  // and d and k are the rates of the hand's damping and stiffness.
  const double described_s = dt_s / substeps,
               growth =
                   described_s * (2 * damping_rate_per_s_ + described_s * stiffness_rate_per_s2_);
  if (growth >= 4)
    substeps = static_cast<int>(std::min<double>(substeps * std::ceil(growth / 2), kMaxSubsteps));
  const double h_s = dt_s / substeps;
  if (device_.delay_s)
    truth_.tau_motor_Nm = MotorVector(delayed_.after(*device_.delay_s, dt_s, command_Nm_).data());
  truth_.at_stop = false;
  if (const auto* const unscripted = std::get_if<1>(&motion_))
    unscripted->get().begin_step(truth_.t_s, dt_s, truth_.T_device_plate * options_.T_plate_tool);
  for (int i = 0; i < substeps; ++i) {
    const double t_s = truth_.t_s + i * h_s;
    if (hand_mass_attached_ && !hand_holds(motion_, impedance_, t_s)) release_hand_mass();
    if (uses_mechanics())
      midpoint_substep(t_s, h_s);
    else
      substep(t_s, h_s);
  }
  truth_.t_s += dt_s;
  truth_.kinetic_J = kinetic_energy();
  return true;
}

void SimulatedDevice::substep(double t_s, double h_s) noexcept {
  const Pose T = truth_.T_device_plate;
  const Twist before = truth_.twist_device;
  const Vector3d lever_m = T.q * options_.T_plate_tool.p_m;

  // Compute the wrenches on the plate. At a singular pose the wrenches of motors and friction are
  // undefined; such a pose counts as a limit of the workspace.
  const JacobianResult motion = jacobian(device_, T, truth_.joints);
  const Jacobian G = motion.status ? motion.G : Jacobian::Zero();
  truth_.tau_applied_Nm = truth_.tau_motor_Nm;
  const Wrench motors = G.transpose() * truth_.tau_motor_Nm;
  const Wrench friction =
      -device_.joint_viscous_friction_Nms_per_rad * (G.transpose() * (G * before));
  truth_.wrench_hand.setZero();
  if (hand_holds(motion_, impedance_, t_s)) {
    truth_.wrench_hand = hand_wrench(impedance_, hand_target(motion_, t_s),
                                     T * options_.T_plate_tool, moved_to(before, lever_m));
  }
  const Wrench hand = moved_by(truth_.wrench_hand, lever_m);
  Wrench gravity = Wrench::Zero();
  gravity[2] = -device_.plate_mass_kg * device_.gravity_m_per_s2;
  const Wrench total = motors + friction + hand + gravity;

  // Update the momentum first, then the pose with the new velocity. The angular momentum is
  // expressed in {B}, so gyroscopic moments need no term.
  const Vector3d inertia = plate_inertia(device_);
  const auto momentum = [&](const Eigen::Quaterniond& q, const Vector3d& omega) -> Vector3d {
    return q * Vector3d(inertia.cwiseProduct(q.conjugate() * omega));
  };
  const auto rate = [&](const Eigen::Quaterniond& q, const Vector3d& L) -> Vector3d {
    return q * Vector3d((q.conjugate() * L).cwiseQuotient(inertia));
  };
  const Vector3d L = momentum(T.q, before.tail<3>()) + h_s * total.tail<3>();
  Twist after;
  after.head<3>() = before.head<3>() + (h_s / device_.plate_mass_kg) * total.head<3>();
  after.tail<3>() = rate(T.q, L);
  Pose moved;
  moved.p_m = T.p_m + h_s * after.head<3>();
  moved.q = (from_rotation_vector(h_s * after.tail<3>()) * T.q).normalized();

  const Twist middle = 0.5 * (before + after);
  EnergyBalance& work = truth_.work;
  work.hand_J += h_s * hand.dot(middle);
  work.motors_J += h_s * motors.dot(middle);
  work.friction_J += h_s * friction.dot(middle);
  work.gravity_J += h_s * gravity.dot(middle);

  const InverseResult reached = inverse_kinematics(device_, moved);
  if (!motion.status || !reached.status) {
    work.stop_J -= plate_energy(device_, T, after);
    truth_.twist_device.setZero();
    truth_.at_stop = true;
    return;
  }
  after.tail<3>() = rate(moved.q, L);  // the same momentum in the rotated body
  truth_.T_device_plate = moved;
  truth_.twist_device = after;
  truth_.joints = reached.joints;
}

/// Forces at one stage of the midpoint rule.
struct SimulatedDevice::Forces {
  Mechanics mechanics;
  MotorVector tau_Nm = MotorVector::Zero(), presliding_rad = MotorVector::Zero();
  Wrench motors = Wrench::Zero(), friction = Wrench::Zero(), hand_at_tip = Wrench::Zero(),
         hand = Wrench::Zero();
  Twist acceleration = Twist::Zero();
};

/// `since_s` is the time since the start of the substep, at which presliding_rad_ and the applied
/// torques are known.
SimulatedDevice::Forces SimulatedDevice::forces(const Pose& T, const JointAngles& joints,
                                                const Twist& twist, double t_s,
                                                double since_s) const noexcept {
  const MechanicsOptions options = options_.mechanics.value_or(MechanicsOptions::none());
  const Vector3d lever_m = T.q * options_.T_plate_tool.p_m;
  Forces result;
  result.mechanics =
      trocar::runtime::mechanics(device_, options, T, joints, twist, hand_mass_kg(), lever_m);
  if (!result.mechanics.status) return result;
  const Jacobian& G = result.mechanics.G;

  const double left = options.current_lag_s > 0 ? std::exp(-since_s / options.current_lag_s) : 0;
  result.tau_Nm = truth_.tau_motor_Nm + left * (truth_.tau_applied_Nm - truth_.tau_motor_Nm);
  result.motors = G.transpose() * result.tau_Nm;

  // Dry friction is a spring that slips at the Coulomb torque, so it is defined at rest, and can
  // hold the joint.
  const MotorVector rate = G * twist;
  result.presliding_rad = (presliding_rad_ + since_s * rate)
                              .cwiseMin(options.presliding_rad)
                              .cwiseMax(-options.presliding_rad);
  const MotorVector dry_share = (result.presliding_rad + options.presliding_damping_s * rate)
                                    .cwiseMin(options.presliding_rad)
                                    .cwiseMax(-options.presliding_rad) /
                                options.presliding_rad;
  result.friction = -G.transpose() * (device_.joint_viscous_friction_Nms_per_rad * rate +
                                      options.coulomb_friction_Nm * dry_share);
  if (hand_holds(motion_, impedance_, t_s)) {
    result.hand_at_tip = hand_wrench(impedance_, hand_target(motion_, t_s),
                                     T * options_.T_plate_tool, moved_to(twist, lever_m));
    result.hand = moved_by(result.hand_at_tip, lever_m);
  }
  const Wrench total = result.motors + result.friction + result.hand + result.mechanics.weight;
  result.acceleration = result.mechanics.mass.ldlt().solve(total - result.mechanics.bias);
  return result;
}

void SimulatedDevice::midpoint_substep(double t_s, double h_s) noexcept {
  const Pose T = truth_.T_device_plate;
  const Twist before = truth_.twist_device;
  const auto stop = [&] {
    truth_.work.stop_J -= kinetic_energy();
    truth_.twist_device.setZero();
    truth_.at_stop = true;
  };

  const Forces first = forces(T, truth_.joints, before, t_s, 0);
  const Twist middle = before + h_s / 2 * first.acceleration;
  const Pose T_middle = moved(T, h_s / 2 * before);
  const InverseResult joints_middle = inverse_kinematics(device_, T_middle);
  if (!first.mechanics.status || !joints_middle.status) return stop();
  const Forces half = forces(T_middle, joints_middle.joints, middle, t_s + h_s / 2, h_s / 2);
  const Pose T_after = moved(T, h_s * middle);
  const InverseResult joints_after = inverse_kinematics(device_, T_after);

  EnergyBalance& work = truth_.work;
  work.hand_J += h_s * half.hand.dot(middle);
  work.motors_J += h_s * half.motors.dot(middle);
  work.friction_J += h_s * half.friction.dot(middle);
  work.gravity_J += h_s * half.mechanics.weight.dot(middle);
  truth_.wrench_hand = half.hand_at_tip;

  const MechanicsOptions options = options_.mechanics.value_or(MechanicsOptions::none());
  const double left = options.current_lag_s > 0 ? std::exp(-h_s / options.current_lag_s) : 0;
  truth_.tau_applied_Nm =
      truth_.tau_motor_Nm + left * (truth_.tau_applied_Nm - truth_.tau_motor_Nm);
  truth_.twist_device = before + h_s * half.acceleration;
  if (!half.mechanics.status || !joints_after.status) return stop();
  presliding_rad_ = (presliding_rad_ + h_s * (half.mechanics.G * middle))
                        .cwiseMin(options.presliding_rad)
                        .cwiseMax(-options.presliding_rad);
  truth_.T_device_plate = T_after;
  truth_.joints = joints_after.joints;
}

/// Removes the hand's mass, which keeps its speed and takes its kinetic energy with it.
void SimulatedDevice::release_hand_mass() noexcept {
  const Vector3d lever_m = truth_.T_device_plate.q * options_.T_plate_tool.p_m;
  const Twist tip = moved_to(truth_.twist_device, lever_m);
  truth_.work.hand_J -= 0.5 * impedance_.mass_kg * tip.head<3>().squaredNorm();
  hand_mass_attached_ = false;
}

double SimulatedDevice::kinetic_energy() const noexcept {
  const Twist& twist = truth_.twist_device;
  if (!uses_mechanics()) return plate_energy(device_, truth_.T_device_plate, twist);
  const Vector3d lever_m = truth_.T_device_plate.q * options_.T_plate_tool.p_m;
  const Mechanics all = trocar::runtime::mechanics(
      device_, options_.mechanics.value_or(MechanicsOptions::none()), truth_.T_device_plate,
      truth_.joints, twist, hand_mass_kg(), lever_m);
  return all.status ? 0.5 * twist.dot(all.mass * twist)
                    : plate_energy(device_, truth_.T_device_plate, twist);
}

Result<SimulatedPoseDevice> SimulatedPoseDevice::make(const PoseDeviceDescription& description,
                                                      const PoseFrame& frame,
                                                      const HandMotion& motion,
                                                      const HandImpedance& impedance,
                                                      const Pose& T_plate_tool) {
  if (auto checked = check_hand(motion, impedance); !checked) return checked.error();
  SimulatedPoseDevice made(description, frame, motion, impedance, T_plate_tool);
  made.T_ = hand_start(motion).value_or(Pose{}) * inverse(T_plate_tool);
  return made;
}

DeviceStatus SimulatedPoseDevice::read(PoseReading& reading) noexcept {
  reading = frame_.reading(T_);
  reading.t_s = std::round(t_s_ * 1e9) / 1e9;
  for (double& at_m : reading.p_m) {
    if (description_.position_noise_m > 0)
      at_m += description_.position_noise_m * approximately_normal(noise_());
    at_m = rounded_to(at_m, description_.position_resolution_m.value_or(0));
  }
  const double step_rad = description_.rotation_resolution_rad.value_or(0),
               noise_rad = description_.rotation_noise_rad;
  if (!description_.senses_rotation || (step_rad == 0 && noise_rad == 0)) return DeviceStatus::kOk;
  Eigen::Vector4d q;
  for (int i = 0; i < 4; ++i)
    q[i] = reading.q[static_cast<std::size_t>(i)];
  if (noise_rad > 0) {
    Eigen::Vector3d turn;
    for (double& angle : turn)
      angle = noise_rad * approximately_normal(noise_());
    const Eigen::Quaterniond turned =
        from_rotation_vector(turn) * Eigen::Quaterniond(q[0], q[1], q[2], q[3]);
    q << turned.w(), turned.vec();
  }
  for (double& each : q)
    each = rounded_to(each, step_rad / 2);
  q.normalize();
  reading.q = {q[0], q[1], q[2], q[3]};
  return DeviceStatus::kOk;
}

DeviceStatus SimulatedPoseDevice::write(const HandleWrench& wrench) noexcept {
  Wrench command = frame_.from_device(wrench);
  if (!command.allFinite()) command.setZero();
  std::copy(command.data(), command.data() + 6, command_.begin());
  return DeviceStatus::kOk;
}

/// Returns the hand's wrench on the plate about its origin.
Wrench SimulatedPoseDevice::hand(double t_s) const noexcept {
  if (!hand_holds(motion_, impedance_, t_s)) return Wrench::Zero();
  const HandTarget target = hand_target(motion_, t_s);
  const Eigen::Vector3d lever_m = T_.q * T_plate_tool_.p_m;
  return moved_by(hand_wrench(impedance_, target, T_ * T_plate_tool_, moved_to(twist_, lever_m)),
                  lever_m);
}

void SimulatedPoseDevice::advance(double dt_s) noexcept {
  if (!(dt_s > 0)) return;
  // A longer step would only follow from a stopped process; the rest of its time is lost.
  const double step_s = std::min(dt_s, kMaxStep_s);
  const int substeps = std::max(1, static_cast<int>(std::ceil(step_s / kLongestSubstep_s - 1e-9)));
  if (const auto* const unscripted = std::get_if<1>(&motion_))
    unscripted->get().begin_step(t_s_, step_s, T_ * T_plate_tool_);
  applied_ = Wrench(delayed_.after(description_.delay_s.value_or(0), dt_s, command_).data());
  for (int i = 0; i < substeps; ++i)
    substep(t_s_ + i * step_s / substeps, step_s / substeps);
  t_s_ += dt_s;
}

void SimulatedPoseDevice::substep(double t_s, double h_s) noexcept {
  // Damping by device and hand is implicit, so that it is stable for any mass. The hand's wrench contains its own.
  const bool holds = hand_holds(motion_, impedance_, t_s);
  const double hand_N_s_per_m = holds ? impedance_.damping_Ns_per_m : 0;
  const double hand_Nm_s_per_rad = holds ? impedance_.rotational_damping_Nms_per_rad : 0;
  Wrench total = applied_ + hand(t_s);
  total.head<3>() += hand_N_s_per_m * twist_.head<3>();
  total.tail<3>() += hand_Nm_s_per_rad * twist_.tail<3>();
  const double rate = h_s / description_.mass_kg;
  twist_.head<3>() = (twist_.head<3>() + rate * total.head<3>()) /
                     (1 + rate * (description_.damping_N_s_per_m + hand_N_s_per_m));
  if (description_.coulomb_friction_N > 0) {
    const double speed = twist_.head<3>().norm(), less = rate * description_.coulomb_friction_N;
    twist_.head<3>() *= speed > less ? 1 - less / speed : 0;
  }
  T_.p_m += h_s * twist_.head<3>();
  if (!description_.senses_rotation) return;
  for (int i = 0; i < 3; ++i) {
    const double turn = h_s / description_.inertia_kg_m2[static_cast<std::size_t>(i)];
    twist_[3 + i] = (twist_[3 + i] + turn * total[3 + i]) /
                    (1 + turn * (description_.rotation_damping_Nm_s_per_rad + hand_Nm_s_per_rad));
  }
  T_.q = (from_rotation_vector(h_s * twist_.tail<3>()) * T_.q).normalized();
}

}  // namespace trocar::runtime
