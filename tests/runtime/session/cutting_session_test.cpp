// SPDX-License-Identifier: Apache-2.0
// The force law `cutting` in whole sessions in virtual time: the paper's shell of no thickness at
// every rate, the force scale, replays, faults under load, the energy account.
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <functional>
#include <utility>

#include "formats/session/recording.h"
#include "runtime/device/four_legs/kinematics.h"
#include "runtime/haptics/bone/cutting_force_law.h"
#include "runtime/haptics/loop/break_through.h"
#include "runtime/realtime/realtime_thread.h"
#include "runtime/session/session.h"
#include "tests/runtime/session/test_session.h"
#include "tests/support/body_fixture.h"
#include "tests/support/counted_allocations.h"

namespace trocar::runtime {
namespace {

const CuttingReport& cutting_of(const SessionResult& report) {
  return dynamic_cast<const CuttingForceLaw&>(*report.law).report();
}

using test::body_scene, test::cutting_scene, test::spaced_asset, test::square_asset;
using testing_support::TestSession;

struct CuttingRun {
  SessionResult report;
  std::vector<RecordingRow> rows;
};

DeviceDescription description_with(double friction_Nms_per_rad) {
  DeviceDescription description = default_device_description();
  description.joint_viscous_friction_Nms_per_rad = friction_Nms_per_rad;
  description.motor_peak_time_s = 1e6;
  return description;
}

/// Between the device and the loop: what a device that fails does.
using StatusOfTick = std::function<DeviceStatus(std::uint64_t tick)>;

class FailingDevice final : public Device {
 public:
  FailingDevice(SimulatedDevice& inner, StatusOfTick faults)
      : inner_(inner), faults_(std::move(faults)) {}
  DeviceStatus read(DeviceState& state) noexcept override {
    const DeviceStatus status = faults_ ? faults_(tick_++) : DeviceStatus::kOk;
    return status == DeviceStatus::kOk ? inner_.read(state) : status;
  }
  DeviceStatus write(const DeviceCommand& command) noexcept override {
    return inner_.write(command);
  }

 private:
  SimulatedDevice& inner_;
  StatusOfTick faults_;
  std::uint64_t tick_ = 0;
};

/// A session without the limits that fast motion would exceed.
struct CuttingSession : TestSession {
  CuttingSession(const Scene& of, Asset with, double rate_Hz = 1000,
                 const DeviceDescription& on = description_with(0.005))
      : TestSession(of, std::move(with)) {
    description = on;
    options.rate_Hz = rate_Hz;
    options.origin.entries = {{"force-law", to_string(of.force_law.kind)}};
    options.limits.speed_max_m_per_s = options.limits.rotation_rate_max_rad_per_s = 1e6;
    options.limits.energy_limit_J = 1e9;
    mechanism.encoder_rate_max_rad_per_s = 1e6;
    mechanism.torque_rise_time_max_s = 1e6;
    mechanism.torque_rise_max_Nm_per_s = 1e9;
  }
  CuttingRun run(const StatusOfTick& faults = {}) {
    simulate();
    FailingDevice failing(*device, faults);
    CuttingRun out;
    out.report = TestSession::run(failing, [&](double dt_s) { device->step(dt_s); });
    EXPECT_TRUE(faults || out.report.fault == Fault::kNone) << to_string(out.report.fault);
    out.rows = rows();
    return out;
  }
};

CuttingRun run(const Scene& scene, const Asset& asset, double rate_Hz = 1000) {
  return CuttingSession(scene, asset, rate_Hz).run();
}

/// A stiff hand that moves down at this speed from 2 mm above 0.12 m to `depth_m` below.
Scene descending(Scene scene, double speed_m_per_s, double depth_m) {
  const double way_m = 2e-3 + depth_m;
  scene.hand.stiffness_N_per_m = 50'000;
  scene.hand.damping_N_s_per_m = 300;
  scene.hand.rotation_stiffness_Nm_per_rad = 50;
  scene.hand.rotation_damping_Nm_s_per_rad = 0.5;
  scene.hand.trajectory = {{0, {0, 0, 0.122}, {}},
                           {0.05, {0, 0, 0.122}, {}},
                           {0.05 + way_m / speed_m_per_s, {0, 0, 0.12 - depth_m}, {}}};
  scene.duration_s = 0.1 + way_m / speed_m_per_s;
  return scene;
}

/// The paper's slice, the axis rigid.
Scene paper(double speed_m_per_s) {
  Scene scene = descending(cutting_scene({0.12}), speed_m_per_s, 0.012);
  scene.force_law.axis = ToolAxis::kRigid;
  return scene;
}

/// A hard slice over soft ones, all cut: a snap that passes several sheets in a tick.
Scene snapping() {
  Scene scene = descending(cutting_scene(test::stack(0.12, 1e-3, 10)), 0.05, 0.016);
  NamedTissue soft;
  soft.name = "soft";
  soft.tissue.threshold_N = 5;
  scene.tissues = {soft};
  for (std::size_t i = 1; i < 10; ++i)
    scene.slices[i].tissue = "soft";
  scene.force_law.axis = ToolAxis::kRigid;
  return scene;
}

/// Bone with friction and walls, in and out again and in beside, at an angle.
Scene procedure() {
  Scene scene = body_scene(0, 11, 0.12);
  scene.tissue.cut = CutTissue{0.4, std::nullopt, 100, 1, 0, 0, 8, 2, 0.6};
  scene.tissue.stiffness_N_per_m = 30'000;
  scene.body->shell_m = 1.5e-3;
  scene.body->shell_factor = 1.6;
  scene.hand.stiffness_N_per_m = 12'000;
  scene.hand.damping_N_s_per_m = 120;
  scene.hand.trajectory = {{0, {0, 0, 0.123}, {}},
                           {0.3, {0, 0, 0.111}, {}},
                           {0.5, {0.002, 0, 0.111}, {1, 3, 10}},
                           {0.7, {0, 0, 0.114}, {}},
                           {0.9, {0, 0, 0.124}, {}},
                           {1.0, {0.002, 0, 0.124}, {}},
                           {1.3, {0.002, 0.001, 0.112}, {}}};
  scene.duration_s = 1.35;
  return scene;
}

TEST(CuttingSession, ThePlateGetsTheScaledForceAndTheRecordingHoldsBoth) {
  for (const double scale : {0.25, 1.0, 2.0}) {
    Scene scene = paper(0.05);
    scene.tissue.threshold_N = 20;
    scene.force_law.force_scale = scale;
    const CuttingRun run_ = run(scene, square_asset(1));
    double max_N = 0, felt_N = 0;
    ASSERT_EQ(run_.report.punctures.size(), 1U);
    const double break_s = run_.report.punctures[0].t_s;
    for (const RecordingRow& row : run_.rows) {
      if (row.authority < 1) continue;
      for (std::size_t i = 0; i < 6; ++i) {
        const double added = row.wrench_wanted[i] - scale * row.cutting.wrench_tissue[i];
        if (i == 2 && row.t_s >= break_s && row.t_s < break_s + kBreakDamping_s)
          ASSERT_LT(std::abs(added - 0.1 * scale * 20), 0.1001 * scale * 20) << "of the damper";
        else
          ASSERT_NEAR(added, 0, 1e-9) << row.t_s;
      }
      max_N = std::max(max_N, row.cutting.wrench_tissue[2]);
      felt_N = std::max(felt_N, row.wrench_delivered[2]);
    }
    EXPECT_GT(max_N, 19) << "of the tissue";
    EXPECT_LE(max_N, 20);
    EXPECT_NEAR(felt_N, scale * max_N, 0.01 * scale * max_N) << "at the plate";
    EXPECT_EQ(cutting_of(run_.report).coupling.force_scale, scale);
    EXPECT_NEAR(run_.report.max_force_N, felt_N, 1e-9);
    EXPECT_NEAR(run_.report.punctures[0].tip_N, max_N, 0.01 * max_N) << "of the puncture too";
  }
}

bool same_row(const RecordingRow& a, const RecordingRow& b) {
  return a.tau_Nm == b.tau_Nm && a.encoder_rad == b.encoder_rad &&
         a.wrench_wanted == b.wrench_wanted && a.cutting.wrench_tissue == b.cutting.wrench_tissue &&
         a.cutting.front_z_m == b.cutting.front_z_m && a.cutting.cut_J == b.cutting.cut_J &&
         a.cutting.absorbed_J == b.cutting.absorbed_J && a.cutting.stored_J == b.cutting.stored_J &&
         a.tip_N == b.tip_N && a.cutting.steps == b.cutting.steps &&
         a.cuts_published == b.cuts_published && a.phase == b.phase;
}

TEST(CuttingSession, ASecondRunAndAReplayGiveTheSameBits) {
  struct Case {
    const char* name;
    Scene scene;
    Asset asset;
  };
  Case cases[] = {{"snap", snapping(), square_asset(10)},
                  {"procedure", procedure(), spaced_asset(12, 1)}};
  for (Case& one : cases) {
    CuttingSession session(one.scene, one.asset);
    const CuttingRun once = session.run(), twice = session.run();
    session.options.record.reset();
    ASSERT_EQ(once.rows.size(), twice.rows.size());
    for (std::size_t k = 0; k < once.rows.size(); ++k)
      ASSERT_TRUE(same_row(once.rows[k], twice.rows[k])) << one.name << " " << k;
    EXPECT_GE(once.report.punctures.size(), 8U) << one.name;
    EXPECT_EQ(once.report.allocations_in_loop.value_or(0), 0U) << one.name;
    const SessionResult replayed = session.replay(once.rows);
    EXPECT_EQ(replayed.replay_first_difference, -1) << one.name;
    EXPECT_EQ(replayed.ticks, once.rows.size());
    EXPECT_EQ(replayed.punctures.size(), once.report.punctures.size());
    EXPECT_EQ(cutting_of(replayed).energy.absorbed_J, cutting_of(once.report).energy.absorbed_J);
    // A replay of anything else is found out.
    std::vector<RecordingRow> forged = once.rows;
    const std::size_t at = forged.size() / 3;
    forged[at].tau_Nm[2] = std::nextafter(forged[at].tau_Nm[2], 1e9);
    EXPECT_EQ(session.replay(forged).replay_first_difference, static_cast<std::int64_t>(at));
  }
}

// 30 slices of equal bone: the far side is the only break-through, and a replay finds it again.
TEST(CuttingSession, EqualBoneBreaksOnlyAtItsFarSide) {
  Scene scene = descending(body_scene(0, 29, 0.12), 0.02, 0.032);
  scene.tissue.threshold_N = 24;
  CuttingSession session(scene, spaced_asset(30, 0.83));
  const CuttingRun run_ = session.run();
  EXPECT_EQ(run_.report.punctures.size(), 30U);
  ASSERT_EQ(run_.report.break_throughs.size(), 1U);
  const BreakThroughEvent& found = run_.report.break_throughs[0];
  EXPECT_EQ(found.at, 0) << "the lowest slice";
  EXPECT_NEAR(found.resistance_N, 24, 1);
  EXPECT_NEAR(found.t_s, run_.report.punctures.back().t_s, 0.02);
  const auto of_row = std::find_if(run_.rows.begin(), run_.rows.end(),
                                   [](const RecordingRow& row) { return row.break_through_N > 0; });
  ASSERT_NE(of_row, run_.rows.end());
  EXPECT_EQ(of_row->t_s, found.t_s);
  EXPECT_EQ(of_row->break_through_N, found.resistance_N);
  session.options.record.reset();
  const SessionResult replayed = session.replay(run_.rows);
  ASSERT_EQ(replayed.break_throughs.size(), 1U);
  EXPECT_EQ(replayed.break_throughs[0].t_s, found.t_s);
  EXPECT_EQ(replayed.break_throughs[0].resistance_N, found.resistance_N);
}

// Noise makes the coupling soft, which costs depth: the extension that `check` states.
TEST(CuttingSession, NoiseCostsTheDepthThatIsPredicted) {
  Scene scene = descending(body_scene(0, 29, 0.12), 0.02, 0.023);
  scene.tissue.threshold_N = 24;
  double exact_m = 0, exact_front_m = 0;
  for (const double noise_m : {0.0, 5e-6, 1e-5}) {
    DeviceDescription device = description_with(0.005);
    if (noise_m == 0) device.encoder_counts_per_revolution = 0;
    device.encoder_noise_rad = noise_m / device.geometry.l1_m;
    const CuttingRun run_ = CuttingSession(scene, spaced_asset(30, 0.83), 1000, device).run();
    const double extension_m = cutting_of(run_.report).coupling.extension_m(24),
                 front_m = run_.rows.back().cutting.front_z_m;
    if (noise_m == 0) {
      exact_m = extension_m;
      exact_front_m = front_m;
      continue;
    }
    const double predicted_m = extension_m - exact_m;
    EXPECT_GT(predicted_m, 4e-3) << "something to predict";
    EXPECT_NEAR(front_m - exact_front_m, predicted_m, 0.2 * predicted_m) << noise_m;
    EXPECT_LT(front_m, 0.119) << "it cuts";
  }
}

// The coupling holds the tool away from the plate by the tissue's force over its stiffness.
TEST(CuttingSession, TheToolIsRecordedWhereTheCouplingHoldsIt) {
  Scene scene = snapping();
  scene.force_law.axis = ToolAxis::kCoupled;
  scene.force_law.coupling_N_per_m = 8000;
  const CuttingRun run_ = run(scene, square_asset(10));
  const double free_m = run_.rows.front().tool_m[2] - run_.rows.front().p_m[2];
  // The law acts at the pose to which the lead has moved the plate, at 50 mm/s and faster after a snap.
  const double led_m = 3 * 0.05 * run_.report.law->estimator().translation.lead_s;
  double most_m = 0;
  for (const RecordingRow& row : run_.rows) {
    const double deflection_m = row.tool_m[2] - row.p_m[2] - free_m;
    ASSERT_NEAR(deflection_m, row.cutting.wrench_tissue[2] / 8000, 1e-7 + led_m) << row.t_s;
    most_m = std::max(most_m, deflection_m);
  }
  EXPECT_GT(most_m, 3e-3) << "35 N at 8 kN/m";
}

// In thick bone the coupling is loaded when the tip passes a slice.
TEST(CuttingSession, PuncturesHaveTheHeightOfTheRecordedTool) {
  Scene scene = procedure();
  scene.force_law.axis = ToolAxis::kCoupled;
  scene.force_law.coupling_N_per_m = 8000;
  const CuttingRun run_ = run(scene, spaced_asset(12, 1));
  ASSERT_FALSE(run_.report.punctures.empty());
  for (const PunctureEvent& puncture : run_.report.punctures)  // of summary and telemetry
    EXPECT_EQ(puncture.tool_z_m,
              run_.rows[static_cast<std::size_t>(std::lround(1e3 * puncture.t_s))].tool_m[2]);
}

// A tip that has just broken through meets nothing, and the hand that pressed has accelerated the
// plate. The damper after the break stops the plate if the hand lets go, but not the hand.
TEST(CuttingSession, LettingGoRightAfterABreakLeavesTheToolNearTheBone) {
  Scene held = descending(cutting_scene({0.12}), 0.02, 0.012);
  held.hand.stiffness_N_per_m = 8000;
  held.hand.damping_N_s_per_m = 140;
  const auto run_with = [&](const Scene& scene, bool damps) {
    CuttingSession session(scene, square_asset(1));
    session.options.guards = damps;
    return session.run();
  };
  const auto fastest_m_per_s = [](const CuttingRun& of) {
    double most = 0;
    for (std::size_t k = 1; k < of.rows.size(); ++k)
      most = std::max(most, 1e3 * (of.rows[k - 1].p_m[2] - of.rows[k].p_m[2]));
    return most;
  };
  const CuttingRun free = run_with(held, false), damped = run_with(held, true);
  ASSERT_EQ(damped.report.punctures.size(), 1U);
  const double break_s = damped.report.punctures.front().t_s;
  EXPECT_GT(fastest_m_per_s(damped), 0.85 * fastest_m_per_s(free)) << "the hand holds on";
  double free_m = 0, damped_m = 0;
  for (const double after_s : {1e-3, 3e-3, 6e-3, 9e-3, 15e-3}) {
    Scene let_go = held;
    let_go.hand.let_go_t_s = break_s + after_s;
    const auto coasted_m = [&](const CuttingRun& of) {
      const auto at = static_cast<std::size_t>(std::lround((break_s + after_s) * 1e3));
      return of.rows[at].p_m[2] - of.rows.back().p_m[2];
    };
    free_m = std::max(free_m, coasted_m(run_with(let_go, false)));
    damped_m = std::max(damped_m, coasted_m(run_with(let_go, true)));
  }
  EXPECT_LT(damped_m, 3e-3);
  EXPECT_GT(free_m, 2 * damped_m);
}

TEST(CuttingSession, AFaultUnderLoadIsLeftByLiftingOnly) {
  Scene scene = descending(cutting_scene({0.12}), 0.05, 4e-3);
  scene.force_law.axis = ToolAxis::kRigid;
  // Held under load, then lifted, and down again.
  scene.hand.trajectory.push_back({0.6, {0, 0, 0.116}, {}});
  scene.hand.trajectory.push_back({0.8, {0, 0, 0.122}, {}});
  scene.hand.trajectory.push_back({1.0, {0, 0, 0.122}, {}});
  scene.hand.trajectory.push_back({1.3, {0, 0, 0.117}, {}});
  scene.duration_s = 1.35;
  CuttingSession session(scene, square_asset(1));
  session.options.recovery = RecoveryPolicy::kAuto;
  const CuttingRun run_ = session.run([](std::uint64_t tick) {
    return tick >= 300 && tick < 330 ? DeviceStatus::kLinkLost : DeviceStatus::kOk;
  });
  ASSERT_EQ(run_.report.faults.size(), 1U);
  EXPECT_GT(run_.rows[299].tip_N, 15);
  std::size_t again = 330;
  while (again < run_.rows.size() && run_.rows[again].safety != SafetyState::kRunning)
    ++again;
  ASSERT_LT(again, run_.rows.size()) << "never again";
  EXPECT_GT(run_.rows[again].t_s, 0.6) << "not while the tool is pressed in";
  EXPECT_GE(run_.rows[again].tool_m[2], 0.12 - 1e-6) << "not below the front";
  for (std::size_t k = 300; k <= again; ++k)
    ASSERT_EQ(run_.rows[k].cutting.wrench_tissue[2], 0) << k;
  double max_N = 0;
  for (std::size_t k = again; k < run_.rows.size(); ++k) {
    max_N = std::max(max_N, run_.rows[k].tip_N);
    ASSERT_LE(run_.rows[k].tip_N, 5000 * std::max(0.0, 0.12 - run_.rows[k].tool_m[2]) + 2)
        << "no jump of force";
  }
  EXPECT_GT(max_N, 12) << "the sheet still bears";
  EXPECT_TRUE(run_.report.punctures.empty());
}

/// The least energy that the device's own damping takes between two rows.
double damped_J(const DeviceDescription& description, const RecordingRow& a, const RecordingRow& b,
                double rate_Hz) {
  const auto pose = [](const RecordingRow& row) {
    Pose T;
    T.p_m = {row.p_m[0], row.p_m[1], row.p_m[2]};
    T.q = Eigen::Quaterniond(row.q[0], row.q[1], row.q[2], row.q[3]);
    return T;
  };
  const Pose T = pose(a);
  const InverseResult joints = inverse_kinematics(description, T);
  const JacobianResult motion = jacobian(description, T, joints.joints);
  EXPECT_TRUE(joints.status && motion.status);
  return description.joint_viscous_friction_Nms_per_rad * rate_Hz *
         (motion.G * displacement(T, pose(b))).squaredNorm();
}

// The wrench is held for a tick, which leaks dx' K dx / 2: the hand is given that by the motors,
// and the device's damping takes it.
TEST(CuttingSession, WhereTheDampingSufficesNothingIsGivenToTheHand) {
  Scene scenes[] = {paper(0.05), procedure()};
  const Asset assets[] = {square_asset(1), spaced_asset(12, 1)};
  for (std::size_t i = 0; i < 2; ++i) {
    Scene& scene = scenes[i];
    scene.force_law.coupling_N_per_m = 4000;
    scene.force_law.coupling_Nm_per_rad = 10;
    for (const double rate_Hz : {1000.0, 4000.0}) {
      DeviceDescription description = description_with(0.005);
      description.encoder_counts_per_revolution = 0;  // else poses are rounded
      CuttingRun run_;
      description.joint_viscous_friction_Nms_per_rad = 0.02;
      for (int k = 0; k < 15; ++k, description.joint_viscous_friction_Nms_per_rad *= 1.5) {
        Scene probe = scene;
        ASSERT_TRUE(place_body(probe, assets[i], "a"));
        auto sheets = place_slices(probe, assets[i], "a");
        Remesher remesher(*sheets);
        SessionOptions options = CuttingSession(probe, assets[i], rate_Hz).options;
        options.record.reset();
        const auto workers = test::make_workers(probe, remesher, options, description);
        ASSERT_TRUE(workers);
        if (workers->law->estimator() == PoseEstimator{}) break;
      }
      run_ = CuttingSession(scene, assets[i], rate_Hz, description).run();

      ASSERT_EQ(run_.report.law->estimator(), PoseEstimator{}) << "neither filter nor lead";
      double taken_J = 0, least_J = 0;
      for (std::size_t k = 1; k < run_.rows.size(); ++k) {
        const RecordingRow &before = run_.rows[k - 1], &now = run_.rows[k];
        taken_J += damped_J(description, before, now, rate_Hz);
        const RecordingRow::Cutting& c = now.cutting;
        least_J = std::min(least_J, taken_J + c.absorbed_J - (c.stored_J + c.cut_J));
      }
      EXPECT_GE(least_J, -1e-9) << (i == 0 ? "sheet, " : "bone, ") << rate_Hz << " Hz";
      EXPECT_GT(run_.rows.back().cutting.cut_J, i == 0 ? -1e-12 : 1e-3);
      EXPECT_GT(run_.rows.back().cutting.absorbed_J, 1e-3);
    }
  }
}

TEST(CuttingSession, AReplayTakesTheRecordedEstimator) {
  Scene scene = procedure();
  const Asset asset = spaced_asset(12, 1);
  ASSERT_TRUE(place_body(scene, asset, "a"));
  auto sheets = place_slices(scene, asset, "a");
  Remesher remesher(*sheets);
  const auto made = [&](const char* stated) {
    SessionOptions options;
    options.origin.entries = {{kOriginEstimator, stated}};
    return test::make_workers(scene, remesher, options, default_device_description());
  };
  const auto workers = made("1500/0.0004/inf/0");
  ASSERT_TRUE(workers) << workers.error().message;
  EXPECT_EQ(workers->estimator, (PoseEstimator{{1500, 0.0004}, {}}));
  for (const char* bad : {"", "1500", "1500/0.0004/inf", "nan/0/inf/0", "-1/0/inf/0", "0/0/inf/0",
                          "1500/2/inf/0", "1500/-0.1/inf/0", "1500/0/inf/0/1", "1500/0/inf/0x"}) {
    const auto refused = made(bad);
    ASSERT_FALSE(refused) << bad;
    EXPECT_EQ(refused.error().code, ExitCode::kRefused) << bad;
  }
}

TEST(CuttingSession, ABodyThatCannotBeIsRefusedWithTheAssetsName) {
  Scene scene = body_scene(0, 3, 0.12);
  scene.asset = "bone.glb";
  scene.tissue.cut = CutTissue{};
  scene.tissue.cut->bone = BoneByHu{"wolff", "qct", 8e-4, 0, false};
  const Asset asset = spaced_asset(4, 1);
  ASSERT_TRUE(place_body(scene, asset, "bone.glb"));
  auto sheets = place_slices(scene, asset, "bone.glb");
  Remesher remesher(*sheets);
  const auto workers = test::make_workers(scene, remesher, {});
  ASSERT_FALSE(workers);
  EXPECT_EQ(workers.error().code, ExitCode::kRefused);
  EXPECT_EQ(workers.error().message.rfind("bone.glb: slice ", 0), 0U) << workers.error().message;
}

}  // namespace
}  // namespace trocar::runtime
