// SPDX-License-Identifier: Apache-2.0
#include "runtime/deformation/disc.h"

#include <cmath>
#include <numbers>

namespace trocar::runtime {
namespace {

/// F / (w f).
double stiffness_per_bed_m2(double radius_m, double lambda_m) {
  const double ratio = radius_m / lambda_m;
  // Both functions vanish beyond about 700; their ratio tends to 1 + 1 / (2 ratio) long before.
  const double slope =
      ratio < 500 ? std::cyl_bessel_k(1.0, ratio) / std::cyl_bessel_k(0.0, ratio) : 1 + 0.5 / ratio;
  return std::numbers::pi * radius_m * (radius_m + 2 * lambda_m * slope);
}

}  // namespace

double disc_stiffness_N_per_m(const Membrane& membrane, double radius_m) {
  return membrane.bed_N_per_m3 * stiffness_per_bed_m2(radius_m, reach_m(membrane));
}

double disc_shape(const Membrane& membrane, double radius_m, double r_m) {
  const double lambda_m = reach_m(membrane);
  return std::cyl_bessel_k(0.0, r_m / lambda_m) / std::cyl_bessel_k(0.0, radius_m / lambda_m);
}

Membrane membrane_for_disc(double stiffness_N_per_m, double lambda_m, double radius_m) {
  const double bed = stiffness_N_per_m / stiffness_per_bed_m2(radius_m, lambda_m);
  return {bed * lambda_m * lambda_m, bed};
}

}  // namespace trocar::runtime
