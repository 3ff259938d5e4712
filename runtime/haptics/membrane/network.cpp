// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/membrane/network.h"

#include <Eigen/LU>
#include <numbers>

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

using Eigen::Vector2d;

constexpr int kMaxPanels = 4096;

struct Panel {
  Vector2d from, to, normal;  ///< `normal` points into the sheet and has length 1
  double length = 0;
  Vector2d middle() const { return (from + to) / 2; }
};

/// Gauss-Legendre quadrature with six points on [0, 1].
struct QuadratureNode {
  double at, weight;
};
constexpr std::array<QuadratureNode, 6> kGauss{{{0.0337652428984240, 0.0856622461895852},
                                                {0.1693953067668677, 0.1803807865240693},
                                                {0.3806904069584015, 0.2339569672863455},
                                                {0.6193095930415985, 0.2339569672863455},
                                                {0.8306046932331323, 0.1803807865240693},
                                                {0.9662347571015760, 0.0856622461895852}}};

/// Returns the panels of all edges, graded towards the ends of each edge with the third power
/// of the distance.
std::vector<Panel> make_panels(std::span<const Vector2d> outline, int panels_per_side) {
  std::vector<Panel> panels;
  const auto place = [&](int i) {
    const double u = 2.0 * i / panels_per_side - 1;  // -1 .. 1
    const double from_end = 1 - std::abs(u);
    const double graded = from_end * from_end * from_end / 2;
    return u < 0 ? graded : 1 - graded;
  };
  for (std::size_t k = 0; k < outline.size(); ++k) {
    const Vector2d& a = outline[k];
    const Vector2d edge = outline[(k + 1) % outline.size()] - a;
    const Vector2d normal = Vector2d(edge.y(), -edge.x()) / edge.norm();
    for (int i = 0; i < panels_per_side; ++i) {
      Panel panel{a + place(i) * edge, a + place(i + 1) * edge, normal};
      panel.length = (panel.to - panel.from).norm();
      panels.push_back(panel);
    }
  }
  return panels;
}

double distance_to(const Vector2d& x, const Vector2d& a, const Vector2d& b) {
  const double t = std::clamp((x - a).dot(b - a) / (b - a).squaredNorm(), 0.0, 1.0);
  return (a + t * (b - a) - x).norm();
}

/// Integrals of G and of its normal derivative.
struct Potentials {
  double single = 0, twice = 0;
};
/// Adds the integrals over the segment from a to b, for a point x that is not on its panel. The
/// segment is halved until it is no longer than its distance from x.
void add(const Vector2d& x, const Vector2d& a, const Vector2d& b, const Vector2d& normal,
         double lambda, int depth, Potentials& sum) {
  const double length = (b - a).norm();
  if (depth > 0 && length > distance_to(x, a, b)) {
    const Vector2d middle = (a + b) / 2;
    add(x, a, middle, normal, lambda, depth - 1, sum);
    add(x, middle, b, normal, lambda, depth - 1, sum);
    return;
  }
  const double height = (a - x).dot(normal);  // distance of x from the segment's line
  const bool beside = std::abs(height) > 1e-14 * length;
  for (const QuadratureNode& node : kGauss) {
    const double r = (a + node.at * (b - a) - x).norm();
    const double weight = node.weight * length / (2 * std::numbers::pi);
    sum.single += weight * std::cyl_bessel_k(0.0, r / lambda);
    if (beside) sum.twice -= weight * std::cyl_bessel_k(1.0, r / lambda) * height / (r * lambda);
  }
}

/// Returns the integral of G over a panel, at the panel's middle. The substitution s = (length / 2)
/// t^3 removes the singularity.
double own_potential(double length, double lambda) {
  double sum = 0;
  for (int half = 0; half < 2; ++half) {
    for (const QuadratureNode& node : kGauss) {
      const double t = (half + node.at) / 2;
      sum += node.weight / 2 * 3 * t * t * std::cyl_bessel_k(0.0, length / 2 * t * t * t / lambda);
    }
  }
  return length * sum / (2 * std::numbers::pi);
}

double polygon_area(std::span<const Vector2d> outline) {
  double doubled = 0;
  for (std::size_t k = 0; k < outline.size(); ++k) {
    const Vector2d& a = outline[k];
    const Vector2d& b = outline[(k + 1) % outline.size()];
    doubled += a.x() * b.y() - a.y() * b.x();
  }
  return doubled / 2;
}

Result<void> check(std::span<const Vector2d> outline, double decay_length, int panels_per_side) {
  if (!(decay_length > 0) || !std::isfinite(decay_length))
    return refused("the decay length must be positive");
  if (outline.size() < 3) return refused("a tool has at least three corners");
  if (panels_per_side < 2 ||
      outline.size() * static_cast<std::size_t>(panels_per_side) > kMaxPanels)
    return refused("the tool's outline must have 2 to " + std::to_string(kMaxPanels) + " panels");
  for (std::size_t k = 0; k < outline.size(); ++k) {
    const double edge = (outline[(k + 1) % outline.size()] - outline[k]).norm();
    if (!(edge > 0) || !std::isfinite(edge))
      return refused("the tool's corners " + std::to_string(k) + " and the next coincide");
  }
  if (!(polygon_area(outline) > 0)) return refused("the tool's corners run clockwise");
  return {};
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

Result<double> unbounded_stiffness_per_foundation_m2(std::span<const Vector2d> outline_m,
                                                     double decay_length_m, int panels_per_side) {
  if (const auto fine = check(outline_m, decay_length_m, panels_per_side); !fine)
    return fine.error();
  const std::vector<Panel> panels = make_panels(outline_m, panels_per_side);
  const auto n = static_cast<Eigen::Index>(panels.size());
  Eigen::MatrixXd single(n, n);
  Eigen::VectorXd right(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Vector2d x = panels[static_cast<std::size_t>(i)].middle();
    right[i] = 0.5;
    for (Eigen::Index j = 0; j < n; ++j) {
      const Panel& panel = panels[static_cast<std::size_t>(j)];
      if (i == j) {
        single(i, j) = own_potential(panel.length, decay_length_m);
        continue;
      }
      Potentials sum;
      add(x, panel.from, panel.to, panel.normal, decay_length_m, 12, sum);
      single(i, j) = sum.single;
      right[i] -= sum.twice;
    }
  }
  const Eigen::VectorXd slope = single.partialPivLu().solve(right);
  double flux = 0;
  for (Eigen::Index i = 0; i < n; ++i)
    flux += slope[i] * panels[static_cast<std::size_t>(i)].length;
  const double area = polygon_area(outline_m) + decay_length_m * decay_length_m * flux;
  if (!std::isfinite(area) || !(area > 0))
    return refused("no stiffness can be found for this tool: is its outline simple?");
  return area;
}

Result<Membrane> membrane_for_tool(double stiffness_N_per_m, double decay_length_m,
                                   std::span<const Vector2d> outline_m, int panels_per_side) {
  const auto per_bed =
      unbounded_stiffness_per_foundation_m2(outline_m, decay_length_m, panels_per_side);
  if (!per_bed) return per_bed.error();
  const double bed = stiffness_N_per_m / *per_bed;
  return Membrane{bed * decay_length_m * decay_length_m, bed};
}

}  // namespace trocar::runtime
