// SPDX-License-Identifier: Apache-2.0
// The eigenvalues of symmetric 6 x 6 matrices. Of the programs' files, only symmetric_eigenvalues.cpp
// includes Eigen's solver, which compiles slowly.
// Tests: tests/runtime/decompositions/symmetric_eigenvalues_test.cpp
#pragma once

#include <Eigen/Core>
#include <optional>

namespace trocar::runtime {

/// Returns the eigenvalues in ascending order. Only the lower triangle of `symmetric` is read. The
/// error of each is some rounding errors of the largest eigenvalue. Returns none if an element is not
/// finite, or if the iteration of the symmetric QR algorithm does not converge. Allocates nothing.
std::optional<Eigen::Matrix<double, 6, 1>> symmetric_eigenvalues(
    const Eigen::Matrix<double, 6, 6>& symmetric) noexcept;

}  // namespace trocar::runtime
