// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/symmetric_eigenvalues.h"

#include <gtest/gtest.h>

#include <limits>

namespace trocar::runtime {
namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;

// A reflection H = 1 - 2 v v^T / v^T v is orthogonal, so the eigenvalues of H D H are the diagonal
// of D.
TEST(SymmetricEigenvalues, AreThoseOfAReflectedDiagonal) {
  Vector6 eigenvalues, v;
  eigenvalues << -4, -1e-3, 0.5, 2, 2, 1000;
  v << 1, -2, 3, 0.5, -1, 4;
  const Matrix6 reflection = Matrix6::Identity() - 2 / v.squaredNorm() * v * v.transpose();
  Vector6 shuffled;
  shuffled << eigenvalues[3], eigenvalues[0], eigenvalues[5], eigenvalues[1], eigenvalues[4],
      eigenvalues[2];
  Matrix6 symmetric = reflection * shuffled.asDiagonal() * reflection;
  const auto found = symmetric_eigenvalues(symmetric);
  ASSERT_TRUE(found);
  EXPECT_LT((*found - eigenvalues).cwiseAbs().maxCoeff(), 1e-12 * 1000);
  symmetric.triangularView<Eigen::StrictlyUpper>().setConstant(7);
  EXPECT_EQ(symmetric_eigenvalues(symmetric), found);
}

TEST(SymmetricEigenvalues, AreNoneForAMatrixThatIsNotFinite) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  for (const double wrong : {std::numeric_limits<double>::quiet_NaN(), kInfinity, -kInfinity}) {
    for (int i = 0; i < 6; ++i) {
      for (int j = 0; j <= i; ++j) {
        Matrix6 symmetric = Matrix6::Identity();
        symmetric(i, j) = wrong;
        EXPECT_FALSE(symmetric_eigenvalues(symmetric)) << wrong << " at " << i << ", " << j;
      }
    }
  }
}

}  // namespace
}  // namespace trocar::runtime
