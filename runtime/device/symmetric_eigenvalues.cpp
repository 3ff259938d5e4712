// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/symmetric_eigenvalues.h"

#include <Eigen/Eigenvalues>

namespace trocar::runtime {

std::optional<Eigen::Matrix<double, 6, 1>> symmetric_eigenvalues(
    const Eigen::Matrix<double, 6, 6>& symmetric) noexcept {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>> solver(symmetric,
                                                                          Eigen::EigenvaluesOnly);
  // The solver may report success although an element is infinite.
  if (solver.info() != Eigen::Success || !solver.eigenvalues().allFinite()) return std::nullopt;
  return solver.eigenvalues();
}

}  // namespace trocar::runtime
