// SPDX-License-Identifier: Apache-2.0
// The laws of runtime/haptics/membrane/network.h, compared with finite elements assembled triangle by
// triangle, and sparse_factor compared with dense factorisations.
#include "runtime/haptics/membrane/network.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>

#include "formats/mesh/mesh_validity.h"
#include "runtime/haptics/membrane/region.h"
#include "tests/reference/decompositions/decompositions.h"
#include "tests/reference/deformation/global_solver.h"
#include "tests/reference/deformation/network_checks.h"
#include "tests/support/deformation_fixture.h"
#include "tests/support/sheet_fixture.h"
#include "tests/support/test_lattice.h"

namespace trocar::runtime {
namespace {

using Eigen::Matrix3d, Eigen::MatrixXd, Eigen::Vector2d, Eigen::Vector3d;

using trocar::test::kLattice;
using trocar::test::kMembrane;

/// A grid whose points are moved at random by up to `shake` of a cell.
SliceMesh shaken_square(std::uint64_t seed, double shake) {
  SliceMesh mesh = test::square_mesh({-1000, -700}, 256, 6);
  std::mt19937_64 random(seed);
  for (LatticePoint& p : mesh.vertices) {
    p.x += static_cast<std::int32_t>(256 * shake * (2 * test::uniform(random) - 1));
    p.y += static_cast<std::int32_t>(256 * shake * (2 * test::uniform(random) - 1));
  }
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

TEST(Network, ReactionIsTheGradientOfTheEnergy) {
  const Network network = make_network(shaken_square(7, 0.24), kLattice, kMembrane);
  std::mt19937_64 random(1);
  std::vector<double> w(network.size());
  for (double& w_i : w)
    w_i = 1e-3 * test::uniform(random);
  Eigen::Map<const Eigen::VectorXd> v(w.data(), static_cast<Eigen::Index>(w.size()));
  const MatrixXd matrix = network_matrix(network, true);
  EXPECT_NEAR(energy_J(network, w) / (0.5 * v.dot(matrix * v)), 1, 1e-12);
  const Eigen::VectorXd force = matrix * v;
  for (std::size_t i = 0; i < w.size(); ++i)
    EXPECT_NEAR(reaction_N(network, w, i), force[static_cast<Eigen::Index>(i)], 1e-12);
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

}  // namespace
}  // namespace trocar::runtime
