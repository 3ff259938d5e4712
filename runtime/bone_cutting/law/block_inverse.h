// SPDX-License-Identifier: Apache-2.0
// Inverse of a symmetric 6 x 6 matrix, computed from blocks of 3 x 3.
#pragma once

#include <Eigen/Core>

namespace trocar::runtime {

/// Computes the inverse of a symmetric matrix. Returns false if the matrix is not positive
/// definite.
inline bool invert(const Eigen::Matrix3d& A, Eigen::Matrix3d& inverse) noexcept {
  const double c00 = A(1, 1) * A(2, 2) - A(1, 2) * A(1, 2),
               c01 = A(0, 2) * A(1, 2) - A(0, 1) * A(2, 2),
               c02 = A(0, 1) * A(1, 2) - A(0, 2) * A(1, 1),
               c11 = A(0, 0) * A(2, 2) - A(0, 2) * A(0, 2),
               c12 = A(0, 1) * A(0, 2) - A(0, 0) * A(1, 2),
               c22 = A(0, 0) * A(1, 1) - A(0, 1) * A(0, 1);
  const double det = A(0, 0) * c00 + A(0, 1) * c01 + A(0, 2) * c02;
  const double size = A(0, 0) * A(1, 1) * A(2, 2);
  if (!(A(0, 0) > 0 && c22 > 1e-12 * A(0, 0) * A(1, 1) && det > 1e-12 * size)) return false;
  const double per = 1 / det;
  inverse << c00 * per, c01 * per, c02 * per, c01 * per, c11 * per, c12 * per, c02 * per, c12 * per,
      c22 * per;
  return true;
}

class BlockInverse {
 public:
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  using Vector6 = Eigen::Matrix<double, 6, 1>;

  /// Computes the inverse of `A`. Returns false if `A` is not positive definite.
  bool of(const Matrix6& A) noexcept {
    const Eigen::Matrix3d A01 = A.topRightCorner<3, 3>();
    if (!invert(A.topLeftCorner<3, 3>(), first_)) return false;
    across_ = first_ * A01;
    return invert(A.bottomRightCorner<3, 3>() - A01.transpose() * across_, second_);
  }
  /// Returns the inverse times `b`. Precondition: the last call of the member function `of`
  /// returned true.
  Vector6 times(const Vector6& b) const noexcept {
    Vector6 x;
    x.tail<3>() = second_ * (b.tail<3>() - across_.transpose() * b.head<3>());
    x.head<3>() = first_ * b.head<3>() - across_ * x.tail<3>();
    return x;
  }

 private:
  Eigen::Matrix3d first_, across_, second_;
};

}  // namespace trocar::runtime
