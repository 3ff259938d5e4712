// SPDX-License-Identifier: Apache-2.0
// The paper's two experiments on a synthetic sheet in virtual time, checked from the recording
// alone: force zero until contact, linear to 35 N, zero from the puncture on.
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "formats/mesh/mesh_validity.h"
#include "formats/session/recording.h"
#include "runtime/report/session_report.h"
#include "runtime/session/session.h"
#include "runtime/session/session_options.h"
#include "tests/runtime/session/test_session.h"
#include "tests/support/check_sheet_mesh.h"

namespace trocar::runtime {
namespace {

constexpr double kStiffness_N_per_m = 5000, kThreshold_N = 35;
constexpr double kPuncture_m = kThreshold_N / kStiffness_N_per_m;

using testing_support::TestSession;

/// A session of a scene at a rate, which is run.
struct Experiment : TestSession {
  Experiment(const Scene& of, double rate_Hz)
      : TestSession(of, static_cast<int>(of.slices.size())) {
    options.rate_Hz = rate_Hz;
    report = run();
  }
  SessionResult report;
};

Scene one_slice() {
  return test::descent_scene({0.12}, 0.148, 0.1, 0.015);
}
Scene three_slices() {
  Scene scene = test::descent_scene({0.19, 0.14, 0.10}, 0.202, 0.088, 0.0175);
  scene.hand.stiffness_N_per_m = 8000;
  scene.hand.damping_N_s_per_m = 140;
  return scene;
}

/// Checks every row against the force law, for sheets that the whole tool outline is over.
void expect_paper_force(const std::vector<RecordingRow>& rows, std::vector<double> heights_m,
                        const std::vector<int>& slices) {
  std::size_t next = 0;  // the next sheet
  double peak_N = 0;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const RecordingRow& row = rows[k];
    const double tip_z_m = row.tool_m[2];
    const double travel_m = k > 0 ? std::abs(tip_z_m - rows[k - 1].tool_m[2]) : 0;
    const double force_N = row.wrench_wanted[2];
    const double dx_m = next < heights_m.size() ? heights_m[next] - tip_z_m : -1;
    ASSERT_EQ(row.fault, Fault::kNone) << "row " << k;
    // The delivered wrench is the wanted one.
    for (int i = 0; i < 6; ++i)
      ASSERT_NEAR(row.wrench_delivered[i], row.wrench_wanted[i], 1e-9 * 35);
    if (dx_m <= 0) {
      ASSERT_EQ(force_N, 0) << "above or between slices, row " << k;
      ASSERT_EQ(row.penetration_m, 0);
      continue;
    }
    ASSERT_EQ(row.active_slice, slices[next]);
    ASSERT_NEAR(row.penetration_m, dx_m, 1e-15);
    if (row.phase == ContactPhase::kContact) {
      ASSERT_NEAR(force_N, kStiffness_N_per_m * dx_m, 1e-9) << "linear, row " << k;
      ASSERT_LE(force_N, kThreshold_N);
      peak_N = std::max(peak_N, force_N);
      continue;
    }
    // Punctured in the tick in which the threshold would be exceeded, not before.
    ASSERT_EQ(row.phase, ContactPhase::kPunctured) << "row " << k;
    ASSERT_EQ(force_N, 0);
    ASSERT_GT(dx_m, kPuncture_m);
    ASSERT_LE(dx_m, kPuncture_m + travel_m);
    ASSERT_GT(rows[k - 1].penetration_m, kPuncture_m - travel_m);
    ASSERT_GT(peak_N, kThreshold_N - kStiffness_N_per_m * travel_m);
    peak_N = 0;
    ++next;
  }
  EXPECT_EQ(next, heights_m.size()) << "every slice has been punctured";
}

class Rates : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Paper, Rates, testing::Values(500.0, 1000.0),
                         [](const auto& rate) { return std::to_string(int(rate.param)) + "Hz"; });

TEST_P(Rates, OneSliceGivesOnePeak) {
  const Experiment run(one_slice(), GetParam());
  expect_paper_force(run.rows(), {0.12}, {0});
  ASSERT_EQ(run.report.punctures.size(), 1U);
  EXPECT_NEAR(run.report.punctures[0].tip_N, 35, 0.2);
  EXPECT_NEAR(run.report.punctures[0].tool_z_m, 0.113, 5e-5);
  EXPECT_LT(run.report.wrench_error_max, 1e-9);
  EXPECT_EQ(run.report.scaled_ticks, 0U);
}

TEST_P(Rates, ThreeSlicesGiveThreePeaksAtTheirHeights) {
  const Experiment run(three_slices(), GetParam());
  expect_paper_force(run.rows(), {0.19, 0.14, 0.10}, {0, 1, 2});
  ASSERT_EQ(run.report.punctures.size(), 3U);
  EXPECT_LT(run.report.wrench_error_max, 1e-9);
}

TEST_P(Rates, VirtualTimeIsReproducibleAndAReplayGivesTheTorquesBitForBit) {
  Experiment run(three_slices(), GetParam());
  const Experiment same(three_slices(), GetParam());
  const std::string recording = run.recording();
  EXPECT_GT(recording.size(), 100'000U);
  EXPECT_TRUE(recording == same.recording());
  const std::vector<RecordingRow> rows = run.rows();
  const auto rate_Hz = recorded_rate_Hz(rows, "r.csv");
  ASSERT_TRUE(rate_Hz);
  EXPECT_EQ(*rate_Hz, GetParam());

  run.options.record = run.folder / "again.csv";
  const SessionResult report = run.replay(rows);
  EXPECT_EQ(report.ticks, rows.size());
  EXPECT_EQ(report.replay_first_difference, -1);
  EXPECT_TRUE(recording == run.recording());

  // One different bit is detected.
  std::vector<RecordingRow> other = rows;
  other[1234].tau_Nm[3] = std::nextafter(other[1234].tau_Nm[3], 10.0);
  run.options.record.reset();
  EXPECT_EQ(run.replay(other).replay_first_difference, 1234);
}

TEST_P(Rates, PuncturedSheetsAreValidAndLackExactlyTheHole) {
  const Experiment run(three_slices(), GetParam());
  ASSERT_EQ(run.remesher->records().size(), 3U);
  for (const CutRecord& record : run.remesher->records()) {
    ASSERT_FALSE(record.error) << record.error->message;
    const SliceMesh before = to_slice_mesh(run.remesher->first_version(record.request.sheet).mesh);
    const Sheet& last = run.remesher->last_version(record.request.sheet);
    const SliceMesh after = to_slice_mesh(last.mesh);
    const auto valid = check_sheet_mesh(last.mesh);
    EXPECT_TRUE(valid) << valid.error().message;
    EXPECT_EQ(last.cuts, 1U);
    const std::int64_t hexagon = doubled_area(to_ring(record.request.outline));
    EXPECT_GT(hexagon, 0);
    EXPECT_EQ(record.cut.doubled_area_removed, hexagon);
    EXPECT_EQ(doubled_area(before) - doubled_area(after), hexagon);
    // The boundary is the sheet's own and the tool's outline.
    EXPECT_EQ(boundary_rings(after).rings.size(), 2U);
  }
  // The new meshes came into use during the session.
  EXPECT_EQ(run.rows().back().cuts_published, 3);
}

}  // namespace
}  // namespace trocar::runtime
