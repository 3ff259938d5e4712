// SPDX-License-Identifier: Apache-2.0
#include "runtime/calibration/curve_model.h"

#include <algorithm>
#include <cmath>

namespace trocar::runtime {
namespace {

/// Force at the tip's displacement u_mm beyond the surface, for a strength that is surface_N at the surface and
/// changes by drift_N_per_mm. It must be above -stiffness.
double force_N(double stiffness_N_per_mm, double surface_N, double drift_N_per_mm,
               double friction_N_per_mm, double u_mm) {
  const double cut_mm =
      (stiffness_N_per_mm * u_mm - surface_N) / (stiffness_N_per_mm + drift_N_per_mm);
  if (!(cut_mm > 0)) return stiffness_N_per_mm * u_mm;
  return surface_N + (drift_N_per_mm + friction_N_per_mm) * cut_mm;
}

}  // namespace

double insertion_N(const CurveParameters& p, const CurveShape& shape, double depth_mm) {
  const double u_mm = depth_mm - p[kContact];
  if (!(u_mm > 0)) return p[kBaseline];
  const double stiffness = std::exp(p[kLogStiffness]);
  const double drift = std::max(p[kDrift], -0.5 * stiffness);
  double force =
      force_N(stiffness, p[kCutting] - drift * shape.middle_mm, drift, p[kFriction], u_mm);
  if (shape.has_layer) {
    const double past = std::clamp((depth_mm - p[kLayerEnd]) / shape.fall_mm + 0.5, 0.0, 1.0);
    force = past * force + (1 - past) * force_N(stiffness, p[kLayerForce], 0, p[kFriction], u_mm);
  }
  return p[kBaseline] + force;
}

double withdrawal_N(const CurveParameters& p, double depth_mm) {
  return p[kBaseline] - p[kFriction] * std::max(depth_mm - p[kContact], 0.0);
}

}  // namespace trocar::runtime
