// SPDX-License-Identifier: Apache-2.0
// The coverage that the law `cutting` computes from the outline's distance and the holes, against that of the mesh.
#include <gtest/gtest.h>

#include <numbers>

#include "runtime/haptics/sheet.h"
#include "tests/runtime/haptics/bone/dry_run.h"
#include "tests/support/body_fixture.h"
#include "tests/support/random_geometry.h"

namespace trocar::runtime {
namespace {

using test::cutting_scene;
using test::square_asset;

// cut_in_place() moves edges by less than sqrt(2) lattice steps where a hole crosses the boundary of another hole.
constexpr double kBent = std::numbers::sqrt2 / 256e3 * test::kHexagonOutline_m / test::kHexagon_m2;

// Holes anywhere, near the edge (at 20 mm) and far from it, up to more than the law remembers; some are in the mesh
// and some are not yet.
TEST(CoverageContact, TheShareIsThatOfTheMeshAndThePendingHoles) {
  Random random(21);
  int partial = 0, checked = 0;
  for (int trial_number = 0; trial_number < 30; ++trial_number) {
    DryRun trial(cutting_scene({0.12}), square_asset(1));
    for (int hole = 0; hole < 7; ++hole) {
      const double x_m = 1e-3 * random.between(hole % 2 == 0 ? 5 : 12, hole % 2 == 0 ? 13 : 22);
      trial.move(x_m, 0.121, x_m, 0.117);
      trial.move(x_m, 0.117, x_m, 0.121);
      if (random.between(0, 1) == 0 || trial.tracks_.tracks[0].pending_count == kMaxPendingHoles)
        trial.publish();
      for (int k = 0; k < 20; ++k) {
        const double at_m = 5e-3 + 18e-3 * random.unit();
        trial.tick(at_m, 0.1205);
        Pose T;
        T.p_m = {at_m, 0, 0.1205};
        const SheetTrack& track = trial.tracks_.tracks[0];
        const Sheet& sheet = *trial.placed_.sheets[0];
        const double wanted =
            overlap(sheet, trial.bone_.tool,
                    outline_on_lattice(trial.bone_.tool, T, sheet.transform, sheet.z_m),
                    {track.pending.data(), static_cast<std::size_t>(track.pending_count)})
                .coverage;
        ASSERT_NEAR(trial.state_.sheets[0].share, wanted, kBent) << at_m << ", hole " << hole;
        partial += wanted > 0 && wanted < 1 ? 1 : 0;
        ++checked;
      }
    }
  }
  EXPECT_GT(partial, checked / 10);
}

}  // namespace
}  // namespace trocar::runtime
