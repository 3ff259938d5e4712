// SPDX-License-Identifier: Apache-2.0
// A rigid disc pressed into an unbounded membrane on a Winkler foundation, in closed form: an exact
// solution to compare the spring network with.
//
// Outside the disc T (w'' + w'/r) = f w, so w(r) = w0 K0(r / lambda) / K0(a / lambda) with lambda =
// sqrt(T / f) and K0, K1 the modified Bessel functions. The foundation under the disc and the slope
// along its edge give F / w0 = pi a^2 f + 2 pi a sqrt(T f) K1(a / lambda) / K0(a / lambda).
#pragma once

#include <Eigen/Core>
#include <span>

#include "formats/base/result.h"
#include "runtime/haptics/membrane/network.h"

namespace trocar::runtime {

/// F / w in N/m under a rigid disc of radius a > 0 in an unbounded sheet.
double disc_stiffness_N_per_m(const Membrane& membrane, double radius_m);

/// w / w0 at the distance r >= a from the centre.
double disc_shape(const Membrane& membrane, double radius_m, double r_m);

/// The membrane of reach lambda that has stiffness K under that disc.
Membrane membrane_for_disc(double stiffness_N_per_m, double reach_m, double radius_m);

/// The radius of the disc that is as stiff as the tool `outline_m` (as for
/// unbounded_stiffness_per_foundation_m2). For a regular hexagon of circumradius a it goes from 0.920 a
/// (its logarithmic capacity) for lambda >> a to 0.909 a (equal area) for lambda << a, and is
/// within 0.1 % of the former for lambda >= 1.5 a (deformation_exact_test.cpp).
Result<double> equivalent_radius_m(std::span<const Eigen::Vector2d> outline_m, double reach_m);

}  // namespace trocar::runtime
