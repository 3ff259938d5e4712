// SPDX-License-Identifier: Apache-2.0
#include "runtime/deformation/sparse_factor.h"

#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>
#include <algorithm>

namespace trocar::runtime {
namespace {

constexpr std::uint32_t kNoUnknown = 0xffffffff;

/// Returns the free nodes in an order that keeps the factor sparse.
std::vector<std::uint32_t> elimination_order(const Network& network,
                                             std::span<const NodeKind> kind) {
  std::vector<std::uint32_t> free;
  std::vector<int> number(network.size(), -1);
  for (std::uint32_t i = 0; i < network.size(); ++i) {
    if (kind[i] != NodeKind::kFree) continue;
    number[i] = static_cast<int>(free.size());
    free.push_back(i);
  }
  if (free.empty()) return {};  // Eigen 3.4 reads beyond a matrix without columns
  const auto n = static_cast<int>(free.size());
  Eigen::SparseMatrix<double> pattern(n, n);
  std::vector<int> per_column(free.size());
  for (std::size_t u = 0; u < free.size(); ++u)
    per_column[u] = 1 + static_cast<int>(network.first[free[u] + 1] - network.first[free[u]]);
  pattern.reserve(per_column);
  for (int u = 0; u < n; ++u) {
    const std::uint32_t i = free[static_cast<std::size_t>(u)];
    pattern.insert(u, u) = 1;  // without this entry the ordering treats the column as dense
    for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k) {
      const int v = number[network.neighbour[k]];
      if (v > u) pattern.insert(v, u) = 1;
    }
  }
  pattern.makeCompressed();
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> order;
  Eigen::AMDOrdering<int>()(pattern.selfadjointView<Eigen::Lower>(), order);
  std::vector<std::uint32_t> nodes(free.size());
  for (std::size_t u = 0; u < free.size(); ++u)
    nodes[u] = free[static_cast<std::size_t>(order.indices()[static_cast<Eigen::Index>(u)])];
  return nodes;
}

}  // namespace

bool SparseFactor::make(const Network& network, std::span<const NodeKind> kind) {
  *this = SparseFactor();
  std::vector<std::uint32_t> nodes = elimination_order(network, kind);
  const auto n = static_cast<std::uint32_t>(nodes.size());
  std::vector<std::uint32_t> unknown(network.size(), kNoUnknown);
  for (std::uint32_t u = 0; u < n; ++u)
    unknown[nodes[u]] = u;

  // Find the elimination tree and the length of each column. The entries of row u of L are on the
  // tree's paths from the row's matrix entries up to u.
  std::vector<std::uint32_t> parent(n, kNoUnknown), seen(n), length(n, 0);
  const auto for_each_earlier = [&](std::uint32_t u, auto&& visit) {
    const std::uint32_t i = nodes[u];
    for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k) {
      const std::uint32_t v = unknown[network.neighbour[k]];
      if (v != kNoUnknown && v < u) visit(v, network.stiffness_N_per_m[k]);
    }
  };
  for (std::uint32_t u = 0; u < n; ++u) {
    seen[u] = u;
    for_each_earlier(u, [&](std::uint32_t v, double) {
      for (; seen[v] != u; v = parent[v]) {
        if (parent[v] == kNoUnknown) parent[v] = u;
        ++length[v];
        seen[v] = u;
      }
    });
  }
  std::vector<std::uint32_t> first(n + 1, 0);
  for (std::uint32_t u = 0; u < n; ++u)
    first[u + 1] = first[u] + length[u];

  // Compute each row by a solve with the rows above it.
  std::vector<std::uint32_t> row(first[n]), path(n), filled(n, 0);
  std::vector<double> value(first[n]), inverse_pivot(n), y(n, 0);
  for (std::uint32_t u = 0; u < n; ++u) {
    const std::uint32_t i = nodes[u];
    double diagonal = network.foundation_N_per_m[i];
    for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k)
      diagonal += network.stiffness_N_per_m[k];
    // Find the row's pattern in topological order: each entry precedes those that it changes.
    std::uint32_t top = n;
    seen[u] = u + n;  // larger than any mark of the first pass
    for_each_earlier(u, [&](std::uint32_t v, double stiffness) {
      y[v] -= stiffness;
      std::uint32_t count = 0;
      for (; seen[v] != u + n; v = parent[v]) {
        path[count++] = v;
        seen[v] = u + n;
      }
      while (count > 0)
        path[--top] = path[--count];
    });
    for (; top < n; ++top) {
      const std::uint32_t v = path[top];
      const double y_v = y[v];
      y[v] = 0;
      const std::uint32_t end = first[v] + filled[v];
      for (std::uint32_t k = first[v]; k < end; ++k)
        y[row[k]] -= value[k] * y_v;
      const double entry = y_v * inverse_pivot[v];
      diagonal -= entry * y_v;
      row[end] = u;
      value[end] = entry;
      ++filled[v];
    }
    if (!(diagonal > 0)) return false;
    inverse_pivot[u] = 1 / diagonal;
  }
  node_ = std::move(nodes);
  first_ = std::move(first);
  row_ = std::move(row);
  value_ = std::move(value);
  inverse_pivot_ = std::move(inverse_pivot);
  return true;
}

void SparseFactor::solve(std::span<double> x) const noexcept {
  const std::size_t n = inverse_pivot_.size();
  for (std::size_t u = 0; u < n; ++u) {
    const double x_u = x[u];
    for (std::uint32_t k = first_[u]; k < first_[u + 1]; ++k)
      x[row_[k]] -= value_[k] * x_u;
    x[u] = x_u * inverse_pivot_[u];
  }
  for (std::size_t u = n; u-- > 0;) {
    double x_u = x[u];
    for (std::uint32_t k = first_[u]; k < first_[u + 1]; ++k)
      x_u -= value_[k] * x[row_[k]];
    x[u] = x_u;
  }
}

}  // namespace trocar::runtime
