// SPDX-License-Identifier: Apache-2.0
#include "tests/reference/deformation/global_solver.h"

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>

namespace trocar::runtime {

Result<GlobalSolution> solve_global(const Network& network, std::span<const NodeKind> kind) {
  std::vector<int> unknown(network.size(), -1);
  int unknowns = 0;
  for (std::size_t i = 0; i < network.size(); ++i) {
    if (kind[i] == NodeKind::kFree) unknown[i] = unknowns++;
  }
  GlobalSolution out;
  out.w.assign(network.size(), 0);
  std::vector<Eigen::Triplet<double>> entries;
  Eigen::VectorXd right = Eigen::VectorXd::Zero(unknowns);
  for (std::size_t i = 0; i < network.size(); ++i) {
    if (kind[i] == NodeKind::kTool) out.w[i] = 1;
    if (unknown[i] < 0) continue;
    double diagonal = network.foundation_N_per_m[i];
    for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k) {
      const std::uint32_t j = network.neighbour[k];
      const double stiffness = network.stiffness_N_per_m[k];
      diagonal += stiffness;
      if (unknown[j] >= 0 && j < i) entries.emplace_back(unknown[i], unknown[j], -stiffness);
      if (kind[j] == NodeKind::kTool) right[unknown[i]] += stiffness;
    }
    entries.emplace_back(unknown[i], unknown[i], diagonal);
  }
  if (unknowns > 0) {
    Eigen::SparseMatrix<double> matrix(unknowns, unknowns);
    matrix.setFromTriplets(entries.begin(), entries.end());
    const Eigen::SimplicialLLT<Eigen::SparseMatrix<double>, Eigen::Lower> cholesky(matrix);
    if (cholesky.info() != Eigen::Success)
      return bug("the network's matrix is not positive definite");
    const Eigen::VectorXd w = cholesky.solve(right);
    for (std::size_t i = 0; i < network.size(); ++i) {
      if (unknown[i] >= 0) out.w[i] = w[unknown[i]];
    }
  }
  for (std::size_t i = 0; i < network.size(); ++i) {
    if (kind[i] == NodeKind::kTool) out.stiffness_N_per_m += reaction_N(network, out.w, i);
  }
  return out;
}

}  // namespace trocar::runtime
