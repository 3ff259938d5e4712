// SPDX-License-Identifier: Apache-2.0
// Sessions with a simulated pose device: what it gets, what is recorded, and that a replay gives the same bits.
#include "runtime/session/pose_session.h"

#include <gtest/gtest.h>

#include <cmath>

#include "runtime/device/pose/pose_hand.h"
#include "runtime/session/open_device.h"
#include "runtime/session/session.h"
#include "tests/support/sheet_fixture.h"
#include "tests/support/temporary_folder.h"

namespace trocar::runtime {
namespace {

PoseDeviceDescription arm_of_session() {
  PoseDeviceDescription device;
  device.name = "arm";
  device.force_max_N = 5;
  device.stiffness_max_N_per_m = 1000;
  device.mass_kg = 0.3;
  device.damping_N_s_per_m = 1;
  device.position_resolution_m = 1e-5;
  device.workspace_min_m = {-0.08, -0.08, -0.08};
  device.workspace_max_m = {0.08, 0.08, 0.08};
  return device;
}

Scene scene_of(ForceLawKind kind) {
  Scene scene;
  scene.name = "test";
  scene.slices = {{0, 0.12, {}}};
  scene.tissue.threshold_N = 20;
  scene.force_law.kind = kind;
  scene.hand.trajectory = {{0, {0, 0, 0.14}, {}}, {1.5, {0, 0, 0.1}, {}}, {2, {0, 0, 0.14}, {}}};
  scene.duration_s = 2;
  return scene;
}

/// A session in virtual time of a simulated pose device, or of another one of the same description.
struct PoseRun {
  PoseRun(PoseDeviceDescription of, Scene with, const SliceMesh& mesh)
      : device(std::move(of)), scene(std::move(with)), asset(test::asset_of(mesh, 1)) {
    options.clock = Clock::kVirtual;
    options.duration_s = scene.duration_s;
    set_pose_device_options(device, scene, options);
  }
  std::unique_ptr<SimulatedPoseDevice> simulated() const {
    auto made = make_simulated_pose_device(scene, device, nullptr);
    EXPECT_TRUE(made);
    return std::make_unique<SimulatedPoseDevice>(std::move(*made));
  }
  SessionResult run(std::unique_ptr<PoseDevice> with) {
    const OpenedDevice opened = make_pose_hand(device, scene, std::move(with));
    auto sheets = place_slices(scene, asset, "test.glb");
    EXPECT_TRUE(sheets) << sheets.error().message;
    Remesher remesher(*sheets);
    auto workers = make_workers(scene, opened.device->specification(), remesher, options);
    EXPECT_TRUE(workers) << workers.error().message;
    return run_session(
        scene, remesher, *opened.device, [&](double dt_s) { opened.device->advance(dt_s); },
        options, std::move(*workers));
  }

  PoseDeviceDescription device;
  Scene scene;
  Asset asset;
  SessionOptions options;
};

const SliceMesh& wide_mesh() {
  static const SliceMesh made = test::square_mesh({-25600, -25600}, 5120, 10);
  return made;
}

TEST(PoseSession, MiddleOfThePathIsTheMiddleOfTheWorkspace) {
  Scene scene = scene_of(ForceLawKind::kHooke);
  scene.tool.tip_in_plate_m = {0, 0, -0.02};
  PoseReading middle;
  const Pose plate = pose_frame(arm_of_session(), scene).plate(middle);
  EXPECT_NEAR((plate.p_m - Eigen::Vector3d(0, 0, 0.12 + 0.02)).norm(), 0, 1e-15);
}

TEST(PoseSession, HandleOfForceDimensionMovesTowardsTheUserAlongItsXAxis) {
  const auto device = built_in_pose_device("force_dimension");
  ASSERT_TRUE(device);
  const PoseFrame frame = pose_frame(*device, scene_of(ForceLawKind::kHooke));
  PoseReading moved;
  moved.p_m = {0.01, 0.02, 0.03};
  const Eigen::Vector3d step_m = frame.plate(moved).p_m - frame.plate({}).p_m;
  // The scene has x to the right, y away from the user and z up; the device x to the user, y to the right and z up.
  EXPECT_NEAR((step_m - Eigen::Vector3d(0.02, -0.01, 0.03)).norm(), 0, 1e-15);
}

TEST(PoseSession, OptionsAreThoseOfTheDevice) {
  const Scene scene = scene_of(ForceLawKind::kHooke);
  SessionOptions options;
  options.stiffness.margin = kHardwareMargin;
  set_pose_device_options(arm_of_session(), scene, options);
  EXPECT_EQ(options.limits.timing.ramp_s, 0);
  EXPECT_TRUE(options.limits.timing.ramps_at_start);
  EXPECT_NEAR(options.limits.workspace_max_m[2] - options.limits.workspace_min_m[2], 0.16, 1e-15);
  EXPECT_TRUE(options.coupling.on);
  EXPECT_NEAR(options.coupling.stiffness_N_per_m, 500, 1e-9) << "half of what is stated";
  EXPECT_EQ(options.stiffness.max_N_per_m, 500) << "with every law";
  SessionOptions chosen;
  chosen.coupling = {true, 800, 4};
  set_pose_device_options(arm_of_session(), scene, chosen);
  EXPECT_EQ(chosen.coupling.stiffness_N_per_m, 800) << "the operator's choice stays";
  EXPECT_EQ(chosen.coupling.damping_N_s_per_m, 4);
}

TEST(PoseSession, NoCouplingIsStifferThanTheDeviceAllows) {
  Scene scene = scene_of(ForceLawKind::kHooke);
  for (const double force_scale : {0.1, 1.0, 10.0}) {
    for (const double chosen_N_per_m : {0.0, 3000.0, 1e6}) {
      scene.force_law.force_scale = force_scale;
      SessionOptions options;
      options.stiffness.margin = kHardwareMargin;
      if (chosen_N_per_m > 0) options.coupling = {true, chosen_N_per_m, 5};
      set_pose_device_options(arm_of_session(), scene, options);
      EXPECT_TRUE(options.coupling.on);
      EXPECT_GT(options.coupling.stiffness_N_per_m, 0);
      EXPECT_LE(force_scale * options.coupling.stiffness_N_per_m, 500 * (1 + 1e-12))
          << force_scale << ", " << chosen_N_per_m;
    }
  }
}

TEST(PoseSession, OriginStatesTheDeviceAndIsReadBack) {
  const Scene scene = scene_of(ForceLawKind::kHooke);
  SessionOptions options;
  options.stiffness.margin = 2;
  RecordingOrigin origin;
  origin.entries = {{kOriginDevice, "built-in"}, {"force-law", "hooke"}};
  EXPECT_FALSE(read_pose_device_origin(origin));
  Scene scaled = scene;
  scaled.force_law.force_scale = 0.1 + 0.2;
  write_pose_device_origin("built-in/haply_inverse3", arm_of_session(), scaled, options, origin);
  const auto parsed = parse_origin(to_text(origin));
  ASSERT_TRUE(parsed) << parsed.error().message;
  const auto stated = read_pose_device_origin(*parsed);
  ASSERT_TRUE(stated);
  EXPECT_EQ(stated->built_in, "haply_inverse3");
  EXPECT_EQ(stated->force_scale, 0.1 + 0.2);
  EXPECT_EQ(stated->force_max_N, 5);
  EXPECT_EQ(stated->stiffness_margin, 2);
  EXPECT_TRUE(recording_kind(*parsed).has_pose_device);
}

class PoseSessionTest : public testing::TestWithParam<ForceLawKind> {};

TEST_P(PoseSessionTest, RunsWithinTheDevicesForceAndReplaysBitByBit) {
  Scene scene = scene_of(GetParam());
  const SliceMesh mesh = test::square_mesh({-5120, -5120}, 1024, 10);
  auto sheets = place_slices(scene, test::asset_of(mesh, 1), "test.glb");
  ASSERT_TRUE(sheets) << sheets.error().message;
  const auto scale = fitting_force_scale(arm_of_session(), scene, *sheets, 1000);
  ASSERT_TRUE(scale) << scale.error().message;
  EXPECT_NEAR(*scale, 5.0 / 20, 1e-12);
  scene.force_law.force_scale = *scale;

  const test::TemporaryFolder folder;
  PoseRun session(arm_of_session(), scene, mesh);
  SessionOptions& options = session.options;
  options.record = folder.path() / "session.csv";
  options.origin.entries = {{kOriginDevice, "built-in"}};
  write_pose_device_origin("digest", arm_of_session(), scene, options, options.origin);
  const SessionResult report = session.run(session.simulated());
  EXPECT_EQ(report.end, SessionEnd::kDone) << to_string(report.fault);
  EXPECT_EQ(report.punctures.size(), 1U);
  EXPECT_GT(report.max_force_N, 4);
  EXPECT_LE(report.max_force_N, 5 * (1 + 1e-12));

  RecordingOrigin origin;
  const auto rows = read_recording(*options.record, &origin);
  ASSERT_TRUE(rows) << rows.error().message;
  EXPECT_TRUE(recording_kind(origin).has_pose_device);
  double max_N = 0;
  for (const RecordingRow& row : *rows) {
    for (std::size_t i = 0; i < 6; ++i) {
      EXPECT_EQ(row.wrench_delivered[i], row.pose_device.wrench[i]) << "the frames are parallel";
      EXPECT_TRUE(i < 3 || row.pose_device.wrench[i] == 0);
    }
    max_N = std::max(max_N, row.pose_device.wrench[2]);
  }
  EXPECT_EQ(max_N, report.max_force_N);
  // The force rises from zero at the beginning.
  EXPECT_LT((*rows)[5].authority, 0.1);

  options.record.reset();
  options.replay = *rows;
  const SessionResult again = session.run(std::make_unique<ReplayPoseDevice>(*rows));
  EXPECT_EQ(again.ticks, report.ticks);
  EXPECT_EQ(again.replay_first_difference, -1);
  // A replay that differs is found.
  std::vector<RecordingRow> changed = *rows;
  changed[1000].pose_device.wrench[2] = std::nextafter(changed[1000].pose_device.wrench[2], 100);
  options.replay = changed;
  EXPECT_EQ(session.run(std::make_unique<ReplayPoseDevice>(changed)).replay_first_difference, 1000);
}

// The sum of work, written again from the columns of the recording: the force at each tick is held until the next.
TEST(PoseSession, EnergyAccountCountsTheForceAloneIfTheMomentIsDropped) {
  PoseDeviceDescription device = arm_of_session();
  device.force_max_N = 80;
  device.stiffness_max_N_per_m = 20'000;
  device.senses_rotation = true;
  Scene scene = scene_of(ForceLawKind::kCutting);
  scene.tool.tip_in_plate_m = {0, 0, -0.02};
  // The tip goes into the sheet, and the tool is tilted there by 8 degrees and back.
  scene.hand.trajectory = {{0, {0, 0, 0.125}, {}},
                           {0.4, {0, 0, 0.117}, {}},
                           {0.7, {0, 0, 0.117}, {8, 0, 0}},
                           {1, {0, 0, 0.117}, {0, 8, 0}},
                           {1.3, {0, 0, 0.125}, {}}};
  scene.duration_s = 1.4;
  const test::TemporaryFolder folder;
  PoseRun session(device, scene, wide_mesh());
  SessionOptions& options = session.options;
  options.record = folder.path() / "session.csv";
  options.origin.entries = {{kOriginDevice, "built-in"}, {"force-law", "cutting"}};
  write_pose_device_origin("digest", device, scene, options, options.origin);
  const SessionResult report = session.run(session.simulated());
  ASSERT_EQ(report.end, SessionEnd::kDone) << to_string(report.fault);
  const auto rows = read_recording(*options.record);
  ASSERT_TRUE(rows) << rows.error().message;

  double dropped_J = 0;  // the work that the moments would have done
  int compared = 0;
  for (std::size_t k = 1; k < rows->size(); ++k) {
    const RecordingRow &before = (*rows)[k - 1], &now = (*rows)[k];
    if (before.passivity_J == 0 || now.passivity_J == 0) continue;  // there is no contact
    const Eigen::Vector3d moved =
        Eigen::Vector3d(now.p_m.data()) - Eigen::Vector3d(before.p_m.data());
    const Eigen::Quaterniond turn =
        Eigen::Quaterniond(now.q[0], now.q[1], now.q[2], now.q[3]) *
        Eigen::Quaterniond(before.q[0], before.q[1], before.q[2], before.q[3]).conjugate();
    const Eigen::Map<const Eigen::Matrix<double, 6, 1>> got(before.wrench_delivered.data()),
        wanted(before.wrench_wanted.data());
    EXPECT_TRUE(got.tail<3>().isZero(0));
    const double stored_J =
        now.authority * now.cutting.stored_J - before.authority * before.cutting.stored_J;
    EXPECT_NEAR(now.passivity_J - before.passivity_J, -got.head<3>().dot(moved) - stored_J, 1e-12)
        << "tick " << k;
    dropped_J += std::abs(2 * wanted.tail<3>().dot(turn.vec()));
    ++compared;
  }
  EXPECT_GT(compared, 300);
  EXPECT_GT(dropped_J, 1e-3) << "a moment was wanted, and the handle turned";
}

INSTANTIATE_TEST_SUITE_P(SheetLaws, PoseSessionTest,
                         testing::Values(ForceLawKind::kHooke, ForceLawKind::kNetwork));

// Devices by URI, and of which kind their description must be. Wrong URIs: tests/e2e/wrong_uses.json.

struct Opened {
  Scene scene;
  AnyDeviceDescription description = default_device_description();
  Opened() {
    scene.tool.tip_in_plate_m = {0, 0, 0};
    scene.hand.trajectory = {{0, {0, 0, 0.15}, {}}};
  }
  Result<OpenedDevice> open(std::string_view uri, const char* key_file = "") const {
    return open_device(uri, {.scene = scene,
                             .scene_name = "scene.json",
                             .description = description,
                             .key_file = key_file,
                             .say = {}});
  }
};

TEST(OpenDevice, DescriptionMustBeOfTheDevicesKind) {
  Opened legs;
  for (const char* uri : {"haply:", "haply:127.0.0.1:1", "forcedimension:"}) {
    EXPECT_FALSE(built_in_description(uri).empty());
    EXPECT_TRUE(may_have_motors(uri));
    const auto opened = legs.open(uri);
    ASSERT_FALSE(opened);
    EXPECT_EQ(opened.error().code, ExitCode::kUsage);
    EXPECT_NE(opened.error().message.find("measures its own pose"), std::string::npos);
  }
  Opened pose;
  pose.description = *built_in_pose_device("haply_inverse3");
  const auto drive = pose.open("udp:127.0.0.1:4840", "key");
  ASSERT_FALSE(drive);
  EXPECT_NE(drive.error().message.find("has encoders and motors"), std::string::npos);
  EXPECT_TRUE(pose.open("inproc"));
  EXPECT_TRUE(built_in_description("udp:127.0.0.1:4840").empty());
}

}  // namespace
}  // namespace trocar::runtime
