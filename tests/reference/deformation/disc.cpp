// SPDX-License-Identifier: Apache-2.0
#include "tests/reference/deformation/disc.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "runtime/haptics/membrane/network.h"

namespace trocar::runtime {
namespace {

/// F / (w f).
double stiffness_per_foundation_m2(double radius_m, double lambda_m) {
  const double ratio = radius_m / lambda_m;
  // Both functions vanish beyond about 700; their ratio tends to 1 + 1 / (2 ratio) long before.
  const double slope =
      ratio < 500 ? std::cyl_bessel_k(1.0, ratio) / std::cyl_bessel_k(0.0, ratio) : 1 + 0.5 / ratio;
  return std::numbers::pi * radius_m * (radius_m + 2 * lambda_m * slope);
}

}  // namespace

double disc_stiffness_N_per_m(const Membrane& membrane, double radius_m) {
  return membrane.foundation_N_per_m3 *
         stiffness_per_foundation_m2(radius_m, decay_length_m(membrane));
}

double disc_shape(const Membrane& membrane, double radius_m, double r_m) {
  const double lambda_m = decay_length_m(membrane);
  return std::cyl_bessel_k(0.0, r_m / lambda_m) / std::cyl_bessel_k(0.0, radius_m / lambda_m);
}

Membrane membrane_for_disc(double stiffness_N_per_m, double lambda_m, double radius_m) {
  const double bed = stiffness_N_per_m / stiffness_per_foundation_m2(radius_m, lambda_m);
  return {bed * lambda_m * lambda_m, bed};
}

Result<double> equivalent_radius_m(std::span<const Eigen::Vector2d> outline_m, double reach_m) {
  const auto wanted = unbounded_stiffness_per_foundation_m2(outline_m, reach_m);
  if (!wanted) return wanted.error();
  // The disc's stiffness grows with its radius: bisection between a point and more than enough.
  const Membrane unit{reach_m * reach_m, 1};
  double low = 0, high = 0;
  for (const Eigen::Vector2d& corner : outline_m)
    high = std::max(high, 2 * (corner - outline_m[0]).norm());
  for (int i = 0; i < 60; ++i) {
    const double middle = (low + high) / 2;
    (disc_stiffness_N_per_m(unit, middle) < *wanted ? low : high) = middle;
  }
  return (low + high) / 2;
}

}  // namespace trocar::runtime
