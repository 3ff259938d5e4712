// SPDX-License-Identifier: Apache-2.0
// A rigid disc pressed into an unbounded membrane on a bed, in closed form (DESIGN, Force): the
// exact solution that the network is measured against.
//
// Outside of the disc T (w'' + w'/r) = f w, so w(r) = w0 K0(r / lambda) / K0(a / lambda) with
// lambda = sqrt(T / f) and K0, K1 the modified Bessel functions; the bed under the disc and the
// slope along its edge give F / w0 = pi a^2 f + 2 pi a sqrt(T f) K1(a / lambda) / K0(a / lambda).
#pragma once

#include "runtime/deformation/network.h"

namespace trocar::runtime {

/// F / w in N/m under a rigid disc of radius a > 0 in an unbounded sheet.
double disc_stiffness_N_per_m(const Membrane& membrane, double radius_m);

/// w / w0 at the distance r >= a from the centre.
double disc_shape(const Membrane& membrane, double radius_m, double r_m);

/// The membrane of reach lambda that feels stiffness K under that disc.
Membrane membrane_for_disc(double stiffness_N_per_m, double reach_m, double radius_m);

}  // namespace trocar::runtime
