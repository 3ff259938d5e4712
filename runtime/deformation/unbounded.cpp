// SPDX-License-Identifier: Apache-2.0
#include "runtime/deformation/unbounded.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

namespace trocar::runtime {
namespace {

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
