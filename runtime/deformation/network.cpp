// SPDX-License-Identifier: Apache-2.0
#include "runtime/deformation/network.h"

#include <algorithm>
#include <cmath>

namespace trocar::runtime {
namespace {

/// An edge of a triangle, with the cotangent of the opposite angle as an exact fraction.
struct WeightedEdge {
  std::uint32_t high;         ///< the node with the higher index
  std::int64_t dot;           ///< scalar product of the two other edges
  std::int64_t doubled_area;  ///< their cross product, positive
};

/// All edges, ordered by their node of lower index, then by the node of higher index.
struct Edges {
  std::vector<std::uint32_t> first;
  std::vector<WeightedEdge> edges;
};

Edges edges_of(const SliceMesh& mesh) {
  Edges out;
  out.first.assign(mesh.vertices.size() + 2, 0);
  // Counts are stored one element further, so that filling leaves `first` in its final state.
  for (const Triangle& t : mesh.triangles) {
    for (std::size_t k = 0; k < 3; ++k)
      ++out.first[std::min(t[k], t[(k + 1) % 3]) + 2];
  }
  for (std::size_t i = 2; i < out.first.size(); ++i)
    out.first[i] += out.first[i - 1];
  out.edges.resize(3 * mesh.triangles.size());
  for (const Triangle& t : mesh.triangles) {
    const std::int64_t area =
        orient2d(mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]);
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = t[k], b = t[(k + 1) % 3];
      const std::int64_t dot =
          diametral_dot(mesh.vertices[a], mesh.vertices[b], mesh.vertices[t[(k + 2) % 3]]);
      out.edges[out.first[std::min(a, b) + 1]++] = {std::max(a, b), dot, area};
    }
  }
  out.first.pop_back();
  for (std::size_t i = 0; i + 1 < out.first.size(); ++i) {
    std::sort(out.edges.begin() + out.first[i], out.edges.begin() + out.first[i + 1],
              [](const WeightedEdge& a, const WeightedEdge& b) { return a.high < b.high; });
  }
  return out;
}

double cotangent(const WeightedEdge& edge) {
  return static_cast<double>(edge.dot) / static_cast<double>(edge.doubled_area);
}

/// Calls visit(low, high, sum of cotangents) for every edge, in order, and counts the signs.
template <typename Visit>
SpringSigns for_each_edge(const Edges& all, Visit&& visit) {
  SpringSigns signs;
  for (std::uint32_t low = 0; low + 1 < all.first.size(); ++low) {
    for (std::uint32_t k = all.first[low]; k < all.first[low + 1]; ++k) {
      const WeightedEdge& a = all.edges[k];
      const bool interior = k + 1 < all.first[low + 1] && all.edges[k + 1].high == a.high;
      if (interior) {
        const WeightedEdge& b = all.edges[++k];
        ++signs.interior;
        if (Int128{a.dot} * b.doubled_area + Int128{b.dot} * a.doubled_area < 0)
          ++signs.negative_interior;
        visit(low, a.high, cotangent(a) + cotangent(b));
      } else {
        ++signs.boundary;
        if (a.dot < 0) ++signs.negative_boundary;
        visit(low, a.high, cotangent(a));
      }
    }
  }
  return signs;
}

}  // namespace

double decay_length_m(const Membrane& membrane) noexcept {
  return std::sqrt(membrane.tension_N_per_m / membrane.foundation_N_per_m3);
}

Network make_network(const SliceMesh& mesh, const Lattice& lattice, const Membrane& membrane) {
  const std::size_t n = mesh.vertices.size();
  const Edges edges = edges_of(mesh);
  Network out;
  // Counts are stored one element further, as in edges_of().
  out.first.assign(n + 2, 0);
  for_each_edge(edges, [&](std::uint32_t low, std::uint32_t high, double) {
    ++out.first[low + 2];
    ++out.first[high + 2];
  });
  for (std::size_t i = 2; i < out.first.size(); ++i)
    out.first[i] += out.first[i - 1];
  out.neighbour.resize(out.first.back());
  out.stiffness_N_per_m.resize(out.first.back());
  // Edges come by their lower node, so each row fills in ascending order.
  out.signs = for_each_edge(edges, [&](std::uint32_t low, std::uint32_t high, double cotangents) {
    const double stiffness = membrane.tension_N_per_m / 2 * cotangents;
    const auto put = [&](std::uint32_t at, std::uint32_t other) {
      const std::uint32_t k = out.first[at + 1]++;
      out.neighbour[k] = other;
      out.stiffness_N_per_m[k] = stiffness;
    };
    put(low, high);
    put(high, low);
  });
  out.first.pop_back();

  const double step_m = lattice.step_m();
  const double bed_per_doubled_area = membrane.foundation_N_per_m3 * step_m * step_m / 6;
  out.foundation_N_per_m.assign(n, 0);
  for (const Triangle& t : mesh.triangles) {
    const double share =
        bed_per_doubled_area * static_cast<double>(orient2d(
                                   mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]));
    for (std::uint32_t v : t)
      out.foundation_N_per_m[v] += share;
  }
  return out;
}

std::uint32_t negative_at_free_nodes(const Network& network,
                                     std::span<const NodeKind> kind) noexcept {
  std::uint32_t count = 0;
  if (network.signs.negative() == 0) return count;
  for (std::size_t i = 0; i < network.size(); ++i) {
    for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k) {
      const std::uint32_t j = network.neighbour[k];
      if (j > i && network.stiffness_N_per_m[k] < 0 &&
          (kind[i] == NodeKind::kFree || kind[j] == NodeKind::kFree))
        ++count;
    }
  }
  return count;
}

double reaction_N(const Network& network, std::span<const double> w_m, std::size_t i) noexcept {
  double force_N = network.foundation_N_per_m[i] * w_m[i];
  for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k)
    force_N += network.stiffness_N_per_m[k] * (w_m[i] - w_m[network.neighbour[k]]);
  return force_N;
}

}  // namespace trocar::runtime
