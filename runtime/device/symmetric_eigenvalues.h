// SPDX-License-Identifier: Apache-2.0
// The eigenvalues of symmetric 6 x 6 matrices. Eigen's solver compiles slowly, so no file of the
// programs except symmetric_eigenvalues.cpp includes this solver.
#pragma once

#include <Eigen/Core>
#include <optional>

namespace trocar::runtime {

/// Returns the eigenvalues in ascending order. Only the lower triangle of `symmetric` is read. The
/// error of each eigenvalue is a few rounding errors of the eigenvalue with the largest magnitude.
/// Returns nullopt if an element is not finite, or if the iteration of the symmetric QR algorithm
/// does not converge. Allocates nothing.
std::optional<Eigen::Matrix<double, 6, 1>> symmetric_eigenvalues(
    const Eigen::Matrix<double, 6, 6>& symmetric) noexcept;

}  // namespace trocar::runtime
