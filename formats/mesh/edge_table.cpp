// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/edge_table.h"

#include <memory>

namespace trocar {
namespace {

struct Ends {
  std::uint32_t low, high;
};
Ends ends(const Triangle& t, std::size_t i) {
  // This is free of branches because the order cannot be predicted.
  const std::uint32_t a = t[i], b = t[i == 2 ? 0 : i + 1], difference = a ^ b,
                      mask = -static_cast<std::uint32_t>(a < b);
  return {b ^ (difference & mask), a ^ (difference & mask)};
}

}  // namespace

EdgeTable edge_table(const SliceMesh& mesh) {
  // Counting sort by the higher vertex, then by the lower one. It needs no unpredictable branches.
  EdgeTable out;
  std::vector<std::uint32_t> next(mesh.vertices.size() + 1, 0);
  out.first.assign(mesh.vertices.size() + 1, 0);
  for (const Triangle& t : mesh.triangles) {
    for (std::size_t i = 0; i < 3; ++i) {
      const auto [low, high] = ends(t, i);
      ++out.first[low + 1];
      ++next[high + 1];
    }
  }
  for (std::size_t v = 1; v < next.size(); ++v) {
    out.first[v] += out.first[v - 1];
    next[v] += next[v - 1];
  }
  struct Edge {
    std::uint32_t low, edge;
  };
  const std::size_t edges = mesh.triangles.size() * 3;
  const auto by_high = std::make_unique_for_overwrite<Edge[]>(edges);
  std::uint32_t edge = 0;
  for (const Triangle& t : mesh.triangles) {
    for (std::size_t i = 0; i < 3; ++i, ++edge) {
      const auto [low, high] = ends(t, i);
      by_high[next[high]++] = {low, edge};
    }
  }
  out.entries.resize(edges);
  std::vector<std::uint32_t> next_of_low(out.first.begin(), out.first.end());
  std::uint32_t k = 0;
  for (std::uint32_t high = 0; high < mesh.vertices.size(); ++high) {
    for (; k < next[high]; ++k)
      out.entries[next_of_low[by_high[k].low]++] = {high, by_high[k].edge};
  }
  return out;
}

}  // namespace trocar
