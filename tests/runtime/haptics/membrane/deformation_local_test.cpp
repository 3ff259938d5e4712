// SPDX-License-Identifier: Apache-2.0
// The spring network against finite elements assembled triangle by triangle, dense factorisations, discs
// in closed form and the equilibrium of the whole network.
#include "runtime/haptics/membrane/network.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include "formats/mesh/mesh_validity.h"
#include "runtime/haptics/membrane/region.h"
#include "runtime/realtime/realtime_thread.h"
#include "tests/reference/decompositions/decompositions.h"
#include "tests/reference/deformation/disc.h"
#include "tests/reference/deformation/general_load.h"
#include "tests/reference/deformation/global_solver.h"
#include "tests/reference/deformation/network_checks.h"
#include "tests/support/counted_allocations.h"
#include "tests/support/deformation_fixture.h"
#include "tests/support/sheet_fixture.h"
#include "tests/support/test_lattice.h"

namespace trocar::runtime {
namespace {

using Eigen::Matrix3d, Eigen::MatrixXd, Eigen::Vector2d, Eigen::Vector3d;
using trocar::test::kLattice;
using trocar::test::kMembrane;

// The laws of runtime/haptics/membrane/network.h, compared with finite elements assembled triangle by
// triangle, and sparse_factor compared with dense factorisations.

void shake_mesh(SliceMesh& mesh, double most, std::mt19937_64& random) {
  for (LatticePoint& p : mesh.vertices) {
    p.x += static_cast<std::int32_t>(most * (2 * test::uniform(random) - 1));
    p.y += static_cast<std::int32_t>(most * (2 * test::uniform(random) - 1));
  }
}

/// A grid whose points are moved at random by up to `shake` of a cell.
SliceMesh shaken_square(std::uint64_t seed, double shake) {
  SliceMesh mesh = test::square_mesh({-1000, -700}, 256, 6);
  std::mt19937_64 random(seed);
  shake_mesh(mesh, 256 * shake, random);
  return mesh;
}

/// T times the integral of grad phi_i . grad phi_j over each triangle, assembled from the
/// gradients, without cotangents.
MatrixXd membrane_matrix(const SliceMesh& mesh) {
  const auto n = static_cast<Eigen::Index>(mesh.vertices.size());
  MatrixXd matrix = MatrixXd::Zero(n, n);
  for (const Triangle& t : mesh.triangles) {
    Matrix3d corners;  // rows 1, x, y
    for (int k = 0; k < 3; ++k) {
      const LatticePoint p = mesh.vertices[t[static_cast<std::size_t>(k)]];
      corners.col(k) = Vector3d(1, p.x, p.y);
    }
    const double area = corners.determinant() / 2;
    const Matrix3d shape = corners.inverse();  // row k: the coefficients of phi_k
    for (int a = 0; a < 3; ++a) {
      for (int b = 0; b < 3; ++b) {
        matrix(t[static_cast<std::size_t>(a)], t[static_cast<std::size_t>(b)]) +=
            kMembrane.tension_N_per_m * area * shape.row(a).tail<2>().dot(shape.row(b).tail<2>());
      }
    }
  }
  return matrix;
}

MatrixXd network_matrix(const Network& network, bool with_bed) {
  const auto n = static_cast<Eigen::Index>(network.size());
  MatrixXd matrix = MatrixXd::Zero(n, n);
  for (std::size_t i = 0; i < network.size(); ++i) {
    if (with_bed) matrix(i, i) += network.foundation_N_per_m[i];
    for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k) {
      matrix(i, i) += network.stiffness_N_per_m[k];
      matrix(i, network.neighbour[k]) -= network.stiffness_N_per_m[k];
    }
  }
  return matrix;
}

TEST(Network, IsTheMembraneOfLinearElements) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const SliceMesh mesh = shaken_square(seed, 0.24);
    ASSERT_TRUE(check_mesh(mesh)) << seed;
    const Network network = make_network(mesh, kLattice, kMembrane);
    const MatrixXd expected = membrane_matrix(mesh);
    const double scale = expected.cwiseAbs().maxCoeff();
    EXPECT_LT((network_matrix(network, false) - expected).cwiseAbs().maxCoeff(), 1e-12 * scale);
    double bed = 0;
    for (double f : network.foundation_N_per_m)
      bed += f;
    const double area_m2 =
        static_cast<double>(doubled_area(mesh)) / 2 * std::pow(kLattice.step_m(), 2);
    EXPECT_NEAR(bed / (kMembrane.foundation_N_per_m3 * area_m2), 1, 1e-13);
    for (std::size_t i = 0; i < network.size(); ++i) {
      EXPECT_TRUE(std::is_sorted(network.neighbour.begin() + network.first[i],
                                 network.neighbour.begin() + network.first[i + 1]));
    }
  }
}

// Law 3, compared with floating point, and where floating point cannot decide.
TEST(Network, SignsAreExact) {
  std::uint32_t negative = 0;
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    const SliceMesh mesh = shaken_square(seed, 0.24);
    const Network network = make_network(mesh, kLattice, kMembrane);
    std::uint32_t found = 0;
    for (std::size_t i = 0; i < network.size(); ++i) {
      for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k) {
        if (network.neighbour[k] > i && network.stiffness_N_per_m[k] < -1e-9) ++found;
      }
    }
    EXPECT_EQ(network.signs.negative(), found) << seed;
    EXPECT_EQ(spring_signs(mesh).negative_interior, network.signs.negative_interior);
    EXPECT_EQ(is_constrained_delaunay(mesh), network.signs.negative_interior == 0) << seed;
    negative += found;
  }
  EXPECT_GT(negative, 50U);

  // A right angle gives no negative spring, one step more does; far from the origin, in large
  // triangles.
  const std::int32_t far = kMaxCoordinate - 10;
  SliceMesh right{{{-far, -far}, {far, -far}, {-far, far}}, {{0, 1, 2}}};
  EXPECT_EQ(spring_signs(right).negative(), 0U);
  right.vertices[0] = {-far + 1, -far};
  EXPECT_EQ(spring_signs(right).negative_boundary, 1U);
  // Both diagonals of a square give 0; one step off, one of them is negative.
  SliceMesh square{{{0, 0}, {far, 0}, {far, far}, {0, far}}, {{0, 1, 2}, {0, 2, 3}}};
  EXPECT_EQ(spring_signs(square).negative(), 0U);
  square.vertices[1] = {far - 1, 1};
  EXPECT_EQ(spring_signs(square).negative_interior, 1U);
  square.vertices[1] = {far + 1, -1};
  EXPECT_EQ(spring_signs(square).negative_interior, 0U);
}

// Law 2 on meshes with many negative springs: all eigenvalues positive, both factorisations
// succeed.
TEST(Network, IsPositiveDefiniteForAnyAngles) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    SliceMesh mesh = shaken_square(seed, 0.24);
    for (LatticePoint& p : mesh.vertices)
      p.x *= 12;  // needles
    const Network network = make_network(mesh, kLattice, kMembrane);
    EXPECT_GT(network.signs.negative(), 20U);
    const MatrixXd springs = network_matrix(network, false), all = network_matrix(network, true);
    const double least_bed =
        *std::min_element(network.foundation_N_per_m.begin(), network.foundation_N_per_m.end());
    const Eigen::VectorXd of_springs = reference::eigenvalues(springs);
    EXPECT_GT(of_springs[0], -1e-12 * of_springs.tail<1>()[0]);
    EXPECT_GT(reference::eigenvalues(all)[0], 0.99 * least_bed);
    const std::vector<NodeKind> free(network.size(), NodeKind::kFree);
    SparseFactor factor;
    EXPECT_TRUE(factor.make(network, free));
    EXPECT_TRUE(solve_global(network, free));
  }
}

TEST(SparseFactor, AgreesWithADenseFactorisation) {
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    const Network network = make_network(shaken_square(seed, 0.24), kLattice, kMembrane);
    std::mt19937_64 random(seed);
    std::vector<NodeKind> kind(network.size());
    for (NodeKind& k : kind)
      k = random() % 4 == 0   ? NodeKind::kTool
          : random() % 4 == 0 ? NodeKind::kBorder
                              : NodeKind::kFree;
    SparseFactor factor;
    ASSERT_TRUE(factor.make(network, kind));
    const MatrixXd all = network_matrix(network, true);
    const auto n = static_cast<Eigen::Index>(factor.size());
    MatrixXd matrix(n, n);
    for (Eigen::Index a = 0; a < n; ++a) {
      EXPECT_EQ(kind[factor.nodes()[a]], NodeKind::kFree);
      for (Eigen::Index b = 0; b < n; ++b)
        matrix(a, b) = all(factor.nodes()[a], factor.nodes()[b]);
    }
    std::vector<double> x(factor.size());
    for (double& x_i : x)
      x_i = test::uniform(random);
    const Eigen::VectorXd expected =
        matrix.llt().solve(Eigen::Map<const Eigen::VectorXd>(x.data(), n));
    factor.solve(x);
    for (Eigen::Index a = 0; a < n; ++a)
      EXPECT_NEAR(x[a] / expected[a], 1, 1e-11);
  }
}

// A planar mesh in a good order has about n log n entries: here 8 for each of 225 unknowns; in the
// given order of the nodes there are 15.
TEST(SparseFactor, OrderKeepsItSparse) {
  const Network network = make_network(test::triangular_mesh({0, 0}, 256, 15), kLattice, kMembrane);
  SparseFactor factor;
  ASSERT_TRUE(factor.make(network, std::vector(network.size(), NodeKind::kFree)));
  EXPECT_LT(factor.entries(), 10 * factor.size());
}

TEST(SparseFactor, IsEmptyWithoutFreeNodes) {
  const Network network = make_network(shaken_square(0, 0), kLattice, kMembrane);
  SparseFactor factor;
  EXPECT_TRUE(factor.make(network, std::vector(network.size(), NodeKind::kTool)));
  EXPECT_EQ(factor.size(), 0U);
  factor.solve({});
  EXPECT_TRUE(factor.make(make_network({}, kLattice, kMembrane), {}));
}

TEST(SparseFactor, FailsIfTheMatrixIsNotDefinite) {
  Network network = make_network(shaken_square(0, 0.2), kLattice, kMembrane);
  for (double& f : network.foundation_N_per_m)
    f = -f;
  const std::vector<NodeKind> kind(network.size(), NodeKind::kFree);
  SparseFactor factor;
  EXPECT_FALSE(factor.make(network, kind));
  EXPECT_EQ(factor.size(), 0U);
  LocalSolution solution;
  EXPECT_FALSE(solve_local(network, kind, solution));
  EXPECT_FALSE(solve_global(network, kind));
}

// The laws of runtime/haptics/membrane/region.h: the errors caused by the ring, their decay with
// its radius, and the bounds on them.

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

// Random triangulations with a ring at a random place. Law 1 on all, laws 2 and 3 where no spring
// is negative.
TEST(Local, BoundsHoldOnRandomNetworks) {
  std::mt19937_64 random(11);
  int proved = 0, not_proved = 0;
  double tightest = 1e9;
  for (int i = 0; i < 400; ++i) {
    SliceMesh mesh = test::triangular_mesh({-4096, -3600}, 512, 17);
    const double shake = i % 2 == 0 ? 0.1 : 0.24;
    shake_mesh(mesh, 512 * shake, random);
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

// Force propagation (runtime/haptics/membrane/region.h) compared with the equilibrium.

struct Net {
  SliceMesh mesh = test::triangular_mesh({0, 0}, 256, 41);
  Network network;
  std::vector<NodeKind> kind;

  explicit Net(double shake = 0.15) {
    std::mt19937_64 random(3);
    shake_mesh(mesh, 256 * shake, random);
    network = make_network(mesh, kLattice, kMembrane);
    kind.assign(network.size(), NodeKind::kFree);
    for (std::size_t i = 0; i < kind.size(); ++i) {
      if (std::hypot(mesh.vertices[i].x - 5000, mesh.vertices[i].y - 4400) < 700)
        kind[i] = NodeKind::kTool;
    }
  }
};

double settle(const Net& net, const PropagationPlan& plan, PropagationState& state, int ticks) {
  double force = 0;
  for (int tick = 0; tick < ticks; ++tick)
    force = propagate(net.network, plan, 1, state);
  return force;
}

TEST(Propagation, ActivatesBreadthFirstDownToItsDepth) {
  const Net net;
  std::vector<int> depth(net.network.size(), 1000);
  for (std::size_t i = 0; i < depth.size(); ++i) {
    if (net.kind[i] == NodeKind::kTool) depth[i] = 0;
  }
  for (int round = 0; round < 60; ++round) {
    for (std::size_t i = 0; i < depth.size(); ++i) {
      for (std::uint32_t k = net.network.first[i]; k < net.network.first[i + 1]; ++k)
        depth[i] = std::min(depth[i], depth[net.network.neighbour[k]] + 1);
    }
  }
  for (const int wanted : {1, 3, 8, 200}) {
    const PropagationPlan plan = plan_propagation(net.network, net.kind, {.depth = wanted});
    EXPECT_TRUE(
        std::is_sorted(plan.active.begin(), plan.active.end(),
                       [&](std::uint32_t a, std::uint32_t b) { return depth[a] < depth[b]; }));
    const auto expected =
        std::count_if(depth.begin(), depth.end(), [&](int d) { return d >= 1 && d <= wanted; });
    EXPECT_EQ(plan.active.size(), static_cast<std::size_t>(expected));
    EXPECT_EQ(std::set<std::uint32_t>(plan.active.begin(), plan.active.end()).size(),
              plan.active.size());
  }
}

// The state at rest is the equilibrium with all deeper nodes held at 0.
TEST(Propagation, SettlesAtTheDepthLimitedEquilibrium) {
  const Net net;
  for (const int depth : {1, 4, 9}) {
    for (const double damping : /* the first is taken as the least */ {0.1, 0.6, 0.7, 1.0}) {
      const PropagationPlan plan = plan_propagation(
          net.network, net.kind, {.depth = depth, .sweeps = 4, .damping = damping});
      std::vector<NodeKind> limited(net.kind.size(), NodeKind::kBorder);
      for (std::uint32_t i : plan.active)
        limited[i] = NodeKind::kFree;
      for (std::uint32_t i : plan.tool)
        limited[i] = NodeKind::kTool;
      LocalSolution expected;
      ASSERT_TRUE(solve_local(net.network, limited, expected));
      PropagationState state = make_propagation_state(net.network, plan);
      const double force = settle(net, plan, state, 400);
      EXPECT_NEAR(force / expected.stiffness_N_per_m, 1, 1e-9) << depth << ", " << damping;
      for (std::size_t i = 0; i < state.w_m.size(); ++i)
        EXPECT_NEAR(state.w_m[i], expected.w[i], 1e-9);
      // Linear: half as deep, half the force.
      for (int tick = 0; tick < 400; ++tick)
        propagate(net.network, plan, 0.5, state);
      EXPECT_NEAR(propagate(net.network, plan, 0.5, state) / force, 0.5, 1e-9);
    }
  }
}

TEST(Propagation, WithoutAToolNothingMoves) {
  const Net net;
  const std::vector<NodeKind> free(net.kind.size(), NodeKind::kFree);
  const PropagationPlan plan = plan_propagation(net.network, free, {});
  EXPECT_TRUE(plan.active.empty());
  PropagationState state = make_propagation_state(net.network, plan);
  EXPECT_EQ(propagate(net.network, plan, 1, state), 0);
}

// The noexcept functions of runtime/deformation do not allocate: a solve, a tick of propagation.

TEST(DeformationSolve, DoesNotAllocate) {
  TROCAR_NEEDS_COUNTED_ALLOCATIONS();
  const Network network =
      make_network(test::triangular_mesh({0, 0}, 256, 20), Lattice{8}, {320, 5e6});
  std::vector<NodeKind> kind(network.size(), NodeKind::kFree);
  kind[190] = kind[191] = NodeKind::kTool;
  kind[0] = NodeKind::kBorder;
  LocalSolution solution;
  ASSERT_TRUE(solve_local(network, kind, solution));
  std::vector<double> x(solution.factor.size(), 1), held(network.size(), 1e-3),
      force(network.size(), 0), w(network.size());
  const PropagationPlan plan = plan_propagation(network, kind, {});
  PropagationState state = make_propagation_state(network, plan);
  const std::uint64_t before = allocations_in_scopes();
  {
    const NoAllocationScope scope;
    solution.factor.solve(x);
    solve_general(network, kind, solution.factor, held, force, x, w);
    propagate(network, plan, 1e-3, state);
  }
  EXPECT_EQ(allocations_in_scopes() - before, 0U);
  EXPECT_GT(w[180], 0);
}

}  // namespace
}  // namespace trocar::runtime
