// SPDX-License-Identifier: Apache-2.0
// Sessions whose hand another process moves, here in virtual time and therefore repeatable: events, a
// replay, and no allocation on the haptic thread.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>

#include "formats/session/telemetry.h"
#include "runtime/session/live_hand.h"
#include "tests/runtime/session/test_session.h"

namespace trocar::runtime {
namespace {

constexpr double kHandSession_s = 1.5;

struct HandRun {
  SessionResult report;
  std::string recording;
  std::vector<RecordingRow> rows;
  std::vector<TelemetryEventKind> events;
  nlohmann::json about;
};

/// A sheet that holds, and a live hand above it.
Scene hand_scene() {
  Scene scene = test::descent_scene({0.12}, 0.13, 0.115, 0.1);
  scene.tissue.threshold_N = 1000;
  scene.duration_s = kHandSession_s;
  scene.hand.live = true;
  scene.hand.trajectory.resize(1);
  return scene;
}

/// Returns the target before a tick; none: the hand lets go.
using Person = std::function<std::optional<std::array<double, 6>>(std::uint64_t tick)>;

/// Down to 5 mm below the sheet's height, and a little sideways; let go at 1 s.
std::optional<std::array<double, 6>> press(std::uint64_t tick) {
  if (tick >= 1000) return std::nullopt;
  const double t_s = static_cast<double>(tick) / 1000;
  return std::array{0.004 * t_s, 0.0, 0.13 - std::min(0.015, 0.03 * t_s), 0.1 * t_s, 0.0, 0.0};
}

/// Runs a session: with a person, or of recorded rows (null).
HandRun run_hand(const Scene& scene, const Person& person,
                 std::span<const RecordingRow> replay = {}) {
  testing_support::TestSession session(scene);
  SessionOptions& options = session.options;
  options.replay = replay;
  options.telemetry = TelemetryOptions{session.folder / "live", "", "", "", {}};
  const FourLegsSpecification specification(session.description);
  std::unique_ptr<LiveHand> hand;
  if (person) {
    const auto limits = live_hand_limits(scene, specification, options.limits);
    EXPECT_TRUE(limits);
    hand = std::make_unique<LiveHand>(*limits, make_tool(scene.tool), specification, options.limits,
                                      TargetPath(scene.duration_s));
    options.hand = hand.get();
    options.telemetry->hand = PublishedHand{*limits, hand_impedance(scene.hand)};
    session.device.emplace(
        std::move(*make_simulated_device(scene, session.description, hand.get())));
  }
  session.prepare();
  auto reader = TelemetryReader::open(options.telemetry->file);
  EXPECT_TRUE(reader);
  std::uint64_t tick = 0;
  ReplayDevice recorded(replay);
  Device& device = person ? static_cast<Device&>(*session.device) : recorded;
  HandRun run;
  run.report = session.run(device, [&](double dt_s) {
    if (!person) return;
    session.device->step(dt_s);
    if (++tick % 16 != 0) return;  // about 60 messages a second
    const auto target = person(tick);
    (*reader)->hand({tick, target.has_value(), target.value_or(std::array<double, 6>{})});
  });
  TelemetryEvent event;
  std::uint64_t lost = 0;
  while ((*reader)->next_event(event, lost) != TelemetryReader::Next::kNone)
    run.events.push_back(event.kind);
  run.about = nlohmann::json::parse((*reader)->about());
  EXPECT_EQ((*reader)->has_hand(), person != nullptr);
  run.rows = session.rows();
  run.recording = session.recording();
  return run;
}

TEST(LiveHandSession, PushesAndLetsGo) {
  const HandRun run = run_hand(hand_scene(), press);
  EXPECT_EQ(run.report.end, SessionEnd::kDone);
  EXPECT_EQ(run.report.allocations_in_loop.value_or(0), 0U) << "on the haptic thread";
  EXPECT_EQ(run.events, (std::vector{TelemetryEventKind::kHand, TelemetryEventKind::kHandLetGo,
                                     TelemetryEventKind::kEnded}));
  const auto force_N = [&](std::size_t tick) { return run.rows.at(tick).wrench_delivered[2]; };
  EXPECT_EQ(force_N(200), 0);
  // Springs in series: 5 mm by 4000 and 5000 N/m.
  EXPECT_NEAR(force_N(990), 0.005 / (1 / 4000.0 + 1 / 5000.0), 0.5);
  EXPECT_LT(std::abs(force_N(1060)), 1);
  const nlohmann::json& about = run.about["hand"];
  EXPECT_EQ(about["live"], true);
  EXPECT_EQ(about["stiffness_N_per_m"], 4000);
  EXPECT_EQ(about["start"]["tip_m"], nlohmann::json::array({0.0, 0.0, 0.13}));
  EXPECT_NEAR(about["box"]["min_m"][2], 0.1, 1e-9);
}

TEST(LiveHandSession, AReplayNeedsNoHandAndHasTheSameBytes) {
  const HandRun run = run_hand(hand_scene(), press), same = run_hand(hand_scene(), press);
  EXPECT_EQ(run.recording, same.recording);
  const HandRun again = run_hand(hand_scene(), nullptr, run.rows);
  EXPECT_EQ(again.report.replay_first_difference, -1);
  EXPECT_EQ(again.recording, run.recording);
}

}  // namespace
}  // namespace trocar::runtime
