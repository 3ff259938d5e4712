// SPDX-License-Identifier: Apache-2.0
// A scene is checked with the device that will run it: here one without joints and motors.
#include "runtime/check/scene_check.h"

#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "runtime/check/dry_run.h"
#include "runtime/check/new_scene.h"
#include "runtime/session/live_hand.h"
#include "runtime/session/open_device.h"
#include "tests/support/handle_device.h"
#include "tests/support/sheet_fixture.h"

namespace trocar::runtime {
namespace {

// A scene is checked with the device that will run it: here one without joints and motors.

/// The device of a check, and how often a simulated one was made of it.
struct Handle {
  explicit Handle(double force_max_N, double stop_z_m = 0.05)
      : specification(force_max_N, stop_z_m) {}
  DeviceToCheck to_check() {
    return {specification, [this](const Scene& scene) -> Result<std::shared_ptr<HandDevice>> {
              ++made;
              HandTrajectory path = hand_trajectory(scene);
              if (!specification.margins(path.keyframes.front().T_device_tool).is_reachable)
                return refused("the handle cannot be there");
              return std::shared_ptr<HandDevice>(
                  std::make_shared<test::HandleDevice>(specification, std::move(path)));
            }};
  }
  test::HandleSpecification specification;
  int made = 0;
};

/// The tip goes through one sheet, which breaks at 35 N, and 15 mm below it.
Scene one_sheet() {
  Scene scene = test::descent_scene({0.12}, 0.13, 0.105, 0.05);
  scene.tissue = Tissue{};
  return scene;
}

SceneCheck check(const Scene& scene, Handle& handle, CheckExtent extent = CheckExtent::kWhole) {
  const Asset asset = test::square_asset(1);
  SessionOptions options;
  options.clock = Clock::kVirtual;
  options.duration_s = scene.duration_s;
  auto checked = check_scene(scene, handle.to_check(), *place_slices(scene, asset, "a"),
                             choose_tissues(scene, asset), {}, options, extent);
  if (!checked) throw std::runtime_error(checked.error().message);
  return std::move(*checked);
}

bool has(const std::string& text, const char* part) {
  return text.find(part) != std::string::npos;
}

TEST(SceneCheck, TellsOnlyWhatADeviceHas) {
  Handle handle(50);
  const SceneCheck done = check(one_sheet(), handle);
  EXPECT_TRUE(done.warnings.empty()) << done.warnings.front();
  EXPECT_TRUE(has(done.text, "device     handle, 50 N\n")) << done.text;
  EXPECT_TRUE(has(done.text, "threshold needs 35.0 of 50.0 N")) << done.text;
  EXPECT_TRUE(has(done.text, "1 of 1 slices touched, 1 punctured; at most 3")) << done.text;
  for (const char* foreign : {"Nm", "theta", "condition"})
    EXPECT_FALSE(has(done.text, foreign)) << foreign << ": " << done.text;
}

TEST(SceneCheck, StatesTheThresholdThatIsRendered) {
  Handle handle(50);
  Scene scene = one_sheet();
  scene.force_law.force_scale = 0.5;
  const SceneCheck done = check(scene, handle);
  EXPECT_TRUE(has(done.text, " of 17.5 N, punctured at ")) << done.text;
}

TEST(SceneCheck, WarnsOfAForceThatTheDeviceDoesNotRender) {
  Handle handle(20);
  const SceneCheck done = check(one_sheet(), handle);
  ASSERT_EQ(done.warnings.size(), 1U) << done.text;
  EXPECT_TRUE(has(done.warnings[0], ": the device renders too little force, down to 5"))
      << done.warnings[0];
}

TEST(SceneCheck, UntilWarnedAWarningOfTheDryRunIsEnough) {
  Scene scene = one_sheet();
  scene.force_law.kind = ForceLawKind::kCutting;
  scene.tissue.cut.emplace().strength_MPa = 0.5;
  Handle whole(2), until_warned(2);
  const SceneCheck all = check(scene, whole),
                   first = check(scene, until_warned, CheckExtent::kUntilWarned);
  EXPECT_EQ(whole.made, 2 + kLetGoMoments);
  EXPECT_EQ(until_warned.made, 2);
  ASSERT_FALSE(first.warnings.empty());
  EXPECT_EQ(first.warnings.front(), all.warnings.front());
}

TEST(SceneCheck, WarnsOfTheDevicesOwnLimits) {
  Handle handle(50, 0.11);
  const SceneCheck stopped = check(one_sheet(), handle);
  ASSERT_EQ(stopped.warnings.size(), 1U);
  EXPECT_TRUE(has(stopped.warnings[0], "the session ends with the fault pose_residual"))
      << stopped.warnings[0];
  EXPECT_TRUE(has(stopped.warnings[0], "keep the path's height within 0.11"))
      << stopped.warnings[0];
  EXPECT_GT(handle.made, 0);

  Handle high(50, 0.2);
  const SceneCheck refused = check(one_sheet(), high);
  ASSERT_FALSE(refused.warnings.empty());
  EXPECT_TRUE(
      has(refused.warnings[0],
          "cannot start with the tip at (0.0000, 0.0000, 0.1300) m: the handle is at 0.130 m; "
          "the limit is 0.2 m"))
      << refused.warnings[0];
}

TEST(SceneCheck, ALiveHandStaysAboveTheDevicesStop) {
  Scene scene = one_sheet();
  scene.hand.live = true;
  scene.hand.trajectory.resize(1);
  const test::HandleSpecification specification(50, 0.115);
  const SafetyLimits safety;
  const auto limits = live_hand_limits(scene, specification, safety);
  ASSERT_TRUE(limits) << limits.error().message;
  EXPECT_GE(limits->min_m.z(), 0.115);
  EXPECT_LT(limits->min_m.z(), 0.125);
}

TEST(NewScene, LiesWhereTheDeviceReaches) {
  const Asset asset = test::square_asset(3);
  SessionOptions options;
  options.clock = Clock::kVirtual;
  Handle handle(50, 0.1);
  const auto made = propose_scene(asset, "a.glb", "s.json", handle.to_check(), options);
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_TRUE(has(made->text, "heights 0.100 to 0.2")) << made->text;
  Handle nowhere(50, 1);
  EXPECT_FALSE(propose_scene(asset, "a.glb", "s.json", nowhere.to_check(), options));
}

// The stop comes while the n-th simulated session is prepared, whichever that is.
TEST(NewScene, AnInterruptGivesNoSceneAtAnyMoment) {
  const Asset asset = test::square_asset(3);
  std::atomic<bool> stop{false};
  SessionOptions options;
  options.clock = Clock::kVirtual;
  options.stop = &stop;
  const auto propose = [&](int stop_at) {
    Handle handle(50, 0.1);
    DeviceToCheck device = handle.to_check();
    stop = stop_at == 0;
    device.simulate = [&, make = device.simulate](const Scene& scene) {
      auto made = make(scene);
      if (handle.made == stop_at) stop = true;
      return made;
    };
    auto made = propose_scene(asset, "a.glb", "s.json", device, options);
    return std::pair(std::move(made), handle.made);
  };
  const auto [whole, sessions] = propose(-1);
  ASSERT_TRUE(whole) << whole.error().message;
  ASSERT_GE(sessions, 2);
  for (int n = 0; n <= sessions; ++n) {
    const auto made = propose(n).first;
    ASSERT_FALSE(made) << n << ": " << made->text;
    EXPECT_EQ(made.error().code, ExitCode::kDeviceFault) << n;
    EXPECT_TRUE(has(made.error().message, "interrupted")) << n << ": " << made.error().message;
  }
}

TEST(SceneCheck, AnInterruptGivesNoFigures) {
  const Scene scene = one_sheet();
  const Asset asset = test::square_asset(1);
  std::atomic<bool> stop{true};
  SessionOptions options;
  options.clock = Clock::kVirtual;
  options.duration_s = scene.duration_s;
  options.stop = &stop;
  Handle handle(50);
  const auto checked = check_scene(scene, handle.to_check(), *place_slices(scene, asset, "a"),
                                   choose_tissues(scene, asset), {}, options);
  ASSERT_FALSE(checked) << checked->text;
  EXPECT_EQ(checked.error().code, ExitCode::kDeviceFault);
}

// The dry runs in which the hand lets go.

TEST(LettingGo, StatesTheFaultOfTheFirstRunThatHadOne) {
  const Scene scene = test::descent_scene({0.12}, 0.13, 0.105, 0.05);
  Scene leaves_workspace = scene;
  leaves_workspace.hand.trajectory = {{0, {0, 0, 0.13}, {}}, {0.5, {0.1, 0, 0.13}, {}}};
  const test::HandleSpecification stops_early(50, 0.11), stops_late(50);
  int made = 0;
  const DeviceToCheck device{
      stops_late, [&](const Scene&) -> Result<std::shared_ptr<HandDevice>> {
        const bool is_first = ++made == 1;
        return std::shared_ptr<HandDevice>(std::make_shared<test::HandleDevice>(
            is_first ? stops_early : stops_late,
            hand_trajectory(is_first ? scene : leaves_workspace)));
      }};
  SessionOptions options;
  options.clock = Clock::kVirtual;
  options.duration_s = scene.duration_s;
  DryRun had_contact;
  had_contact.feel.contact_from_s = 0.2;
  had_contact.feel.contact_to_s = 0.3;
  had_contact.feel.wanted_most = {1, 0.25};
  const auto sheets = place_slices(scene, test::square_asset(1), "a");
  ASSERT_TRUE(sheets);
  const auto trial = try_letting_go(scene, device, *sheets, options, had_contact);
  ASSERT_TRUE(trial) << trial.error().message;
  ASSERT_TRUE(*trial);
  EXPECT_EQ((*trial)->moments, kLetGoMoments);
  EXPECT_EQ((*trial)->fault, Fault::kPoseResidual);
  made = 0;
  const auto until_fault =
      try_letting_go(scene, device, *sheets, options, had_contact,
                     [](const LetGoTrial& so_far) { return so_far.fault != Fault::kNone; });
  ASSERT_TRUE(until_fault && *until_fault);
  EXPECT_EQ((*until_fault)->moments, 1);
  EXPECT_EQ((*until_fault)->fault, (*trial)->fault);
}

// The figures of a dry run's contact, from rows made by hand.

RecordingRow row_at(int tick, double tool_z_m = 0, double force_N = 0) {
  RecordingRow row;
  row.t_s = tick * 1e-3;
  row.tool_m = {0, 0, tool_z_m};
  row.p_m = {0, 0, tool_z_m + 0.1};
  row.wrench_wanted[2] = force_N;
  return row;
}

ContactFeel feel_of(const std::vector<RecordingRow>& rows, std::optional<double> let_go_t_s = {}) {
  ContactFeelMeter meter({0, 0, -0.1}, let_go_t_s);
  for (const RecordingRow& row : rows)
    meter.add(row);
  return meter.feel();
}

RecordingRow cutting_row(int tick, double tool_z_m, double front_z_m, double tip_N, double cut_J) {
  RecordingRow row = row_at(tick, tool_z_m, tip_N);
  row.cutting.front_z_m = front_z_m;
  row.tip_N = tip_N;
  row.cutting.cut_J = cut_J;
  return row;
}

TEST(ContactFeel, TheSnapIsWhatTheTipIsPastTheFrontAndTheFrontsJump) {
  const ContactFeel feel = feel_of({
      cutting_row(0, 0.001, 0, 0, 0),         // above the bone
      cutting_row(1, -0.002, 0, 40, 0),       // 2 mm past the front
      cutting_row(2, -0.004, 0, 80, 0),       // 4 mm
      cutting_row(3, -0.004, -0.003, 20, 1),  // snaps by 3 mm
      cutting_row(4, -0.005, -0.004, 20, 2),
  });
  EXPECT_DOUBLE_EQ(feel.past_front.value, 0.004);
  EXPECT_DOUBLE_EQ(feel.past_front.t_s, 0.002);
  EXPECT_DOUBLE_EQ(feel.front_jump.value, 0.003);
  EXPECT_DOUBLE_EQ(feel.front_jump.t_s, 0.003);
}

// Behind the last slab above a gap, the front is the next bone; the tip has only fallen to where it is.
TEST(ContactFeel, AGapIsNoJump) {
  const ContactFeel feel = feel_of({
      cutting_row(0, -0.0010, -0.001, 20, 1),
      cutting_row(1, -0.0012, -0.006, 0, 2),  // cut through, 4.8 mm above the next bone
      cutting_row(2, -0.0014, -0.006, 0, 2),
      cutting_row(3, -0.0061, -0.006, 5, 2),
  });
  EXPECT_NEAR(feel.front_jump.value, 0.0002, 1e-12);
  EXPECT_NEAR(feel.past_front.value, 0.0001, 1e-12);
}

TEST(ContactFeel, AnAlternationIsFourChangesEachAgainstTheLast) {
  std::vector<RecordingRow> rows;
  const auto force_of = [&](const std::vector<double>& forces_N, std::size_t axis) {
    rows.clear();
    for (std::size_t i = 0; i < forces_N.size(); ++i) {
      rows.push_back(row_at(static_cast<int>(i)));
      rows.back().wrench_wanted[axis] = forces_N[i];
    }
    return feel_of(rows).alternation;
  };
  for (const std::size_t axis : {0U, 1U, 2U}) {
    EXPECT_EQ(force_of({0, 10, 20, 30, 5, 6, 7}, axis).value, 0) << "a break is no alternation";
    EXPECT_EQ(force_of({0, 10, 0, 10, 10, 10, 0, 10}, axis).value, 0) << "three changes";
    EXPECT_EQ(force_of({0, 10, 0, 10, 3}, axis).value, 7);
    EXPECT_EQ(force_of({0, 10, 0, 10, 3}, axis).t_s, 0.004);
    EXPECT_EQ(force_of({0, 10, -30, 60, -40, 50, 0, 2}, axis).value, 50);
  }
}

TEST(ContactFeel, TheRangeOfTheWantedForceAndTheTimesOfContact) {
  const ContactFeel none = feel_of({row_at(0), row_at(1)});
  EXPECT_EQ(none.contact_from_s, -1);
  EXPECT_EQ(none.contact_to_s, -1);
  const ContactFeel feel = feel_of(
      {row_at(0), row_at(1, 0, 0.4), row_at(2, 0, 30), row_at(3, 0, -7), row_at(4, 0, 0.1)});
  EXPECT_EQ(feel.wanted_least_N, -7);
  EXPECT_EQ(feel.wanted_most.value, 30);
  EXPECT_EQ(feel.wanted_most.t_s, 0.002);
  EXPECT_DOUBLE_EQ(feel.contact_from_s, 0.002);
  EXPECT_DOUBLE_EQ(feel.contact_to_s, 0.003);
}

TEST(ContactFeel, AfterLettingGoDistanceAndSpeedAreThePlates) {
  const std::vector<RecordingRow> rows = {row_at(0, 0.1), row_at(1, 0.0), row_at(2, 0.0002),
                                          row_at(3, 0.0003), row_at(4, 0.0)};
  const ContactFeel feel = feel_of(rows, 0.001);
  EXPECT_NEAR(feel.let_go_distance_m, 0.0003, 1e-12) << "not what the hand moved before";
  EXPECT_NEAR(feel.let_go_speed_m_per_s, 0.3, 1e-9);
  EXPECT_EQ(feel_of(rows).let_go_speed_m_per_s, 0) << "the hand holds on";
}

// Which tissue a slice got and why, and the warning where none fits.

NamedTissue named(const char* name, std::vector<int> labels,
                  std::optional<std::array<double, 2>> hu) {
  NamedTissue tissue;
  tissue.name = name;
  tissue.labels = std::move(labels);
  tissue.hu = hu;
  return tissue;
}

struct Case {
  Scene scene = test::descent_scene({0.12, 0.14, 0.13}, 0.2, 0.1, 0.015);
  Asset asset = test::square_asset(3);
  std::vector<SliceTissue> chosen() const { return choose_tissues(scene, asset); }
  std::string warning() const { return warn_of_unfitting(scene, chosen()).value_or("none"); }
  std::string why(std::size_t i) const { return describe_choice(scene, chosen()[i].choice); }
};

TEST(SliceNames, AreRuns) {
  EXPECT_EQ(name_slices({3}), "slice 3");
  EXPECT_EQ(name_slices({5, 3, 4, 9, 4}), "slices 3-5, 9");
  std::vector<int> odd;
  odd.reserve(40);
  for (int i = 0; i < 40; ++i)
    odd.push_back(2 * i + 1);
  EXPECT_EQ(name_slices(odd), "slices 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23 and 28 more");
}

TEST(TissueAssignment, TopmostFirstWithTheReason) {
  Case c;
  c.scene.tissues = {named("only by name", {}, {}), named("bone", {22, 23}, {}),
                     named("fat", {}, {{-100, 100}})};
  c.asset.slices[1].measures_json = R"({"mean_hu":12.3})";
  c.scene.slices[2].tissue = "only by name";
  ASSERT_EQ(c.chosen().size(), 3U);
  EXPECT_EQ(c.chosen()[0].slice, 1);
  EXPECT_EQ(c.why(0), "tissue \"fat\": mean HU 12");
  EXPECT_EQ(c.why(1), "tissue \"only by name\": named by the slice");
  EXPECT_EQ(c.why(2), "the default tissue: no other fits");
  c.asset.parameters_json = R"({"labels":[22]})";
  EXPECT_EQ(c.why(0), "tissue \"bone\": the asset's label 22");
  c.asset.parameters_json = R"({"labels":"22"})";  // not an array, as the pipeline writes
  EXPECT_EQ(c.why(0), "tissue \"fat\": mean HU 12");
  c.asset.slices[1].measures_json = R"({"mean_hu":"12"})";
  EXPECT_EQ(c.why(0), "the default tissue: no other fits");
  c.scene.tissues.clear();
  EXPECT_EQ(c.why(0), "the default tissue");
  c.scene.tissue_is_given = true;
  EXPECT_EQ(c.why(0), "the scene's \"tissue\"");
}

TEST(TissueAssignment, WarnsOfADefaultThatNobodyChose) {
  Case c;
  EXPECT_EQ(c.warning(), "none") << "no tissues: the default is meant";
  c.scene.tissues = {named("only by name", {}, {})};
  EXPECT_EQ(c.warning(), "none") << "a slice without a name has the default";
  c.scene.tissues.push_back(named("bone", {}, {{300, 1500}}));
  c.scene.tissues.push_back(named("disc", {101, 102}, {}));
  EXPECT_EQ(
      c.warning(),
      "slices 0-2: none of the scene's tissues fits (no mean HU in the asset; the scene has "
      "\"bone\" 300 to 1500 HU, \"disc\" labels 101, 102): the default of 5000 N/m and 35 N is "
      "taken; change a tissue's labels or hu, name a tissue in the slice, or give the scene a "
      "\"tissue\"");
  c.asset.slices[0].measures_json = R"({"mean_hu":299})";
  c.asset.slices[1].measures_json = R"({"mean_hu":301})";
  c.asset.slices[2].measures_json = R"({"mean_hu":1600})";
  EXPECT_NE(c.warning().find("slices 0, 2: "), std::string::npos) << c.warning();
  EXPECT_NE(c.warning().find("mean HU 299 to 1600;"), std::string::npos) << c.warning();
  c.scene.tissue_is_given = true;
  EXPECT_EQ(c.warning(), "none") << "the scene says what the rest gets";
}

}  // namespace
}  // namespace trocar::runtime
