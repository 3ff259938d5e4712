// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/symmetric_eigenvalues.h"

#include <gtest/gtest.h>

#include <limits>

namespace trocar::runtime {
namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
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
