// SPDX-License-Identifier: GPL-3.0-or-later
// The device with arbitrary numbers, including every bit pattern of a double: poses, encoders,
// wrenches, limits, currents, a hand, a scene, one number of the description, and the loop with
// corrupted readings. Each result is finite and within its contract, or a named refusal. In: a hard
// case or a scene (tests/corpus/device), or bytes that encode a kind and its doubles.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "formats/session/device_protocol.h"
#include "formats/session/scene.h"
#include "runtime/device/four_legs/four_legs.h"
#include "runtime/device/four_legs/mechanism_limits.h"
#include "runtime/device/simulated/simulated_device.h"
#include "runtime/haptics/loop/haptic_loop.h"
#include "tests/cases/device_case.h"
#include "tests/cases/limits_by_name.h"
#include "tests/cases/set_device.h"
#include "tests/fuzz/harness.h"
#include "tests/reference/mechanism/influence_jacobian.h"
#include "tests/reference/mechanism/leg_assemblies.h"
#include "tests/support/sheet_fixture.h"
#include "tests/support/sheet_law_fixture.h"

namespace {

using namespace trocar;           // NOLINT(google-build-using-namespace): a program of one file
using namespace trocar::runtime;  // NOLINT(google-build-using-namespace)
using fuzz::fail;
using test::SetDevice;
using Encoders = std::array<double, kEncoders>;

constexpr int kMaxLoopTicks = 40, kMaxSteps = 20;

const DeviceDescription& paper_device() {
  static const DeviceDescription made = default_device_description();
  return made;
}

Pose middle() {
  Pose out;
  out.p_m.z() = 0.15;
  return out;
}

bool finite(const Encoders& angles) {
  return std::all_of(angles.begin(), angles.end(), [](double a) { return std::isfinite(a); });
}

void expect_named(const KinematicsStatus& status, bool of_a_leg) {
  if (status.failure > KinematicsFailure::kBeyondLimit) fail("kinematics: a failure without name");
  if (of_a_leg && (status.leg < 1 || status.leg > kLegs || status.joint < 1 || status.joint > 6))
    fail("kinematics: a failure without leg and joint");
}

void expect_pose(const ForwardResult& result) {
  if (!result.status) return expect_named(result.status, false);
  if (!is_finite(result.T_device_plate) ||
      std::abs(result.T_device_plate.q.squaredNorm() - 1) > 1e-9)
    fail("forward: an invalid pose");
  if (!(result.residual_m >= 0) || !std::isfinite(result.residual_m)) fail("forward: residual");
}

// Laws 1 and 2 of torque_allocation.h.
void check_allocation(const Jacobian& G, const Wrench& wanted, const MotorVector& limit) {
  const AllocationResult got = allocate_torques(G, wanted, limit);
  if (!got.tau_motor_Nm.allFinite() || !got.wrench_device.allFinite())
    fail("allocation: not finite");
  if (got.kind == AllocationKind::kRefused) {
    if (got.tau_motor_Nm != MotorVector::Zero())
      fail("allocation: refused with torques that are not zero");
    return;
  }
  if (!G.allFinite() || !wanted.allFinite() || !limit.allFinite() || !(limit.minCoeff() > 0))
    fail("allocation: invalid input is accepted");
  if (!(got.tau_motor_Nm.array().abs() <= limit.array()).all()) fail("allocation: law 1");
  if (!(got.scale >= 0 && got.scale <= 1)) fail("allocation: scale");
  // This holds if squares neither vanish nor overflow.
  const double torque = got.tau_motor_Nm.norm();
  if (!(torque > 1e-150 && torque < 1e150)) return;
  const Wrench off = G.transpose() * got.tau_motor_Nm - got.scale * wanted;
  if (!(off.norm() <= 1e-9 * G.norm() * torque))
    fail("allocation: the wrench has another direction");
}

void check_pose(const DeviceDescription& device, const Pose& T, const Wrench& wanted,
                const MotorVector& limit) {
  const bool is_pose = is_finite(T);
  if (!is_pose && check_workspace({}, T) != Fault::kWorkspace)
    fail("workspace: an invalid pose is accepted");
  for (int leg = 0; leg < kLegs; ++leg) {
    for (const LegAssembly& each : leg_assemblies(device, T, leg)) {
      if (!each.status) {
        expect_named(each.status, is_pose && each.status.failure != KinematicsFailure::kBadInput);
      } else if (!std::all_of(each.theta_rad.begin(), each.theta_rad.end(),
                              [](double a) { return std::isfinite(a); })) {
        fail("assembly: an angle that is not finite");
      }
    }
  }
  const InverseResult inverse = inverse_kinematics(device, T);
  if (!inverse.status) {
    return expect_named(inverse.status, inverse.status.failure != KinematicsFailure::kBadInput);
  }
  if (!is_pose) fail("inverse: an invalid pose is accepted");
  const Encoders encoders = encoder_angles(inverse.joints);
  if (!finite(encoders)) fail("inverse: an angle that is not finite");
  const ForwardResult forward = forward_kinematics(device, encoders);
  expect_pose(forward);
  if (!forward.status) fail("forward: refuses angles of inverse");
  if (!((forward.T_device_plate.p_m - T.p_m).norm() < 1e-9) ||
      !(forward.T_device_plate.q.angularDistance(T.q) < 1e-7))
    fail("forward of inverse is another pose");
  const JacobianResult compact = jacobian(device, T, inverse.joints);
  const JacobianResult paper = influence_jacobian(device, T, inverse.joints);
  if (!paper.status) {
    expect_named(paper.status, true);
  } else if (!paper.G.allFinite()) {
    fail("influence Jacobian: not finite");
  }
  if (!compact.status) return expect_named(compact.status, true);
  if (!compact.G.allFinite()) fail("Jacobian: not finite");
  const Singularity s = measure_singularity(device, T, inverse.joints, compact.G);
  if (!(s.inverse_condition >= 0 && s.inverse_condition <= 1) ||
      !(s.smallest_singular_value_per_m >= 0) || !std::isfinite(s.nearest_branch_m))
    fail("singularity: an invalid measure");
  // Both forms lose accuracy as a leg approaches a branch.
  if (paper.status && s.nearest_branch_m > 1e-6 &&
      !((paper.G - compact.G).norm() <= 1e-6 * compact.G.norm()))
    fail("the two Jacobians differ");
  check_allocation(compact.G, wanted, limit);
}

void check_encoders(const DeviceDescription& device, const Encoders& encoders) {
  const ForwardResult forward = forward_kinematics(device, encoders);
  expect_pose(forward);
  const KinematicsStatus limits = check_joint_limits(device, encoders);
  if (!limits) expect_named(limits, true);
  if (finite(encoders)) return;
  if (limits) fail("limits: accept angles that are not finite");
  for (int i = 0; i < kEncoders; ++i) {
    // theta4 is not part of this fit.
    if (i % 4 != 3 && !std::isfinite(encoders[static_cast<std::size_t>(i)]) && forward.status)
      fail("forward: accepts angles that are not finite");
  }
}

void check_motors(const MotorVector& current) {
  static const MotorModel model = make_motor_model(paper_device());
  MotorLoad load;
  for (int tick = 0; tick < kMaxSteps; ++tick) {
    load = advance(model, load, current, 0.05);
    const MotorVector available = available_current(model, load);
    if (!load.excess_A2s.allFinite() || !(load.excess_A2s.minCoeff() >= 0)) fail("motor: load");
    if (!(available.array() >= model.continuous_A.array()).all() ||
        !(available.array() <= model.peak_A.array()).all())
      fail("motor: available current");
  }
}

// A hand is refused, or all its numbers are valid.
void check_hand_numbers(const HandTrajectory& trajectory, const HandImpedance& impedance) {
  const auto device = SimulatedDevice::make(paper_device(), trajectory, impedance);
  if (!device) return fuzz::expect_refusal(device.error());
  bool known = !std::isnan(impedance.let_go_t_s);
  for (const HandKeyframe& k : trajectory.keyframes)
    known = known && std::isfinite(k.t_s) && is_finite(k.T_device_tool);
  for (const double x : {impedance.stiffness_N_per_m, impedance.damping_Ns_per_m,
                         impedance.rotational_stiffness_Nm_per_rad,
                         impedance.rotational_damping_Nms_per_rad, impedance.mass_kg})
    known = known && std::isfinite(x) && x >= 0;
  if (!known) fail("hand: invalid numbers are accepted");
}

void check_packets(double number) {
  if (!start_link()) fail("no link");
  static const LinkKey key = random_link_key();
  std::array<std::uint8_t, kMaxPacketBytes> bytes{};
  StatePacket state{1, 1, 0, DriveMode::kReady, 0, 0, {}};
  state.encoder_rad[5] = number;
  CommandPacket command{1, 1, 0, CommandMode::kTorque, 0, {}};
  command.tau_motor_Nm[3] = number;
  HelloPacket hello{1, {1}, number, true};
  const std::array<std::size_t, 3> sizes = {encode(state, key, bytes), encode(command, key, bytes),
                                            encode(hello, key, bytes)};
  if (!std::isfinite(number) && sizes != std::array<std::size_t, 3>{})
    fail("a packet with a number that is not finite");
}

// ---- the loop: in contact, then arbitrary readings, gaps and responses ----

struct CorruptedTick {
  int encoder = 0;
  double angle = 0, gap_s = 1e-3, stiffness = 5000, offset_m = 0, offset_y_m = 0;
  double device_t_s = 0;
  bool silent = false;
};

struct LoopLimits {
  SafetyLimits safety;
  MechanismLimits mechanism;
};

/// Values of `encoder` beyond the last encoder: `angle` goes to another input.
constexpr int kCorruptsTime = kEncoders, kCorruptsOffsetY = kEncoders + 1,
              kIsSilent = kEncoders + 2;

void check_loop(const std::vector<CorruptedTick>& ticks, const LoopLimits& limits) {
  static const Scene scene = test::descent_scene({0.15}, 0.16, 0.14, 0.015);
  static const auto sheets = place_slices(scene, test::square_asset(1), "fuzz");
  LoopModel model;
  model.tool = make_tool(scene.tool);
  model.limits = limits.safety;
  const Sheet* const current[] = {(*sheets)[0].get()};
  SheetLaw law = test::network_law(model);
  LoopState state;
  SetDevice device;
  FourLegs four_legs(paper_device(), device, limits.mechanism);
  TickResult result;
  int since = -1;
  for (int tick = 0; tick < kMaxLoopTicks; ++tick) {
    Pose T;  // 0.1 mm deeper per tick, then at rest
    T.p_m.z() = 0.15 + 1e-3 - 1e-4 * std::min(tick, 20) - model.tool.tip_plate_m.z();
    const InverseResult inverse = inverse_kinematics(paper_device(), T);
    device.now = {tick * 1e-3, encoder_angles(inverse.joints)};
    TickInputs inputs;
    inputs.sheets = current;
    inputs.gap_s = 1e-3;
    inputs.prefetched = {0, 5000, {}};
    const int corrupted = tick - 20;
    device.answer = DeviceStatus::kOk;
    if (corrupted >= 0 && static_cast<std::size_t>(corrupted) < ticks.size()) {
      const CorruptedTick& s = ticks[static_cast<std::size_t>(corrupted)];
      if (s.encoder < kEncoders) {
        device.now.encoder_rad[static_cast<std::size_t>(s.encoder)] = s.angle;
      }
      inputs.gap_s = s.gap_s;
      inputs.prefetched = {0, s.stiffness, {s.offset_m, s.offset_y_m}};
      device.now.t_s += s.device_t_s;
      if (s.silent) device.answer = DeviceStatus::kNoData;
    }
    haptic_tick(model, inputs, four_legs, law, state, result);
    for (const double tau : device.written.tau_motor_Nm) {
      if (!std::isfinite(tau)) fail("loop: a torque that is not finite");
      if (!(std::abs(tau) <= paper_device().motor_peak_torque_Nm)) fail("loop: beyond the peak");
    }
    if (result.row.safety == SafetyState::kFault) ++since;
    for (const double tau : device.written.tau_motor_Nm) {
      if (since > 5 && tau != 0) fail("loop: torques 6 ms after a fault");
    }
  }
}

// ---- descriptions ----

std::string shipped_text() {
  return test::text_of(TROCAR_FOUR_LEGS_JSON);
}

// Replaces number `which` of the shipped description by `text`. If that is accepted, the kinematics
// at the middle of the paper's workspace must succeed or name a failure.
void check_description(std::size_t which, const std::string& text) {
  static const nlohmann::json original = nlohmann::json::parse(shipped_text());
  static const std::vector<std::string> places = [] {
    std::vector<std::string> out;
    const nlohmann::json flat = original.flatten();
    for (const auto& [pointer, value] : flat.items()) {
      if (value.is_number()) out.push_back(pointer);
    }
    return out;
  }();
  nlohmann::json corrupted = original;
  corrupted[nlohmann::json::json_pointer(places[which % places.size()])] = "PLACE";
  std::string dumped = corrupted.dump();
  dumped.replace(dumped.find("\"PLACE\""), 7, text);
  const auto read = parse_device_description(dumped, "input.json");
  if (!read) return fuzz::expect_refusal(read.error());
  check_pose(*read, middle(), Wrench::Unit(2) * 10, MotorVector::Constant(6));
  const InverseResult inverse = inverse_kinematics(*read, middle());
  if (inverse.status) check_encoders(*read, encoder_angles(inverse.joints));
}

std::string written(double number) {
  if (std::isnan(number)) return "NaN";
  if (std::isinf(number)) return number > 0 ? "1e999" : "-1e999";
  std::array<char, 40> text{};
  std::snprintf(text.data(), text.size(), "%.17g", number);
  return text.data();
}

// An accepted scene has finite values in the fields that a session uses.
void check_scene(std::string_view text) {
  const auto scene = parse_scene(text, "input.json", "");
  if (!scene) return fuzz::expect_refusal(scene.error());
  bool known = std::isfinite(scene->duration_s) && scene->tool.sides >= 3;
  for (const TipKeyframe& k : scene->hand.trajectory) {
    known = known && std::isfinite(k.t_s);
    for (std::size_t i = 0; i < 3; ++i)
      known = known && std::isfinite(k.tip_m[i]) && std::isfinite(k.rotation_deg[i]);
  }
  for (const SceneSlice& slice : scene->slices)
    known = known && std::isfinite(slice.z_m);
  if (!known) fail("scene: a value that is not finite is accepted");
  const Tool tool = make_tool(scene->tool);
  for (int i = 0; i < tool.sides; ++i)
    if (!tool.corner_plate_m[static_cast<std::size_t>(i)].allFinite())
      fail("tool: a corner that is not finite");
}

// ---- decoding of the bytes ----

Pose pose_of(fuzz::Bytes& bytes) {
  Pose out;
  for (int i = 0; i < 3; ++i)
    out.p_m[i] = bytes.real();
  for (int i = 0; i < 4; ++i)
    out.q.coeffs()[i] = bytes.real();
  return out;
}

template <typename Vector>
Vector vector_of(fuzz::Bytes& bytes) {
  Vector out;
  for (int i = 0; i < out.size(); ++i)
    out[i] = bytes.real();
  return out;
}

LoopLimits limits_of(fuzz::Bytes& bytes) {
  LoopLimits l;
  const auto all = test::limits_by_name(l.safety, l.mechanism);
  for (int n = bytes.below(4); n > 0; --n) {
    const auto which = static_cast<std::size_t>(bytes.below(static_cast<int>(all.size())));
    *all[which].second = bytes.real();
  }
  return l;
}

void check_bytes(fuzz::Bytes bytes) {
  switch (bytes.below(8)) {
    case 0: {
      const Pose T = pose_of(bytes);
      const auto wanted = vector_of<Wrench>(bytes);
      return check_pose(paper_device(), T, wanted, vector_of<MotorVector>(bytes));
    }
    case 1: {
      // A rotation vector makes more of the poses valid than a quaternion would.
      Pose T;
      T.p_m = vector_of<Eigen::Vector3d>(bytes);
      T.q = from_rotation_vector(vector_of<Eigen::Vector3d>(bytes));
      const auto wanted = vector_of<Wrench>(bytes);
      return check_pose(paper_device(), T, wanted, vector_of<MotorVector>(bytes));
    }
    case 2: {
      Encoders encoders{};
      for (double& angle : encoders)
        angle = bytes.real();
      return check_encoders(paper_device(), encoders);
    }
    case 3:
      return check_motors(vector_of<MotorVector>(bytes));
    case 4: {
      HandTrajectory trajectory;
      for (int n = bytes.below(4); n > 0; --n) {
        const double t_s = bytes.real();
        trajectory.keyframes.push_back({t_s, pose_of(bytes)});
      }
      HandImpedance hand;
      hand.stiffness_N_per_m = bytes.real();
      hand.damping_Ns_per_m = bytes.real();
      hand.rotational_stiffness_Nm_per_rad = bytes.real();
      hand.rotational_damping_Nms_per_rad = bytes.real();
      hand.mass_kg = bytes.real();
      hand.let_go_t_s = bytes.real();
      return check_hand_numbers(trajectory, hand);
    }
    case 5: {
      const std::size_t which = bytes.next();
      return check_description(which, written(bytes.real()));
    }
    case 6: {
      const double number = bytes.real();
      check_packets(number);
      return check_allocation(Jacobian::Constant(number), Wrench::Ones(), MotorVector::Ones());
    }
    default: {
      const LoopLimits limits = limits_of(bytes);
      std::vector<CorruptedTick> ticks;
      while (!bytes.empty() && ticks.size() < kMaxSteps) {
        CorruptedTick tick;
        tick.encoder = bytes.below(2 * kEncoders);  // half of them are not an encoder
        tick.angle = bytes.real();
        tick.gap_s = bytes.real();
        tick.stiffness = bytes.real();
        tick.offset_m = bytes.real();
        tick.offset_y_m = tick.encoder == kCorruptsOffsetY ? tick.angle : -tick.offset_m;
        tick.device_t_s = tick.encoder == kCorruptsTime ? tick.angle : 0;
        tick.silent = tick.encoder == kIsSilent;
        ticks.push_back(tick);
      }
      return check_loop(ticks, limits);
    }
  }
}

// ---- a stress case: its numbers as input of every check ----

void check_case(const nlohmann::json& json) {
  JsonErrors errors{"input.json", {}};
  test::DeviceFields asked(json, "", errors);
  const std::string ask = asked.text("ask", "");
  const Pose T =
      asked.has("pose") ? test::read_pose(paper_device(), asked.object("pose"), errors) : middle();
  const auto wrench = asked.numbers("wrench", 6, 0), limit = asked.numbers("limit_Nm", 8, 6);
  const Wrench wanted = Eigen::Map<const Wrench>(wrench.data());
  const MotorVector limits = Eigen::Map<const MotorVector>(limit.data());
  check_pose(paper_device(), T, wanted, limits);
  for (const char* key : {"each_field", "add", "set"}) {
    if (!asked.has(key)) continue;
    const double number = asked.number(key, 0);
    check_packets(number);
    check_motors(MotorVector::Constant(number));
    for (int i = 0; i < 7; ++i) {
      Pose corrupted = T;
      (i < 3 ? corrupted.p_m[i] : corrupted.q.coeffs()[i - 3]) = number;
      check_pose(paper_device(), corrupted, wanted, limits);
      check_hand_numbers({{{0, corrupted}}}, {});
    }
    const InverseResult inverse = inverse_kinematics(paper_device(), T);
    for (std::size_t i = 0; inverse.status && i < kEncoders; ++i) {
      Encoders encoders = encoder_angles(inverse.joints);
      encoders[i] = std::string(key) == "add" ? encoders[i] + number : number;
      check_encoders(paper_device(), encoders);
      check_loop({CorruptedTick{static_cast<int>(i), encoders[i]}}, {});
    }
  }
  if (asked.has("each_number")) {
    const std::string text = asked.text("each_number", "");
    for (std::size_t i = 0; i < 64; ++i)
      check_description(i, text);
  }
  if (ask != "loop") return;
  CorruptedTick tick{kEncoders};
  tick.gap_s = asked.number("gap_s", 1e-3);
  tick.stiffness = asked.number("response_stiffness_N_per_m", 5000);
  tick.offset_m = asked.number("response_offset_m", 0);
  tick.offset_y_m = asked.number("response_offset_y_m", 0);
  tick.device_t_s = asked.number("device_t_s", 0);
  tick.silent = asked.number("silent_ticks", 0) > 0;
  LoopLimits set;
  test::DeviceFields named(asked.object("limits"), "/limits", errors);
  for (const auto& [name, value] : test::limits_by_name(set.safety, set.mechanism))
    *value = named.number(name, *value);
  check_loop({tick, tick, tick}, set);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  if (data[0] != '{') {
    check_bytes({data, size});
    return 0;
  }
  const auto json = parse_strict_json({reinterpret_cast<const char*>(data), size}, "input.json");
  if (!json || !json->is_object()) return 0;
  if (json->contains("schema")) {
    check_scene({reinterpret_cast<const char*>(data), size});
  } else {
    check_case(*json);
  }
  return 0;
}
