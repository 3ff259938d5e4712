// SPDX-License-Identifier: Apache-2.0
// The network under a fine polygon in a large sheet converges to the exact disc with the
// theoretical order.
#include <gtest/gtest.h>

#include <cmath>

#include "formats/mesh/mesh_validity.h"
#include "runtime/haptics/membrane/region.h"
#include "tests/reference/deformation/disc.h"
#include "tests/reference/deformation/global_solver.h"
#include "tests/support/deformation_fixture.h"

namespace trocar::runtime {
namespace {

const Lattice kVeryFine{14};  // rounding error far below the discretisation error
constexpr double kRadius_mm = 3;
constexpr double kFar_mm = 200;

struct Solved {
  double error = 0;        ///< error of the stiffness relative to the disc's
  double shape_error = 0;  ///< largest of w, in depths
};

Solved solve_polar(double lambda_mm, int sides) {
  const Membrane membrane = membrane_for_disc(5000, lambda_mm * 1e-3, kRadius_mm * 1e-3);
  const double step_per_mm = 1 / kVeryFine.step_mm();
  // Rings of nearly equilateral triangles.
  const int rings = static_cast<int>(std::lround(sides * std::log(kFar_mm / kRadius_mm) /
                                                 (2 * std::numbers::pi) * 2 / std::sqrt(3)));
  const SliceMesh mesh =
      test::polar_mesh(kRadius_mm * step_per_mm, kFar_mm * step_per_mm, sides, rings);
  EXPECT_TRUE(check_mesh(mesh));
  const Network network = make_network(mesh, kVeryFine, membrane);
  EXPECT_EQ(network.signs.negative(), 0U);
  std::vector<NodeKind> kind(network.size(), NodeKind::kFree);
  std::fill(kind.begin(), kind.begin() + sides, NodeKind::kTool);
  const auto solution = solve_global(network, kind);
  EXPECT_TRUE(solution);
  const double under_tool_m2 =
      0.5 * sides * std::sin(2 * std::numbers::pi / sides) * std::pow(kRadius_mm * 1e-3, 2);
  Solved out;
  out.error =
      (solution->stiffness_N_per_m + membrane.foundation_N_per_m3 * under_tool_m2) / 5000 - 1;
  for (std::size_t i = 0; i < network.size(); ++i) {
    const double r_m = std::hypot(mesh.vertices[i].x, mesh.vertices[i].y) * kVeryFine.step_m();
    const double exact =
        r_m <= kRadius_mm * 1e-3 ? 1 : disc_shape(membrane, kRadius_mm * 1e-3, r_m);
    out.shape_error = std::max(out.shape_error, std::abs(solution->w[i] - exact));
  }
  return out;
}

// Linear elements: the energy, and so the stiffness, converges with the square of the mesh size;
// so does the polygon to the disc. Halving the size divides the error by four.
TEST(Convergence, StiffnessTendsToTheDiscWithTheSquareOfTheMeshSize) {
  for (const double lambda_mm : {5.0, 8.0, 20.0}) {
    double last = 0, last_shape = 0;
    for (const int sides : {12, 24, 48, 96}) {
      const Solved now = solve_polar(lambda_mm, sides);
      printf("lambda %g mm, %d sides: stiffness %.3e shape %.3e order %.2f %.2f\n", lambda_mm,
             sides, now.error, now.shape_error, std::log2(last / now.error),
             std::log2(last_shape / now.shape_error));
      if (last != 0) {
        EXPECT_GT(std::log2(last / now.error), 1.7) << lambda_mm << " mm, " << sides;
        EXPECT_LT(std::log2(last / now.error), 2.3) << lambda_mm << " mm, " << sides;
      }
      last = now.error;
      last_shape = now.shape_error;
    }
    EXPECT_LT(std::abs(last), 2e-3);
    EXPECT_LT(last_shape, 2e-3);
  }
}

}  // namespace
}  // namespace trocar::runtime
