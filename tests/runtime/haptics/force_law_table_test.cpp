// SPDX-License-Identifier: Apache-2.0
// The table of force laws: the shipped laws, and a fourth one that a test adds. The added law runs in a
// session and appears in the recording, the telemetry, the output of check and the reports.
#include "runtime/session/force_law_table.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "formats/base/files.h"
#include "formats/session/telemetry.h"
#include "runtime/check/scene_check.h"
#include "runtime/report/session_observer.h"
#include "runtime/report/session_report.h"
#include "tests/runtime/haptics/constant_layer.h"
#include "tests/runtime/session/test_session.h"
#include "tests/support/body_fixture.h"

namespace trocar::runtime {
namespace {

constexpr double kSheetTop_m = 0.12;

Scene scene_of(ForceLawKind law) {
  Scene scene = test::descent_scene({kSheetTop_m, 0.11}, 0.13, 0.105, 0.05);
  scene.force_law.kind = law;
  return scene;
}

struct Finished {
  SessionResult report;
  std::vector<RecordingRow> rows;
  std::string law_in_telemetry, summary;
};

Finished run(const Scene& scene, const std::vector<RecordingRow>& replay = {}) {
  testing_support::TestSession session(scene, 2);
  SessionOptions& options = session.options;
  options.duration_s = 0.6;
  options.origin.entries = {{"force-law", to_string(scene.force_law.kind)}};
  options.replay = replay;
  options.telemetry = TelemetryOptions{session.folder / "live", "scene.json", "x", "y", {}};
  Finished out;
  options.on_tick = [&](const ObservedTick&) {
    if (!out.law_in_telemetry.empty()) return;
    const auto reader = TelemetryReader::open(options.telemetry->file);
    ASSERT_TRUE(reader) << reader.error().message;
    const auto about = nlohmann::json::parse((*reader)->about());
    out.law_in_telemetry = about["force_law"].get<std::string>();
  };
  session.simulate();
  ReplayDevice replayed(replay);
  Device& device = replay.empty() ? static_cast<Device&>(*session.device) : replayed;
  out.report = session.run(device, [&](double dt_s) {
    if (replay.empty()) session.device->step(dt_s);
  });
  out.summary = summarize(scene, options, out.report, *session.remesher);
  out.rows = session.rows();
  return out;
}

TEST(ForceLawTable, MakesTheShippedLaws) {
  const FourLegsSpecification device(default_device_description());
  for (std::size_t i = 0; i < kForceLaws.size(); ++i) {
    Scene scene = scene_of(static_cast<ForceLawKind>(i));
    const test::Placed placed(scene, test::square_asset(2));
    const auto law = make_force_law({scene, device, placed.sheets, 1000, {}, {}});
    ASSERT_TRUE(law) << law.error().message;
    const std::string name = kForceLaws.at(i).name;
    EXPECT_EQ((*law)->describe().rfind("force law  " + name, 0), 0U) << (*law)->describe();
    EXPECT_EQ((*law)->prefetch_worker() != nullptr, name == "network");
    EXPECT_EQ((*law)->retract_distance_m(placed.sheets, Pose{}), 0);
  }
}

TEST(ForceLawTable, ASceneCanNameAnAddedLaw) {
  EXPECT_EQ(add_constant_layer(), static_cast<ForceLawKind>(kForceLaws.size()));
  const std::string text = R"({"schema": "trocar.scene/1", "name": "n", "asset": "a.glb",
    "duration_s": 1, "slices": [{"index": 0, "z_m": 0.12}], "force_law": {"kind": "constant"},
    "hand": {"trajectory": [{"t_s": 0, "tip_m": [0, 0, 0.13]}, {"t_s": 1, "tip_m": [0, 0, 0.11]}]}})";
  const auto scene = parse_scene(text, "s.json", ".");
  ASSERT_TRUE(scene) << scene.error().message;
  EXPECT_EQ(scene->force_law.kind, add_constant_layer());
  EXPECT_EQ(std::string(to_string(scene->force_law.kind)), "constant");
  EXPECT_EQ(force_law_names(), "hooke, network, cutting or constant");
}

TEST(ForceLawTable, AnAddedLawRunsInASession) {
  const Scene scene = scene_of(add_constant_layer());
  const Finished first = run(scene);
  EXPECT_EQ(first.report.end, SessionEnd::kDone);
  EXPECT_EQ(first.law_in_telemetry, "constant");

  // The recording.
  std::size_t pressed = 0;
  for (const RecordingRow& row : first.rows) {
    const bool is_below = row.tool_m[2] < kSheetTop_m && row.safety == SafetyState::kRunning;
    if (!is_below) continue;
    ++pressed;
    EXPECT_EQ(row.phase, ContactPhase::kContact);
    EXPECT_EQ(row.active_slice, 0);
    EXPECT_NEAR(row.wrench_wanted[2], ConstantLayerLaw::kForce_N, 1e-9) << row.t_s;
  }
  EXPECT_GT(pressed, 100U);

  // The summary.
  const auto summary = nlohmann::json::parse(first.summary);
  EXPECT_GT(summary["constant"]["deepest_m"].get<double>(), 1e-3);
  EXPECT_FALSE(summary.contains("network"));
  EXPECT_TRUE(summary["passivity"]["on"].get<bool>());

  // A replay.
  const Finished again = run(scene, first.rows);
  EXPECT_EQ(again.report.replay_first_difference, -1);
}

TEST(ForceLawTable, AnAddedLawIsInTheSessionReportAndInTheCheck) {
  const Scene scene = scene_of(add_constant_layer());
  const SessionResult result;
  const ReportFacts facts{result};
  SessionObserver observer(scene, {{0, kSheetTop_m, ""}, {1, 0.11, ""}}, 1000);
  const auto report = nlohmann::json::parse(session_report_json(scene, observer.figures(), facts));
  EXPECT_EQ(report["force_law"].get<std::string>(), "constant");

  const AnyDeviceDescription description = default_device_description();
  const auto specification = make_specification(description, scene);
  const auto sheets = place_slices(scene, test::square_asset(2), "a");
  ASSERT_TRUE(sheets);
  SessionOptions options;
  options.rate_Hz = 1000;
  options.duration_s = 1;
  const auto checked = check_scene(
      scene, {*specification, [&](const Scene& it) { return simulate_device(it, description); }},
      *sheets, choose_tissues(scene, test::square_asset(2)), {}, options);
  ASSERT_TRUE(checked) << checked.error().message;
  EXPECT_NE(checked->text.find("force law  constant\n"), std::string::npos);
}

}  // namespace
}  // namespace trocar::runtime
