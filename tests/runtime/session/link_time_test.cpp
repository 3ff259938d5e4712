// SPDX-License-Identifier: Apache-2.0
// Damping and punctures over a link that delays and loses packets, and with a host that stops: the
// forces are those of the tool's true motion at the time of the state that they were computed from.
// In virtual time, so that it is the loop that is judged and not this machine.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include "runtime/device/four_legs/four_legs.h"
#include "runtime/haptics/contact_design.h"
#include "runtime/haptics/loop/haptic_loop.h"
#include "runtime/session/open_device.h"
#include "runtime/session/session.h"
#include "tests/support/delayed_link.h"
#include "tests/support/sheet_fixture.h"
#include "tests/support/sheet_law_fixture.h"

namespace trocar::runtime {
namespace {

constexpr double kSheet_m = 0.16, kRate_Hz = 1000;
constexpr double kWithin = 0.2;     ///< tolerance, relative to the true damping force
constexpr double kMinShare = 0.97;  ///< fraction of the threshold at a puncture
constexpr double kFelt_N = 1;       ///< damping below this is not compared

struct FeltThroughLink {
  std::vector<double> error;              ///< relative errors of damping forces
  std::vector<double> share_at_puncture;  ///< true force over threshold
  std::vector<RecordingRow> rows;
  Fault fault = Fault::kNone;
};

double p95(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values.empty() ? 0 : values[values.size() * 95 / 100];
}

/// A hand like that of a peck: stiff, and damped for the delay.
Scene hand_scene(const Tissue& tissue, const std::vector<double>& sheets_m) {
  Scene scene = test::descent_scene(sheets_m, 0.17, 0.15, 0.1);
  scene.tissue = tissue;
  scene.hand.stiffness_N_per_m = 8000;
  scene.hand.damping_N_s_per_m = 140;
  scene.hand.trajectory = {{0, {0, 0, 0.17}, {}}, {0.2, {0, 0, 0.17}, {}}};
  return scene;
}

void move_to(Scene& scene, double z_m, double speed_m_per_s) {
  const TipKeyframe& last = scene.hand.trajectory.back();
  const double takes_s = std::abs(z_m - last.tip_m[2]) / speed_m_per_s;
  scene.hand.trajectory.push_back({last.t_s + takes_s, {0, 0, z_m}, {}});
}

/// Pecking in the sheet: 6 mm up and down at 0.12 m/s, with turns of 2 ms. Damping is 7 N, the
/// largest force 25 N: the sheet holds.
Scene pecking() {
  Scene scene = hand_scene({2000, 35, 60, {}, {}}, {kSheet_m});
  move_to(scene, 0.1535, 0.33);
  for (int i = 0; i < 20; ++i) {
    move_to(scene, 0.1595, 0.12);
    move_to(scene, 0.1535, 0.12);
  }
  return scene;
}

/// Through five sheets, each at its own speed.
Scene piercing(std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const std::vector<double> sheets_m = {kSheet_m, kSheet_m - 0.012, kSheet_m - 0.024,
                                        kSheet_m - 0.036, kSheet_m - 0.048};
  Scene scene = hand_scene({5000, 35, 60, {}, {}}, sheets_m);
  for (const double z_m : sheets_m) {
    const double speed = 0.05 + 0.2 * static_cast<double>(random() >> 11) * 0x1p-53;
    move_to(scene, z_m - 0.0105, speed);
  }
  return scene;
}

/// The scene's sheets, without holes: each is pierced once.
struct Sheets {
  explicit Sheets(const Scene& scene)
      : owned(std::move(*place_slices(
            scene, test::square_asset(static_cast<int>(scene.slices.size())), "link"))) {
    for (const auto& sheet : owned)
      current.push_back(sheet.get());
  }
  std::vector<std::unique_ptr<const Sheet>> owned;
  std::vector<const Sheet*> current;
};

DeviceDescription description_with(int counts) {
  DeviceDescription device = default_device_description();
  device.encoder_counts_per_revolution = counts;
  device.minimum_substeps = 3;
  return device;
}

/// The loop with the estimator that a session would have.
LoopModel loop_model(const Scene& scene, int counts = 0) {
  LoopModel model;
  model.tool = make_tool(scene.tool);
  model.rate_Hz = kRate_Hz;
  model.guards = false;  // its damping would come on top
  const FourLegsSpecification specification(description_with(counts));
  Pose T_device_plate;
  T_device_plate.p_m.z() = kSheet_m;
  model.estimator =
      design_contact(specification, plate_axes(specification, T_device_plate), {1 / kRate_Hz, 0},
                     {.translation_N_per_m = scene.tissue.stiffness_N_per_m,
                      .damping_N_s_per_m = scene.tissue.damping_N_s_per_m})
          ->estimator;
  return model;
}

/// Runs the hand's path and compares what is rendered with the truth at the state used.
FeltThroughLink feel(const Scene& scene, const test::DelayedLinkOptions& link, int counts = 0) {
  const LoopModel model = loop_model(scene, counts);
  const DeviceDescription description = description_with(counts);
  const Sheets sheets(scene);
  test::DelayedLink device(link, std::move(*make_simulated_device(scene, description)));
  FourLegs four_legs(description, device);
  const Tissue& tissue = scene.tissue;
  LoopState state;
  SheetLaw law = test::hooke_law(model);
  TickResult result;
  FeltThroughLink felt;
  while (device.now_s() < scene.hand.trajectory.back().t_s && felt.fault == Fault::kNone) {
    TickInputs inputs;
    inputs.sheets = sheets.current;
    haptic_tick(model, inputs, four_legs, law, state, result);
    device.advance(1 / kRate_Hz);
    felt.fault = state.safety.fault;
    felt.rows.push_back(result.row);
    const ContactOutput& contact = result.contact;
    const double true_N = -tissue.damping_N_s_per_m * device.used().velocity_m_per_s.z();
    if (contact.punctured_now) {
      const Sheet& sheet = *sheets.current[static_cast<std::size_t>(contact.active_sheet)];
      const double elastic_N = tissue.stiffness_N_per_m * (sheet.z_m - device.used().at_m.z());
      felt.share_at_puncture.push_back((elastic_N + true_N) / tissue.threshold_N);
    }
    if (contact.phase != ContactPhase::kContact || contact.force_N == 0 ||
        result.row.device_read != DeviceStatus::kOk || std::abs(true_N) < kFelt_N) {
      continue;
    }
    const double rendered_N =
        result.row.wrench_wanted[2] - tissue.stiffness_N_per_m * contact.penetration_m;
    felt.error.push_back(std::abs(rendered_N - true_N) / std::abs(true_N));
  }
  return felt;
}

test::DelayedLinkOptions bad_link(std::uint64_t seed) {
  test::DelayedLinkOptions link;
  link.delay_max_s = 4e-3;
  link.loss = 0.05;
  link.seed = seed;
  return link;
}

TEST(LinkTime, DampingIsThatOfTheTrueMotionWithDelaysAndLosses) {
  for (const int counts : {0, 1'000'000}) {
    for (std::uint64_t seed = 1; seed <= 8; ++seed) {
      const FeltThroughLink felt = feel(pecking(), bad_link(seed), counts);
      EXPECT_EQ(felt.fault, Fault::kNone) << to_string(felt.fault);
      ASSERT_GT(felt.error.size(), 1000U);
      EXPECT_LE(p95(felt.error), kWithin) << "seed " << seed << ", " << counts << " counts";
      EXPECT_TRUE(felt.share_at_puncture.empty()) << "seed " << seed;
    }
  }
}

TEST(LinkTime, NoPunctureBelowTheThresholdWithDelaysAndLosses) {
  for (const int counts : {0, 20'000}) {
    std::size_t punctures = 0;
    for (std::uint64_t seed = 1; seed <= 12; ++seed) {
      const FeltThroughLink felt = feel(piercing(seed), bad_link(seed), counts);
      EXPECT_EQ(felt.fault, Fault::kNone) << to_string(felt.fault);
      punctures += felt.share_at_puncture.size();
      for (const double share : felt.share_at_puncture)
        EXPECT_GE(share, kMinShare) << "seed " << seed << ", " << counts << " counts";
    }
    EXPECT_GE(punctures, 50U);
  }
}

// A state after a pause of 2 ms is three ticks after the last one: three times the velocity, if
// that is not known, and more than the threshold.
TEST(LinkTime, AHostThatStopsBreaksNoSheet) {
  test::DelayedLinkOptions link;
  link.host_stop_s = 2e-3;
  link.ticks_between_stops = 137;
  const FeltThroughLink felt = feel(pecking(), link);
  EXPECT_EQ(felt.fault, Fault::kNone) << to_string(felt.fault);
  EXPECT_TRUE(felt.share_at_puncture.empty()) << "at a true share of " << felt.share_at_puncture[0];
  EXPECT_LE(p95(felt.error), kWithin);
}

TEST(LinkTime, ASessionOverABadLinkReplaysToTheLastBit) {
  const Scene scene = piercing(3);
  const FeltThroughLink felt = feel(scene, bad_link(3), 20'000);
  ReplayDevice recorded(felt.rows);
  FourLegs replay(description_with(20'000), recorded);
  const LoopModel model = loop_model(scene, 20'000);
  const Sheets sheets(scene);
  LoopState state;
  SheetLaw law = test::hooke_law(model);
  TickResult result;
  for (const RecordingRow& row : felt.rows) {
    TickInputs inputs;
    inputs.sheets = sheets.current;
    haptic_tick(model, inputs, replay, law, state, result);
    ASSERT_EQ(result.row.tau_Nm, row.tau_Nm) << row.t_s;
  }
}

}  // namespace
}  // namespace trocar::runtime
