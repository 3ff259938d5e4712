// SPDX-License-Identifier: Apache-2.0
// The stress cases of the device, tests/corpus/device: each gives one input of the kind `ask` and
// its correct result. In all cases results are finite and torques are within their limits.
// Long because each kind `ask` has its check here, and all share one device.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "formats/session/device_protocol.h"
#include "formats/session/scene.h"
#include "runtime/device/four_legs/four_legs.h"
#include "runtime/device/four_legs/mechanism_limits.h"
#include "runtime/device/simulated/hand.h"
#include "runtime/device/simulated/simulated_device.h"
#include "runtime/haptics/loop/haptic_loop.h"
#include "tests/cases/device_case.h"
#include "tests/cases/limits_by_name.h"
#include "tests/cases/set_device.h"
#include "tests/reference/decompositions/decompositions.h"
#include "tests/reference/mechanism/influence_jacobian.h"
#include "tests/reference/mechanism/leg_assemblies.h"
#include "tests/support/sheet_fixture.h"
#include "tests/support/sheet_law_fixture.h"

namespace trocar::runtime {
namespace {

using test::DeviceFields;
using test::SetDevice;

class DeviceStress : public testing::TestWithParam<std::filesystem::path> {
 public:
  void SetUp() override {
    auto json = parse_strict_json(test::text_of(GetParam()), GetParam().filename());
    ASSERT_TRUE(json) << json.error().message;
    json_ = *json;
    errors_.file = GetParam().filename();
  }

  // ---- one pose: inverse, assemblies, Jacobians, singularity, forward, allocation ----

  void ask_pose(DeviceFields& asked, DeviceFields& right) {
    const Pose T = test::read_pose(device_, asked.object("pose"), errors_);
    const std::string bad_field = asked.text("each_field", "");
    if (!bad_field.empty()) return each_pose_field(T, *test::number_or_name(bad_field), right);
    expect_pose(T, right);
  }

  void expect_pose(const Pose& T, DeviceFields& right) {
    const InverseResult inverse = inverse_kinematics(device_, T);
    EXPECT_EQ(to_string(inverse.status.failure), right.text("inverse", "none"));
    EXPECT_EQ(inverse.status.leg, right.number("leg", 0));
    EXPECT_EQ(inverse.status.joint, right.number("joint", 0));
    int assemblies = 0;
    for (int leg = 0; leg < kLegs; ++leg) {
      for (const LegAssembly& each : leg_assemblies(device_, T, leg)) {
        if (!each.status) continue;
        ++assemblies;
        for (const double angle : each.theta_rad)
          EXPECT_TRUE(std::isfinite(angle));
      }
    }
    EXPECT_EQ(assemblies, right.number("assemblies", assemblies));
    const std::string expected_jacobian = right.text("jacobian", "none");
    const double condition_min = right.number("inverse_condition_min", 0),
                 condition_max = right.number("inverse_condition_max", 1),
                 branch_min_m = right.number("branch_min_m", -1),
                 branch_max_m = right.number("branch_max_m", 1);
    if (!inverse.status) return;

    const ForwardResult forward = forward_kinematics(device_, encoder_angles(inverse.joints));
    EXPECT_TRUE(forward.status);
    EXPECT_LT((forward.T_device_plate.p_m - T.p_m).norm(), 1e-10);
    EXPECT_LT(forward.T_device_plate.q.angularDistance(T.q), 1e-9);

    const JacobianResult compact = jacobian(device_, T, inverse.joints);
    EXPECT_EQ(to_string(compact.status.failure), expected_jacobian);
    ASSERT_TRUE(compact.G.allFinite());
    // The distance to a branch needs no Jacobian.
    const Singularity measured = measure_singularity(device_, T, inverse.joints, compact.G);
    EXPECT_GE(measured.nearest_branch_m, branch_min_m);
    EXPECT_LE(measured.nearest_branch_m, branch_max_m);
    if (!compact.status) {
      EXPECT_GE(compact.status.leg, 1);
      return;
    }
    EXPECT_GE(measured.inverse_condition, condition_min);
    EXPECT_LE(measured.inverse_condition, condition_max);
    const JacobianResult paper = influence_jacobian(device_, T, inverse.joints);
    if (paper.status) {
      EXPECT_LT((paper.G - compact.G).norm(), 1e-6 * compact.G.norm());
    }
    for (int axis = 0; axis < 6; ++axis) {
      for (const double size : {1e-3, 35.0, 1e4})
        expect_allocation(compact.G, size * Wrench::Unit(axis), MotorVector::Constant(6));
    }
  }

  void each_pose_field(const Pose& T, double bad, DeviceFields& right) {
    const std::string expected = right.text("inverse", "bad input");
    for (int i = 0; i < 7; ++i) {
      Pose corrupted = T;
      (i < 3 ? corrupted.p_m[i] : corrupted.q.coeffs()[i - 3]) = bad;
      EXPECT_EQ(to_string(inverse_kinematics(device_, corrupted).status.failure), expected) << i;
      for (const LegAssembly& each : leg_assemblies(device_, corrupted, 0))
        EXPECT_EQ(to_string(each.status.failure), expected) << i;
      EXPECT_EQ(check_workspace({}, corrupted), Fault::kWorkspace) << i;
      SpeedState state;
      check_speed({}, T, 1e-3, state);
      EXPECT_EQ(check_speed({}, corrupted, 1e-3, state), Fault::kSpeed) << i;
    }
  }

  // ---- encoders and motors: forward ----

  void ask_encoders(DeviceFields& asked, DeviceFields& right) {
    const Pose T = test::read_pose(device_, asked.object("pose"), errors_);
    const InverseResult inverse = inverse_kinematics(device_, T);
    ASSERT_TRUE(inverse.status);
    const bool add = asked.has("add");
    const double change = add ? asked.number("add", 0) : asked.number("set", 0);
    const auto at = static_cast<int>(asked.number("encoder", -1));  // -1: each in turn
    const std::string expected_forward = right.text("forward", "none"),
                      expected_limits = right.text("limits", "none");
    const double moved_max_m = right.number("moved_max_m", 1e-10);
    for (int i = at < 0 ? 0 : at; i < (at < 0 ? kEncoders : at + 1); ++i) {
      SCOPED_TRACE("encoder " + std::to_string(i));
      auto encoders = encoder_angles(inverse.joints);
      encoders[static_cast<std::size_t>(i)] =
          add ? encoders[static_cast<std::size_t>(i)] + change : change;
      const ForwardResult forward = forward_kinematics(device_, encoders);
      if (i % 4 == 3) {  // theta4 is not part of this fit
        EXPECT_TRUE(forward.status);
      } else {
        EXPECT_EQ(to_string(forward.status.failure), expected_forward);
      }
      if (forward.status) {
        EXPECT_LE((forward.T_device_plate.p_m - T.p_m).norm(), moved_max_m);
        EXPECT_TRUE(is_finite(forward.T_device_plate));
      }
      EXPECT_EQ(to_string(check_joint_limits(device_, encoders).failure), expected_limits);
    }
  }

  // ---- allocation ----

  // Laws 1 and 2 of torque_allocation.h; all results are finite.
  static void expect_allocation(const Jacobian& G, const Wrench& wanted, const MotorVector& limit) {
    const AllocationResult result = allocate_torques(G, wanted, limit);
    ASSERT_TRUE(result.tau_motor_Nm.allFinite());
    ASSERT_TRUE(result.wrench_device.allFinite());
    if (result.kind == AllocationKind::kRefused) {
      EXPECT_EQ(result.tau_motor_Nm, MotorVector::Zero());
      return;
    }
    EXPECT_TRUE((result.tau_motor_Nm.cwiseAbs().array() <= limit.array()).all());
    EXPECT_GE(result.scale, 0);
    EXPECT_LE(result.scale, 1);
    if (result.kind == AllocationKind::kMinimumNorm && wanted.norm() > 1e-150) {
      // The pseudo-inverse by another decomposition; rotation scaled to metres, as for its rank.
      Jacobian in_metres = G;
      in_metres.rightCols<3>() /= kCharacteristicLength_m;
      Wrench wanted_in_metres = wanted;
      wanted_in_metres.tail<3>() /= kCharacteristicLength_m;
      const MotorVector tau = reference::shortest_solution(in_metres.transpose(), wanted_in_metres);
      const Eigen::VectorXd values = reference::singular_values(in_metres);
      const double condition = values[0] / values[5];
      EXPECT_LE((tau - result.tau_motor_Nm).norm(), 1e-13 * condition * tau.norm());
    }
    const Wrench given = G.transpose() * result.tau_motor_Nm;
    const double size = G.norm() * std::max(result.tau_motor_Nm.norm(), 1e-300);
    EXPECT_LE((given - result.scale * wanted).norm(), 1e-9 * size);
  }

  void ask_allocation(DeviceFields& asked, DeviceFields& right) {
    const Pose T = test::read_pose(device_, asked.object("pose"), errors_);
    const InverseResult inverse = inverse_kinematics(device_, T);
    ASSERT_TRUE(inverse.status);
    const Jacobian G = jacobian(device_, T, inverse.joints).G;
    const auto wrench = asked.numbers("wrench", 6, 0), limits = asked.numbers("limit_Nm", 8, 6);
    const Wrench wanted = Eigen::Map<const Wrench>(wrench.data());
    const MotorVector limit = Eigen::Map<const MotorVector>(limits.data());
    static const char* const kKinds[] = {"minimum norm", "null space", "scaled", "refused"};
    const std::string expected = right.text("kind", "minimum norm");
    const auto expect_kind = [&](const Jacobian& J, const Wrench& w, const MotorVector& l) {
      EXPECT_EQ(kKinds[static_cast<int>(allocate_torques(J, w, l).kind)], expected);
      expect_allocation(J, w, l);
    };
    if (!asked.has("each_field")) {
      expect_kind(G, wanted, limit);
      const double is = allocate_torques(G, wanted, limit).tau_motor_Nm.cwiseAbs().maxCoeff();
      EXPECT_LE(is, right.number("largest_torque_max_Nm", 1e300));
      EXPECT_GE(is, right.number("largest_torque_min_Nm", 0));
      return;
    }
    const double bad = asked.number("each_field", 0);
    for (int i = 0; i < 6 + kMotors + 6 * kMotors; ++i) {
      SCOPED_TRACE("field " + std::to_string(i));
      Jacobian corrupted_G = G;
      Wrench corrupted_wrench = wanted;
      MotorVector corrupted_limit = limit;
      (i < 6             ? corrupted_wrench[i]
       : i < 6 + kMotors ? corrupted_limit[i - 6]
                         : corrupted_G(i % kMotors, (i - 6 - kMotors) / kMotors)) = bad;
      expect_kind(corrupted_G, corrupted_wrench, corrupted_limit);
    }
  }

  // ---- motors ----

  void ask_motor(DeviceFields& asked, DeviceFields& /*right*/) {
    const double bad = asked.number("each_field", 0);
    const MotorModel model = make_motor_model(device_);
    for (int i = 0; i < kMotors; ++i) {
      MotorVector current = MotorVector::Ones();
      current[i] = bad;
      MotorLoad load;
      for (int tick = 0; tick < 5000; ++tick) {
        load = advance(model, load, current, 1e-3);
        ASSERT_TRUE(load.excess_A2s.allFinite());
        const MotorVector available = available_current(model, load);
        ASSERT_TRUE((available.array() >= model.continuous_A.array()).all());
        ASSERT_TRUE((available.array() <= model.peak_A.array()).all());
      }
      // An unknown current counts as the peak: in the end only the continuous one is allowed.
      EXPECT_NEAR(available_current(model, load)[i], model.continuous_A[i], 1e-12);
    }
  }

  // ---- the hand ----

  void ask_hand(DeviceFields& asked, DeviceFields& right) {
    const Pose T = test::read_pose(device_, asked.object("pose"), errors_);
    const double bad = asked.number("each_field", 0);
    const std::string because = right.text("because", "");
    const HandTrajectory still{{{0, T}, {1, T}}};
    ASSERT_TRUE(check_hand(still, {}));
    constexpr int kPoseFields = 8, kImpedanceFields = 6;
    for (int i = 0; i < 2 * kPoseFields + kImpedanceFields; ++i) {
      SCOPED_TRACE("field " + std::to_string(i));
      HandTrajectory hand = still;
      HandImpedance grip;
      double* const parts[] = {&grip.stiffness_N_per_m,
                               &grip.damping_Ns_per_m,
                               &grip.rotational_stiffness_Nm_per_rad,
                               &grip.rotational_damping_Nms_per_rad,
                               &grip.mass_kg,
                               &grip.let_go_t_s};
      HandKeyframe& k = hand.keyframes[i / kPoseFields % 2];
      const int field = i % kPoseFields;
      (i >= 2 * kPoseFields ? *parts[i - 2 * kPoseFields]
       : field == 0         ? k.t_s
       : field <= 3         ? k.T_device_tool.p_m[field - 1]
                            : k.T_device_tool.q.coeffs()[field - 4]) = bad;
      const auto checked = check_hand(hand, grip);
      const auto device = SimulatedDevice::make(device_, hand, grip);
      // The hand may be released at any time or never.
      const bool lets_go = parts[5] == parts[std::max(0, i - 2 * kPoseFields)] && !std::isnan(bad);
      EXPECT_EQ(static_cast<bool>(checked), lets_go);
      EXPECT_EQ(static_cast<bool>(device), lets_go);
      if (checked) continue;
      EXPECT_EQ(checked.error().code, ExitCode::kRefused);
      EXPECT_NE(checked.error().message.find("hand: "), std::string::npos);
      EXPECT_NE(checked.error().message.find(because), std::string::npos)
          << checked.error().message;
    }
  }

  // ---- scene, description and packets ----

  /// Replaces each number of `original` in turn by `text`; each result must be refused.
  template <typename Parse>
  static void each_number_refused(const nlohmann::json& original, const std::string& text,
                                  const std::string& because, int least, Parse parse) {
    const nlohmann::json flat = original.flatten();
    int numbers = 0;
    for (const auto& [pointer, value] : flat.items()) {
      if (!value.is_number()) continue;
      ++numbers;
      nlohmann::json corrupted = original;
      corrupted[nlohmann::json::json_pointer(pointer)] = "PLACE";
      std::string dumped = corrupted.dump();
      dumped.replace(dumped.find("\"PLACE\""), 7, text);
      const auto read = parse(dumped);
      ASSERT_FALSE(read) << pointer << " = " << text << " was accepted";
      EXPECT_EQ(read.error().code, ExitCode::kRefused);
      EXPECT_EQ(read.error().message.rfind("case.json: ", 0), 0U) << read.error().message;
      EXPECT_NE(read.error().message.find(because.empty() ? pointer.substr(0, 6) : because),
                std::string::npos)
          << pointer << ": " << read.error().message;
    }
    EXPECT_GE(numbers, least);
  }

  void ask_scene(DeviceFields& asked, DeviceFields& right) {
    const std::string text = asked.text("each_number", "null"), because = right.text("because", "");
    const std::string source = test::text_of(TROCAR_CORPUS "/device/every_field_of_a.scene");
    ASSERT_TRUE(parse_scene(source, "every_field_of_a.scene", ""));
    each_number_refused(
        *parse_strict_json(source, "every_field_of_a.scene"), text, because, 35,
        [](const std::string& dumped) { return parse_scene(dumped, "case.json", ""); });
  }

  void ask_description(DeviceFields& asked, DeviceFields& right) {
    const std::string text = asked.text("each_number", "null"), because = right.text("because", "");
    const std::string source = test::text_of(TROCAR_FOUR_LEGS_JSON);
    auto original = parse_strict_json(source, "four_legs.json");
    ASSERT_TRUE(original);
    each_number_refused(*original, text, because, 30, [](const std::string& dumped) {
      return parse_device_description(dumped, "case.json");
    });
  }

  void ask_packet(DeviceFields& asked, DeviceFields& right) {
    ASSERT_TRUE(start_link());
    const double bad = asked.number("each_field", 0);
    const bool accepted = right.text("packet", "refused") == "taken";
    const LinkKey key = random_link_key();
    std::array<std::uint8_t, kMaxPacketBytes> bytes{};
    for (std::size_t i = 0; i < kLinkEncoders; ++i) {
      StatePacket packet{1, 1, 0, DriveMode::kReady, 0, 0, {}};
      packet.encoder_rad[i] = bad;
      EXPECT_EQ(encode(packet, key, bytes) > 0, accepted) << "encoder " << i;
    }
    for (std::size_t i = 0; i < kLinkMotors; ++i) {
      CommandPacket packet{1, 1, 0, CommandMode::kTorque, 0, {}};
      packet.tau_motor_Nm[i] = bad;
      EXPECT_EQ(encode(packet, key, bytes) > 0, accepted) << "motor " << i;
    }
    const HelloPacket hello{1, {1}, bad, true};
    EXPECT_EQ(encode(hello, key, bytes) > 0, right.text("period", "refused") == "taken");
  }

  // ---- the loop: the tool goes down into a sheet, then a fault is injected ----

  LoopModel loop_model(DeviceFields& asked) {
    LoopModel model;
    model.tool = make_tool(test::descent_scene({kSheet_m}, 0.16, 0.14, 0.015).tool);
    model.limits.gap_max_s = 0.1;
    uses_network_ = asked.text("law", "hooke") == "network";
    DeviceFields set(asked.object("limits"), "/limits", errors_);
    for (const auto& [name, value] : test::limits_by_name(model.limits, mechanism_))
      *value = set.number(name, *value);
    set.finish();
    return model;
  }

  /// The expected result.
  struct LoopEnd {
    std::string fault;
    double force_min_N = 0, force_max_N = 1e300;  ///< contact force in the last tick
    int zero_after_ticks = 5;                     ///< after the fault
    // Recovery: ticks from the request to `running`, from there to full torques (-1: never), and
    // the final force, of 5 N wanted.
    int quiet_ticks = 250, rise_ticks = 250;
    double felt_N = 5;
    double torque_max_Nm = 1e300;  ///< bound for every motor and tick
  };

  struct Corruption {
    int encoder = -1;  ///< whose angle is changed; -1: none
    bool add = false, first = false;
    double by = 0;
    double gap_s = 1e-3, stiffness = 5000, offset_m = 0, offset_y_m = 0;
    double device_t_s = 0;
    bool recover = false;  ///< pressed for one tick; then the tool is lifted and lowered again
    int silent_ticks = 0;  ///< ticks without data from the device
    double motor_heat =
        -1;  ///< if not negative: i2t state of every motor, as a fraction of its limit
  };

  bool uses_network_ = false;
  MechanismLimits mechanism_;
  static constexpr int kWrong = 150, kAsked = 170, kLoweredAgain = 900;

  // Down by 0.02 mm per tick from 1 mm above the sheet to 1 mm deep.
  static double tip_at(int tick, const Corruption& corrupted) {
    const bool lifted = corrupted.recover && tick > kWrong;
    const int down = lifted ? std::max(0, tick - kLoweredAgain) : tick;
    return kSheet_m + 1e-3 - 2e-5 * std::min(down, 100);
  }

  static MotorLoad load_of(const MotorModel& motor, double share) {
    return {share * motor.peak_time_s *
            (motor.peak_A.cwiseAbs2() - motor.continuous_A.cwiseAbs2())};
  }

  // Finds the first fault, and checks what holds in every tick.
  void run_loop(const LoopModel& model, const Corruption& corrupted, const LoopEnd& right) {
    Scene scene = test::descent_scene({kSheet_m}, 0.16, 0.14, 0.015);
    scene.tissue = Tissue{5000, 1e6, 0, {}, {}};
    const auto sheets = place_slices(scene, test::square_asset(1), "case");
    ASSERT_TRUE(sheets) << sheets.error().message;
    const Sheet* const current[] = {(*sheets)[0].get()};
    SheetLaw law = uses_network_ ? test::network_law(model) : test::hooke_law(model);
    LoopState state;
    SetDevice device;
    FourLegs four_legs(device_, device, mechanism_);
    TickResult result;
    Fault found = Fault::kNone;
    int since = -1;
    double pressed_N = 0;
    int running_tick = -1, whole_tick = -1;  // after a recovery
    for (int tick = 0; tick < (corrupted.recover ? kLoweredAgain + 200 : 200); ++tick) {
      Pose T;
      T.p_m.z() = tip_at(tick, corrupted) - model.tool.tip_plate_m.z();
      const InverseResult inverse = inverse_kinematics(device_, T);
      ASSERT_TRUE(inverse.status);
      device.now = {tick * 1e-3, encoder_angles(inverse.joints)};
      const bool wrong = corrupted.first || (corrupted.recover ? tick == kWrong : tick >= kWrong);
      if (wrong) device.now.t_s += corrupted.device_t_s;
      const bool silent = tick >= kWrong && tick < kWrong + corrupted.silent_ticks;
      device.answer = silent ? DeviceStatus::kNoData : DeviceStatus::kOk;
      if (tick == kWrong && corrupted.motor_heat >= 0) {
        four_legs.motors().load = load_of(make_motor_model(device_), corrupted.motor_heat);
      }
      if (wrong && corrupted.encoder >= 0) {
        double& angle = device.now.encoder_rad[static_cast<std::size_t>(corrupted.encoder)];
        angle = corrupted.add ? angle + corrupted.by : corrupted.by;
      }
      TickInputs inputs;
      inputs.sheets = current;
      inputs.gap_s = wrong ? corrupted.gap_s : 1e-3;
      if (uses_network_) {
        inputs.prefetched = {0, 5000, {}};
        if (wrong)
          inputs.prefetched = {0, corrupted.stiffness, {corrupted.offset_m, corrupted.offset_y_m}};
      }
      if (corrupted.recover && tick == kAsked) inputs.recover = RecoveryRequest::kByOperator;
      haptic_tick(model, inputs, four_legs, law, state, result);
      for (const double tau : device.written.tau_motor_Nm) {
        ASSERT_TRUE(std::isfinite(tau)) << "tick " << tick;
        ASSERT_LE(std::abs(tau), device_.motor_peak_torque_Nm) << "tick " << tick;
        ASSERT_LE(std::abs(tau), right.torque_max_Nm) << "tick " << tick;
      }
      pressed_N = std::max(pressed_N, result.contact.force_N);
      if (found == Fault::kNone) found = result.new_fault;
      const bool recovers = corrupted.recover && tick >= kAsked;
      if (recovers && result.row.safety == SafetyState::kRunning) {
        if (running_tick < 0) running_tick = tick;
        if (whole_tick < 0 && state.safety.authority >= 1) whole_tick = tick;
      }
      if (!recovers && found != Fault::kNone && ++since >= right.zero_after_ticks) {
        EXPECT_EQ(result.row.safety, SafetyState::kFault);
        for (const double tau : device.written.tau_motor_Nm)
          EXPECT_EQ(tau, 0) << since << " ms after the fault";
      }
    }
    EXPECT_EQ(std::string(to_string(found)), right.fault);
    if (!corrupted.first && right.fault == "none") {
      EXPECT_NEAR(pressed_N, 5, 0.1);
    }
    EXPECT_GE(result.contact.force_N, right.force_min_N);
    EXPECT_LE(result.contact.force_N, right.force_max_N);
    if (!corrupted.recover) return;
    EXPECT_EQ(running_tick < 0 ? -1 : running_tick - kAsked, right.quiet_ticks);
    EXPECT_EQ(whole_tick < 0 ? -1 : whole_tick - running_tick, right.rise_ticks);
    EXPECT_NEAR(result.row.wrench_delivered[2], right.felt_N, 0.02 * right.felt_N);
  }

  void ask_loop(DeviceFields& asked, DeviceFields& right) {
    const LoopModel model = loop_model(asked);
    const LoopEnd expected{right.text("fault", "none"),
                           right.number("force_min_N", 0),
                           right.number("force_max_N", 1e300),
                           static_cast<int>(right.number("zero_after_ticks", 5)),
                           static_cast<int>(right.number("quiet_ticks", 250)),
                           static_cast<int>(right.number("rise_ticks", 250)),
                           right.number("felt_N", 5),
                           right.number("torque_max_Nm", 1e300)};
    Corruption corrupted;
    corrupted.gap_s = asked.number("gap_s", 1e-3);
    corrupted.stiffness = asked.number("response_stiffness_N_per_m", 5000);
    corrupted.offset_m = asked.number("response_offset_m", 0);
    corrupted.offset_y_m = asked.number("response_offset_y_m", 0);
    corrupted.device_t_s = asked.number("device_t_s", 0);
    corrupted.recover = asked.text("then", "") == "recover";
    corrupted.silent_ticks = static_cast<int>(asked.number("silent_ticks", 0));
    corrupted.motor_heat = asked.number("motor_heat", -1);
    corrupted.add = asked.has("add");
    corrupted.by = corrupted.add ? asked.number("add", 0) : asked.number("set", 0);
    corrupted.first = asked.text("from", "contact") == "the start";
    if (!asked.has("add") && !asked.has("set")) return run_loop(model, corrupted, expected);
    const auto only = static_cast<int>(asked.number("encoder", -1));
    for (int i = 0; i < kEncoders; ++i) {
      if (only >= 0 && i % 4 != only) continue;
      SCOPED_TRACE("encoder " + std::to_string(i));
      corrupted.encoder = i;
      run_loop(model, corrupted, expected);
    }
  }

  static constexpr double kSheet_m = 0.15;
  DeviceDescription device_ = default_device_description();
  nlohmann::json json_;
  JsonErrors errors_;
};

TEST_P(DeviceStress, IsRight) {
  DeviceFields file(json_, "", errors_);
  const std::string statement = file.text("right", ""), ask = file.text("ask", "");
  ASSERT_FALSE(statement.empty()) << GetParam() << " does not state the correct result";
  SCOPED_TRACE(GetParam().filename().string() + ": correct is: " + statement);
  DeviceFields right(file.object("expect"), "/expect", errors_);
  using Ask = void (DeviceStress::*)(DeviceFields&, DeviceFields&);
  static const std::map<std::string, Ask> kAsks = {{"pose", &DeviceStress::ask_pose},
                                                   {"encoders", &DeviceStress::ask_encoders},
                                                   {"allocation", &DeviceStress::ask_allocation},
                                                   {"motor", &DeviceStress::ask_motor},
                                                   {"hand", &DeviceStress::ask_hand},
                                                   {"scene", &DeviceStress::ask_scene},
                                                   {"description", &DeviceStress::ask_description},
                                                   {"packet", &DeviceStress::ask_packet},
                                                   {"loop", &DeviceStress::ask_loop}};
  ASSERT_TRUE(kAsks.contains(ask)) << "unknown: ask = " << ask;
  (this->*kAsks.at(ask))(file, right);
  if (HasFatalFailure()) return;
  file.finish();
  right.finish();
  EXPECT_FALSE(errors_.first) << errors_.first->message;
}

INSTANTIATE_TEST_SUITE_P(Device, DeviceStress,
                         testing::ValuesIn(test::case_files(TROCAR_CORPUS "/device")),
                         [](const auto& at) { return test::test_name(at.param); });

}  // namespace
}  // namespace trocar::runtime
