// SPDX-License-Identifier: Apache-2.0
// The laws of runtime/haptics/membrane/region.h: the errors caused by the ring, their decay with
// its radius, and the bounds on them.
#include "runtime/haptics/membrane/region.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/reference/deformation/disc.h"
#include "tests/reference/deformation/general_load.h"
#include "tests/reference/deformation/global_solver.h"
#include "tests/reference/deformation/network_checks.h"
#include "tests/support/deformation_fixture.h"
#include "tests/support/sheet_fixture.h"

namespace trocar::runtime {
namespace {

const Lattice kFine{12};

/// A disc of 3 mm in a sheet of 150 mm, with a ring at each of the mesh's circles.
struct Rings {
  int sides = 48, rings = 40;
  double inner_mm = 3, outer_mm = 150;
  double lambda_mm = 8;
  Membrane membrane = membrane_for_disc(5000, lambda_mm * 1e-3, inner_mm * 1e-3);
  SliceMesh mesh =
      test::polar_mesh(inner_mm / kFine.step_mm(), outer_mm / kFine.step_mm(), sides, rings);
  Network network = make_network(mesh, kFine, membrane);

  double radius_mm(int ring) const {
    return inner_mm * std::pow(outer_mm / inner_mm, static_cast<double>(ring) / rings);
  }
  /// Free between the tool and circle `ring`.
  std::vector<NodeKind> kind(int ring) const {
    std::vector<NodeKind> out(network.size(), NodeKind::kBorder);
    std::fill(out.begin(), out.begin() + ring * sides, NodeKind::kFree);
    std::fill(out.begin(), out.begin() + sides, NodeKind::kTool);
    return out;
  }
  std::vector<NodeKind> whole() const {
    std::vector<NodeKind> out(network.size(), NodeKind::kFree);
    std::fill(out.begin(), out.begin() + sides, NodeKind::kTool);
    return out;
  }
};

double largest_difference(const std::vector<double>& a, const std::vector<double>& b) {
  double most = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    most = std::max(most, std::abs(a[i] - b[i]));
  return most;
}

/// Least squares: the slope of y over x.
double slope(const std::vector<double>& x, const std::vector<double>& y) {
  double sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    sx += x[i];
    sy += y[i];
    sxx += x[i] * x[i];
    sxy += x[i] * y[i];
  }
  const auto n = static_cast<double>(x.size());
  return (n * sxy - sx * sy) / (n * sxx - sx * sx);
}

TEST(Local, WithoutARingIsTheGlobalSolution) {
  const Rings r;
  LocalSolution local;
  ASSERT_TRUE(solve_local(r.network, r.whole(), local));
  const auto global = solve_global(r.network, r.whole());
  ASSERT_TRUE(global);
  EXPECT_NEAR(local.stiffness_N_per_m / global->stiffness_N_per_m, 1, 1e-10);
  EXPECT_LT(largest_difference(local.w, global->w), 1e-10);
  EXPECT_EQ(local.bounds.force, 0);
  EXPECT_EQ(local.bounds.displacement, 0);
  // The reaction is twice the energy.
  EXPECT_NEAR(2 * energy_J(r.network, local.w) / local.stiffness_N_per_m, 1, 1e-10);
}

// w decays as K0(r / lambda), about exp(-r / lambda), and the displacement error at the ring is w
// there. The force error is K0(R / lambda) / I0(R / lambda), about exp(-2 R / lambda): from the
// tool to the ring and back. Both are compared with the annulus in closed form, and as slopes.
TEST(Local, ErrorFallsExponentiallyWithTheRadius) {
  for (const double lambda_mm : {5.0, 8.0, 12.0}) {
    Rings r;
    r.lambda_mm = lambda_mm;
    r.membrane = membrane_for_disc(5000, lambda_mm * 1e-3, r.inner_mm * 1e-3);
    r.network = make_network(r.mesh, kFine, r.membrane);
    const auto global = solve_global(r.network, r.whole());
    ASSERT_TRUE(global);
    std::vector<double> x, force, displacement;
    for (int ring = 1; ring < r.rings; ++ring) {
      const double radius = r.radius_mm(ring) / lambda_mm;
      if (radius < 2 || radius > 7) continue;
      LocalSolution local;
      ASSERT_TRUE(solve_local(r.network, r.kind(ring), local));
      const double force_error = local.stiffness_N_per_m / global->stiffness_N_per_m - 1;
      const double displacement_error = largest_difference(local.w, global->w);
      x.push_back(radius);
      force.push_back(std::log(force_error));
      displacement.push_back(std::log(displacement_error));
      // v = A K0 + B I0 with v(a) = 1, v(R) = 0.
      const double a = r.inner_mm / lambda_mm;
      const double ratio = std::cyl_bessel_k(0.0, radius) / std::cyl_bessel_i(0.0, radius);
      const double shape = 1 / (std::cyl_bessel_k(0.0, a) - ratio * std::cyl_bessel_i(0.0, a));
      const double edge = shape * (std::cyl_bessel_k(1.0, a) + ratio * std::cyl_bessel_i(1.0, a));
      const double free_edge = std::cyl_bessel_k(1.0, a) / std::cyl_bessel_k(0.0, a);
      EXPECT_NEAR(force_error / (edge / free_edge - 1), 1, 0.1) << lambda_mm << ", " << radius;
      EXPECT_NEAR(displacement_error / (std::cyl_bessel_k(0.0, radius) / std::cyl_bessel_k(0.0, a)),
                  1, 0.1)
          << lambda_mm << ", " << radius;
      // The bounds.
      EXPECT_TRUE(local.bounds.proved);
      EXPECT_GE(local.bounds.force, force_error / (1 + force_error));
      EXPECT_GE(local.bounds.displacement, displacement_error);
      EXPECT_LT(local.bounds.force, 6 * force_error);
      EXPECT_LT(local.bounds.displacement, 3 * displacement_error);
    }
    ASSERT_GT(x.size(), 10U);
    EXPECT_NEAR(slope(x, force), -2, 0.1) << lambda_mm;
    EXPECT_NEAR(slope(x, displacement), -1.12, 0.06) << lambda_mm;  // -1 - lambda / 2 R on average
    printf("lambda %g mm: ln(force error) falls %.3f, ln(displacement error) %.3f per lambda\n",
           lambda_mm, -slope(x, force), -slope(x, displacement));
  }
}

// Random triangulations with a ring at a random place. Law 1 on all, laws 2 and 3 where no spring
// is negative.
TEST(Local, BoundsHoldOnRandomNetworks) {
  std::mt19937_64 random(11);
  int proved = 0, not_proved = 0;
  double tightest = 1e9;
  for (int i = 0; i < 400; ++i) {
    SliceMesh mesh = test::triangular_mesh({-4096, -3600}, 512, 17);
    const double shake = i % 2 == 0 ? 0.1 : 0.24;
    for (LatticePoint& p : mesh.vertices) {
      p.x += static_cast<std::int32_t>(512 * shake * (2 * test::uniform(random) - 1));
      p.y += static_cast<std::int32_t>(512 * shake * (2 * test::uniform(random) - 1));
    }
    const double lambda_m = 2e-3 * std::exp(2.5 * test::uniform(random));
    const Membrane membrane{5e6 * lambda_m * lambda_m, 5e6};
    const double radius = 1200 + 2600 * test::uniform(random);
    const double x = 3000 * (2 * test::uniform(random) - 1),
                 y = 3000 * (2 * test::uniform(random) - 1);
    // The region: whole triangles, as a separate mesh.
    const auto distance = [&](std::uint32_t v) {
      return std::hypot(mesh.vertices[v].x - x, mesh.vertices[v].y - y);
    };
    SliceMesh inside;
    inside.vertices = mesh.vertices;
    std::vector<std::uint8_t> out_too(mesh.vertices.size(), 0);
    for (const Triangle& t : mesh.triangles) {
      if (std::min({distance(t[0]), distance(t[1]), distance(t[2])}) < radius) {
        inside.triangles.push_back(t);
      } else {
        for (std::uint32_t v : t)
          out_too[v] = 1;
      }
    }
    const Network whole = make_network(mesh, kFine, membrane),
                  part = make_network(inside, kFine, membrane);
    std::vector<NodeKind> global_kind(mesh.vertices.size(), NodeKind::kFree), kind = global_kind;
    for (std::uint32_t v = 0; v < mesh.vertices.size(); ++v) {
      if (out_too[v] != 0 || part.foundation_N_per_m[v] == 0) kind[v] = NodeKind::kBorder;
      if (distance(v) < 800) kind[v] = global_kind[v] = NodeKind::kTool;
    }
    const auto global = solve_global(whole, global_kind);
    LocalSolution local;
    ASSERT_TRUE(global);
    ASSERT_TRUE(solve_local(part, kind, local));
    const double rounding = 1e-9;
    const double force = 1 - global->stiffness_N_per_m / local.stiffness_N_per_m;
    EXPECT_GE(force, -rounding) << i;
    EXPECT_LE(force, local.bounds.force + rounding) << i;
    EXPECT_EQ(local.bounds.proved, negative_at_free_nodes(part, kind) == 0);
    if (whole.signs.negative() != 0) {
      ++not_proved;
      continue;
    }
    ++proved;
    double displacement = 0;
    for (std::size_t v = 0; v < kind.size(); ++v) {
      EXPECT_GE(global->w[v], local.w[v] - rounding);
      displacement = std::max(displacement, global->w[v] - local.w[v]);
    }
    EXPECT_LE(displacement, local.bounds.displacement + rounding) << i;
    if (displacement > 1e-6)
      tightest = std::min(tightest, local.bounds.displacement / displacement);
  }
  EXPECT_GT(proved, 80);
  EXPECT_GT(not_proved, 80);
  EXPECT_LT(tightest, 2.5);  // the bounds are not trivially wide
}

TEST(Local, SolvesForAnyLoadAndHeldDisplacements) {
  const Rings r;
  const std::vector<NodeKind> kind = r.kind(15);
  SparseFactor factor;
  ASSERT_TRUE(factor.make(r.network, kind));
  std::mt19937_64 random(2);
  std::vector<double> held(r.network.size()), force(r.network.size()), w(r.network.size()),
      work(factor.size());
  for (std::size_t i = 0; i < held.size(); ++i) {
    held[i] = 1e-3 * test::uniform(random);
    force[i] = test::uniform(random) - 0.5;
  }
  solve_general(r.network, kind, factor, held, force, work, w);
  for (std::size_t i = 0; i < w.size(); ++i) {
    if (kind[i] == NodeKind::kFree) {
      EXPECT_NEAR(reaction_N(r.network, w, i), force[i], 1e-9);
    } else {
      EXPECT_EQ(w[i], held[i]);
    }
  }
}

}  // namespace
}  // namespace trocar::runtime
