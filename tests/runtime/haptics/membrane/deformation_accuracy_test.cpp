// SPDX-License-Identifier: Apache-2.0
// The error of a region's stiffness: against the exact one of an unbounded sheet, before and after
// calibration, and against that of a very fine mesh at rims and holes of real slices.
#include <gtest/gtest.h>

#include <cmath>

#include "runtime/haptics/membrane/network.h"
#include "runtime/haptics/membrane/sheet_law.h"
#include "tests/reference/deformation/region_part.h"
#include "tests/support/campaign.h"
#include "tests/support/deformation_fixture.h"
#include "tests/support/sheet_fixture.h"

namespace trocar::runtime {
namespace {

constexpr double kRadius_m = 0.003;
constexpr double kStiffness_N_per_m = 5000;

Ring hexagon(const Lattice& lattice, LatticePoint centre = {}, double turn = 0) {
  return test::regular_polygon(centre, kRadius_m / lattice.step_m(), 6, turn);
}

Result<Region> respond(const SheetMesh& sheet, const Ring& tool, const Lattice& lattice,
                       const Membrane& membrane, const ResponseOptions& options) {
  static RegionWorkspace workspace;  // for very fine meshes too: too large to make for each call
  return prepare_region(sheet, find_seeds(sheet, tool), tool, lattice, membrane, options,
                        workspace);
}

// Without calibration the stiffness converges to the exact solution of the polygon. At the tool's
// corners the slope is singular, r^(pi / omega - 1), with omega = 240 degrees outside a hexagon's
// corner, and a mesh of uniform size along the tool converges with the power 2 pi / omega = 1.5
// only. A polygon of 32 edges is nearly smooth, and the mesh converges with the power 2.
TEST(Accuracy, TheMeshTendsToTheExactSolution) {
  const Lattice fine{13};
  const double step_m = fine.step_m(), lambda_m = 0.008;
  const auto half = static_cast<std::int32_t>(0.1 / step_m);
  const auto sheet = make_sheet_mesh(
      {{{-half, -half}, {half, -half}, {half, half}, {-half, half}}, {{0, 1, 2}, {0, 2, 3}}}, 0, 0);
  ASSERT_TRUE(sheet);
  for (const int sides : {6, 32}) {
    const Ring tool = test::regular_polygon({}, kRadius_m / step_m, sides, 0.1);
    std::vector<Eigen::Vector2d> outline;
    for (LatticePoint p : tool)
      outline.push_back(Eigen::Vector2d(p.x, p.y) * step_m);
    const auto membrane =
        membrane_for_tool(kStiffness_N_per_m, lambda_m, outline, sides == 6 ? 30 : 6);
    ASSERT_TRUE(membrane);
    std::vector<double> errors;
    for (const double size : {0.4, 0.2, 0.1, 0.05}) {
      ResponseOptions options;
      options.error_bound = 0;
      options.region.grading = {true, size, size, 60000};
      const auto region = respond(*sheet, tool, fine, *membrane, options);
      ASSERT_TRUE(region);
      errors.push_back(region->response.stiffness_N_per_m / kStiffness_N_per_m - 1);
      EXPECT_EQ(region->response.negative_springs, 0U);
    }
    const double order = std::log2(errors.front() / errors.back()) / 3;
    EXPECT_GT(order, sides == 6 ? 1.3 : 1.7);
    EXPECT_LT(order, sides == 6 ? 1.9 : 2.3);
    EXPECT_GT(errors.back(), 0);
    EXPECT_LT(errors.back(), sides == 6 ? 8e-3 : 3e-3);
  }
}

// The default grading in a sheet of 8 mm triangles, which the calibration has not seen: within 1 %
// of K at any place and rotation, with about 200 free nodes.
TEST(Accuracy, AnUndamagedSheetFarFromAnyEdgeHasStiffnessK) {
  const Lattice lattice{8};
  const auto sheet = make_sheet_mesh(test::square_mesh({-102400, -102400}, 2048, 100), 0, 0);
  ASSERT_TRUE(sheet);
  for (const double lambda_m : {0.005, 0.008, 0.012, 0.02}) {
    const auto calibration = calibrate(kStiffness_N_per_m, lambda_m, hexagon(lattice), lattice);
    ASSERT_TRUE(calibration) << calibration.error().message;
    EXPECT_GT(calibration->excess, 0.02);
    EXPECT_LT(calibration->excess, 0.06);
    EXPECT_LT(calibration->spread, 0.004);
    std::mt19937_64 random(17);
    double worst = 0;
    for (int i = 0; i < test::campaign(40); ++i) {
      const LatticePoint centre{static_cast<std::int32_t>(4096 * test::uniform(random)),
                                static_cast<std::int32_t>(4096 * test::uniform(random))};
      const auto region = respond(*sheet, hexagon(lattice, centre, test::uniform(random)), lattice,
                                  calibration->membrane, {});
      ASSERT_TRUE(region);
      worst =
          std::max(worst, std::abs(region->response.stiffness_N_per_m / kStiffness_N_per_m - 1));
      EXPECT_NEAR(region->response.centre_steps.x(), centre.x, 0.02 * 768);
      EXPECT_NEAR(region->response.centre_steps.y(), centre.y, 0.02 * 768);
    }
    EXPECT_LT(worst, 0.01) << lambda_m;
  }
}

// A reach below the tool's size, other tools and lattices.
TEST(Accuracy, HoldsForOtherToolsReachesAndLattices) {
  for (const int bits : {6, 10}) {
    const Lattice lattice{bits};
    const double per_m = 1 / lattice.step_m();
    const auto cell = static_cast<std::int32_t>(0.008 * per_m);
    const auto sheet =
        make_sheet_mesh(test::square_mesh({-50 * cell, -50 * cell}, cell, 100), 0, 0);
    ASSERT_TRUE(sheet);
    Ring blade;  // 8 mm x 1 mm
    for (const auto& [x, y] : {std::pair(-4, -0.5), {4, -0.5}, {4, 0.5}, {-4, 0.5}}) {
      blade.push_back({static_cast<std::int32_t>(std::lround(x * 1e-3 * per_m)),
                       static_cast<std::int32_t>(std::lround(y * 1e-3 * per_m))});
    }
    for (const Ring& tool :
         {hexagon(lattice), blade, test::regular_polygon({}, 0.003 * per_m, 3)}) {
      for (const double lambda_m : {0.001, 0.003, 0.01}) {
        const auto calibration = calibrate(kStiffness_N_per_m, lambda_m, tool, lattice);
        ASSERT_TRUE(calibration);
        EXPECT_LT(calibration->spread, 0.02);
        Ring moved = tool;
        for (LatticePoint& p : moved) {
          p.x += cell / 3;
          p.y += cell / 5;
        }
        const auto region = respond(*sheet, moved, lattice, calibration->membrane, {});
        ASSERT_TRUE(region);
        EXPECT_NEAR(region->response.stiffness_N_per_m / kStiffness_N_per_m, 1, 0.02)
            << bits << " bits, " << tool.size() << " corners, lambda " << lambda_m << " excess "
            << calibration->excess;
      }
    }
  }
}

TEST(Accuracy, CalibrationRefusesInvalidArguments) {
  const Lattice lattice{8};
  const Ring tool = hexagon(lattice);
  EXPECT_FALSE(calibrate(0, 0.01, tool, lattice));
  EXPECT_FALSE(calibrate(std::nan(""), 0.01, tool, lattice));
  EXPECT_FALSE(calibrate(5000, 0, tool, lattice));
  EXPECT_FALSE(calibrate(5000, 1e9, tool, lattice));
  EXPECT_FALSE(calibrate(5000, 0.01, {}, lattice));
  const auto ungraded = calibrate(5000, 0.01, tool, lattice, {.graded = false});
  ASSERT_TRUE(ungraded);
  EXPECT_EQ(ungraded->excess, 0);
}

// Real slices, near rims and over holes: compared with a calibrated mesh of a fifth of the size. The
// largest error grows with the number of places, because the error has no bound in strips that are
// narrower than the tool and less than half as stiff as the sheet: of 3,000 places in L3 six have more
// than 10 %, the worst 31 %. It is the mesh's: it falls when the mesh gets finer. So the bound on the
// largest error is meant for 300 places, and that of a longer run is a percentile.
TEST(Accuracy, HoldsOnRealSlicesAgainstAVeryFineMesh) {
  const std::vector<test::ScanAsset> scans = test::scan_assets();
  if (scans.empty()) GTEST_SKIP() << "no assets: TROCAR_ASSETS names their folder";
  const Grading fine{true, 0.06, 0.2, 30000};
  for (const test::ScanAsset& scan : scans) {
    const Lattice lattice = scan.asset.lattice;
    for (const double lambda_m : {0.005, 0.02}) {
      const auto usual_membrane =
          calibrate(kStiffness_N_per_m, lambda_m, hexagon(lattice), lattice);
      const auto fine_membrane =
          calibrate(kStiffness_N_per_m, lambda_m, hexagon(lattice), lattice, fine);
      ASSERT_TRUE(usual_membrane && fine_membrane);
      std::mt19937_64 random(8);
      std::vector<double> errors;
      constexpr std::size_t kUsual = 300;
      for (int i = 0; i < test::campaign(kUsual); ++i) {
        const AssetSlice& slice = *scan.slices[random() % scan.slices.size()];
        const auto sheet = make_sheet_mesh(slice.mesh, 0, 0);
        ASSERT_TRUE(sheet);
        const Ring tool =
            hexagon(lattice, test::place_in(slice.mesh, random), test::uniform(random));
        ResponseOptions options;
        options.error_bound = 0;
        options.region.radius_m = 6 * lambda_m;
        const auto usual = respond(*sheet, tool, lattice, usual_membrane->membrane, options);
        options.region.grading = fine;
        const auto exact = respond(*sheet, tool, lattice, fine_membrane->membrane, options);
        ASSERT_TRUE(usual && exact);
        errors.push_back(
            std::abs(usual->response.stiffness_N_per_m / exact->response.stiffness_N_per_m - 1));
      }
      std::sort(errors.begin(), errors.end());
      EXPECT_LT(errors[errors.size() / 2], 0.015) << scan.name;
      EXPECT_LT(errors[errors.size() * 95 / 100], 0.03) << scan.name;
      EXPECT_LT(errors.size() <= kUsual ? errors.back() : errors[errors.size() * 995 / 1000], 0.1)
          << scan.name;
    }
  }
}

}  // namespace
}  // namespace trocar::runtime
