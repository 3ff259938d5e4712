// SPDX-License-Identifier: Apache-2.0
#include "runtime/calibration/curve_start.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace trocar::runtime {
namespace {

/// Depths at which the force falls most within half a millimetre, at most half of the way in.
std::vector<double> steepest_falls(const RoughCurve& rough) {
  const std::vector<CurveMean>& means = rough.insertion;
  const double half_mm = std::max(0.5, 2 * rough.spacing_mm);
  std::vector<std::pair<double, double>> falls;
  for (std::size_t i = 0; i + 1 < means.size(); ++i) {
    const double at_mm = 0.5 * (means[i].depth_mm + means[i + 1].depth_mm),
                 cut_mm = at_mm - rough.contact_mm;
    if (cut_mm <= 0 || cut_mm > 0.5 * (rough.deepest_mm - rough.contact_mm)) continue;
    double before = 0, after = 0, befores = 0, afters = 0;
    for (const CurveMean& other : means) {
      const double d = other.depth_mm - at_mm;
      if (d <= 0 && d > -half_mm) before += other.force_N, befores += 1;
      if (d > 0 && d < half_mm) after += other.force_N, afters += 1;
    }
    if (befores == 0 || afters == 0) continue;
    const double fall_N = before / befores - after / afters,
                 step_N = means[i].force_N - means[i + 1].force_N;
    if (fall_N > 0) falls.emplace_back(fall_N + step_N, at_mm);
  }
  std::sort(falls.rbegin(), falls.rend());
  std::vector<double> ends_mm;
  for (const auto& [fall_N, end_mm] : falls) {
    const auto is_near = [end = end_mm, half_mm](double other) {
      return std::abs(other - end) < half_mm;
    };
    if (ends_mm.size() < 3 && std::none_of(ends_mm.begin(), ends_mm.end(), is_near))
      ends_mm.push_back(end_mm);
  }
  return ends_mm;
}

}  // namespace

std::vector<CurveSolution> starts_of(const RoughCurve& rough, bool has_layer) {
  CurveSolution start;
  start.shape.middle_mm = 0.5 * (rough.deepest_mm - rough.contact_mm);
  start.shape.has_layer = has_layer;
  start.shape.fall_mm = rough.spacing_mm;
  CurveParameters& p = start.parameters;
  p[kBaseline] = rough.baseline_N;
  p[kContact] = rough.contact_mm;
  p[kCutting] = rough.cutting_N;
  p[kFriction] = std::max(rough.slope_N_per_mm, 0.0);
  std::vector<CurveSolution> starts;
  if (!has_layer) {
    for (const double factor : {1.0, 0.4, 3.0}) {
      p[kLogStiffness] = std::log(factor * rough.stiffness_N_per_mm);
      starts.push_back(start);
    }
    return starts;
  }
  for (const double end_mm : steepest_falls(rough)) {
    double peak_N = 0;
    for (const CurveMean& mean : rough.insertion)
      if (mean.depth_mm <= end_mm) peak_N = std::max(peak_N, mean.force_N - rough.baseline_N);
    for (const double factor : {1.0, 2.5})
      for (const double fall_mm : {0.3, 2.0, 8.0}) {
        CurveSolution each = start;
        each.shape.fall_mm = fall_mm * rough.spacing_mm;
        each.parameters[kLayerForce] = peak_N;
        const double stiffness = factor * rough.stiffness_N_per_mm;
        each.parameters[kLogStiffness] = std::log(stiffness);
        each.parameters[kLayerEnd] = end_mm;
        starts.push_back(each);
      }
  }
  return starts;
}

}  // namespace trocar::runtime
