// SPDX-License-Identifier: Apache-2.0
// The force law `network` in a session: forces in the middle of a sheet, near a rim and after a
// puncture; the same in a second run and in a replay; no allocation and no lock on the haptic
// thread in a hundred punctures.
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <mutex>
#include <nlohmann/json.hpp>

#include "formats/session/recording.h"
#include "runtime/haptics/membrane/sheet_law.h"
#include "runtime/realtime/realtime_thread.h"
#include "runtime/session/session.h"
#include "runtime/session/session_publisher.h"
#include "tests/reference/hooks/lock_counter.h"
#include "tests/runtime/session/test_session.h"
#include "tests/support/counted_allocations.h"

namespace trocar::runtime {
namespace {

using testing_support::TestSession;

TEST(NetworkSession, EqualTissuesAreCalibratedOnce) {
  Scene scene = test::descent_scene({0.12}, 0.125, 0.125, 1);
  scene.force_law.kind = ForceLawKind::kNetwork;
  std::vector<Tissue> tissues(7);
  tissues[2].stiffness_N_per_m = tissues[5].stiffness_N_per_m = 3000;
  tissues[3].threshold_N = tissues[6].damping_N_s_per_m = 1;  // a membrane does not depend on them
  const auto prefetch = NetworkPrefetch::make(scene, tissues, Lattice{});
  ASSERT_TRUE(prefetch) << prefetch.error().message;
  EXPECT_EQ((*prefetch)->report().calibrations, 2U);
}

/// A press to 4 mm and back at each place of a 40 mm sheet at 0.12 m, x to the right.
Scene presses(const std::vector<double>& x_m, double depth_m) {
  Scene scene = test::descent_scene({0.12}, 0.125, 0.125, 1);
  scene.force_law.kind = ForceLawKind::kNetwork;
  scene.force_law.decay_length_m = 0.004;
  scene.hand.stiffness_N_per_m = 20000;
  scene.hand.damping_N_s_per_m = 200;
  scene.hand.trajectory = {{0, {x_m[0], 0, 0.124}, {}}};
  double t_s = 0;
  for (const double x : x_m) {
    const auto go = [&](double seconds, double z_m) {
      t_s += seconds;
      scene.hand.trajectory.push_back({t_s, {x, 0, z_m}, {}});
    };
    go(0.15, 0.124);
    go(0.2, 0.12 - depth_m);
    go(0.1, 0.12 - depth_m);
    go(0.15, 0.124);
  }
  scene.duration_s = t_s;
  return scene;
}

struct NetworkRun {
  SessionResult report;
  std::vector<RecordingRow> rows;
};

NetworkRun run(const Scene& scene, const std::function<void(SessionOptions&)>& change = {}) {
  TestSession session(scene);
  if (change) change(session.options);
  NetworkRun out{session.run(), session.rows()};
  EXPECT_EQ(out.report.fault, Fault::kNone) << to_string(out.report.fault);
  return out;
}

/// Force over penetration at the end of each press.
std::vector<double> felt_N_per_m(const std::vector<RecordingRow>& rows) {
  std::vector<double> out;
  for (std::size_t press = 0; press < rows.size() / 600; ++press) {
    const RecordingRow& row = rows[600 * press + 440];
    EXPECT_EQ(row.phase, ContactPhase::kContact);
    out.push_back(row.wrench_wanted[2] / row.penetration_m);
  }
  return out;
}

TEST(NetworkSession, HasTheTissuesStiffnessInTheMiddleAndLessNearARim) {
  const std::vector<double> felt = felt_N_per_m(run(presses({0, 0.012, 0.015, 0.017}, 0.004)).rows);
  ASSERT_EQ(felt.size(), 4U);
  EXPECT_NEAR(felt[0], 5000, 0.02 * 5000) << "20 mm from the rim, five times the reach";
  EXPECT_LT(felt[1], felt[0]);
  EXPECT_LT(felt[2], felt[1]);
  EXPECT_LT(felt[3], 0.97 * felt[0]) << "the tool touches the rim";
  EXPECT_GT(felt[3], 0.4 * felt[0]);
}

TEST(NetworkSession, TheForceIsSmoothWhileTheToolIsDraggedInContact) {
  // Dragged over 15 mm while pressed: new responses come into use all the time.
  Scene scene = presses({0}, 0.004);
  scene.hand.trajectory.resize(3);
  const double t_s = scene.hand.trajectory.back().t_s;
  scene.hand.trajectory.push_back({t_s + 1.5, {0.015, 0, 0.116}, {}});
  scene.duration_s = t_s + 1.5;
  const NetworkRun session = run(scene);
  const ForceLaw* const law = session.report.law.get();
  const auto summary = nlohmann::json::parse(law->summary().json);
  EXPECT_GT(summary["responses"].get<int>(), 100);
  EXPECT_EQ(summary["failures"].get<int>(), 0);
  EXPECT_LE(summary["force_error_bound_max"].get<double>(), scene.force_law.error_bound);
  EXPECT_LE(summary["displacement_error_bound_max"].get<double>(), scene.force_law.error_bound);
  double largest_N = 0;
  for (std::size_t k = 450; k < session.rows.size(); ++k) {
    ASSERT_EQ(session.rows[k].phase, ContactPhase::kContact);
    largest_N = std::max(largest_N, std::abs(session.rows[k].wrench_wanted[2] -
                                             session.rows[k - 1].wrench_wanted[2]));
  }
  EXPECT_LT(largest_N, 0.25) << "of 20 N";
}

TEST(NetworkSession, ASecondRunAndAReplayGiveTheSameTorques) {
  const Scene scene = presses({-0.006, 0.008, -0.004}, 0.0105);  // punctured; then beside the hole
  const NetworkRun once = run(scene);
  const NetworkRun twice = run(scene);
  EXPECT_GE(once.report.punctures.size(), 2U);
  ASSERT_EQ(once.rows.size(), twice.rows.size());
  for (std::size_t k = 0; k < once.rows.size(); ++k)
    ASSERT_EQ(once.rows[k].tau_Nm, twice.rows[k].tau_Nm) << k;
  EXPECT_TRUE(std::any_of(once.rows.begin(), once.rows.end(), [](const RecordingRow& row) {
    return row.response_sheet == 0 && row.response_stiffness_N_per_m < 4900;
  }));

  TestSession session(scene);
  session.options.record.reset();
  EXPECT_EQ(session.replay(once.rows).replay_first_difference, -1);
}

TEST(NetworkSession, LocalSolversAndPropagationAgreeWithTheGlobalSolver) {
  Scene scene = presses({0, 0.013}, 0.004);
  const auto felt = [&](NetworkSolver solver) {
    scene.force_law.solver = solver;
    return felt_N_per_m(run(scene).rows);
  };
  const std::vector<double> global = felt(NetworkSolver::kGlobal);
  scene.force_law.radius_m = 0.02;
  const std::vector<double> local = felt(NetworkSolver::kLocal);
  const std::vector<double> bounded = felt(NetworkSolver::kAuto);
  scene.force_law.depth = 12;
  const std::vector<double> deep = felt(NetworkSolver::kPropagation);
  scene.force_law.depth = 1;
  const std::vector<double> shallow = felt(NetworkSolver::kPropagation);
  for (std::size_t k = 0; k < 2; ++k) {
    EXPECT_NEAR(local[k], global[k], 0.01 * global[k]);
    EXPECT_NEAR(bounded[k], global[k], 0.01 * global[k]);
    // On the triangles of the sheet's mesh, which are coarser.
    EXPECT_NEAR(deep[k], global[k], 0.15 * global[k]);
    EXPECT_GT(shallow[k], deep[k]) << "held one ring of vertices around the tool";
  }
}

TEST(NetworkSession, FramesComeAtTheFrameRateWithTheSheetsShape) {
  const Scene scene = presses({0}, 0.004);
  int frames = 0;
  double deepest_m = 0;
  const auto on_frame = [&](const RecordingRow& row,
                            const std::shared_ptr<const SheetShape>& shape) {
    ++frames;
    if (shape == nullptr) return;
    const double depth_m = shape_depth_m(row, *shape);
    ASSERT_EQ(shape->w.size(), shape->vertices_m.size());
    std::vector<double> z_m;
    for (const double w : shape->w)
      z_m.push_back(shape->z_m - depth_m * w);
    const double lowest_m = *std::min_element(z_m.begin(), z_m.end());
    EXPECT_NEAR(lowest_m, 0.12 - depth_m, 1e-12)
        << "the sheet is as deep as the tool at its outline";
    EXPECT_LE(*std::max_element(z_m.begin(), z_m.end()), 0.12 + 1e-12);
    deepest_m = std::max(deepest_m, depth_m);
  };
  run(scene, [&](SessionOptions& options) { options.on_frame = on_frame; });
  EXPECT_NEAR(frames, 30 * scene.duration_s, 1.5);
  EXPECT_GT(deepest_m, 0.003);
}

class HundredPunctures : public testing::TestWithParam<Clock> {};
INSTANTIATE_TEST_SUITE_P(NetworkSession, HundredPunctures,
                         testing::Values(Clock::kVirtual, Clock::kReal));

TEST_P(HundredPunctures, NeedNoAllocationAndNoLock) {
  TROCAR_NEEDS_COUNTED_ALLOCATIONS();
  {
    std::mutex mutex;
    const std::uint64_t before = locks_in_scopes();
    const NoAllocationScope scope;
    mutex.lock();
    mutex.unlock();
    ASSERT_EQ(locks_in_scopes() - before, 1U) << "locks are counted";
  }
  Scene scene = test::descent_scene({0.12}, 0.125, 0.125, 1);
  scene.force_law.kind = ForceLawKind::kNetwork;
  scene.force_law.decay_length_m = 0.004;
  scene.tool.radius_m = 0.0015;
  scene.tissue.threshold_N = 5;
  scene.hand.stiffness_N_per_m = 20000;
  scene.hand.damping_N_s_per_m = 200;
  scene.hand.trajectory = {{0, {-0.016, -0.016, 0.122}, {}}};
  double t_s = 0;
  for (int i = 0; i < 100; ++i) {
    const int column = i % 10, row = i / 10;
    const double x_m = -0.016 + 0.0035 * column, y_m = -0.016 + 0.0035 * row;
    for (const auto& [seconds, z_m] : {std::pair{0.05, 0.122}, {0.03, 0.117}, {0.03, 0.122}}) {
      t_s += seconds;
      scene.hand.trajectory.push_back({t_s, {x_m, y_m, z_m}, {}});
    }
  }
  scene.duration_s = t_s;
  const std::uint64_t locks_before = locks_in_scopes();
  const NetworkRun session =
      run(scene, [](SessionOptions& options) { options.clock = GetParam(); });
  EXPECT_EQ(session.report.punctures.size(), 100U);
  ASSERT_TRUE(session.report.allocations_in_loop);
  EXPECT_EQ(*session.report.allocations_in_loop, 0U);
  EXPECT_EQ(locks_in_scopes() - locks_before, 0U);
}

}  // namespace
}  // namespace trocar::runtime
