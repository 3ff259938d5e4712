// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/outline_error.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace trocar::pipeline::bench {
namespace {

using sample::CrossSection;
using sample::SectionDistance;
using sample::Vec2;

// Distances from the curve `from` to another: samples every step_mm of arc go into `samples`; they
// and the vertices go into the maximum.
void directed(const CrossSection& from, const SectionDistance& to, double step_mm,
              std::vector<float>& samples, double& max_mm) {
  for (const std::vector<Vec2>& ring : from.rings) {
    double next = step_mm / 2;  // of arc length, from the current edge's start
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const Vec2 a = ring[i], ab = ring[(i + 1) % ring.size()] - a;
      const double length = std::sqrt(dot(ab, ab));
      max_mm = std::max(max_mm, std::abs(to(a)));
      while (next < length) {
        const double d = std::abs(to(a + (next / length) * ab));
        samples.push_back(static_cast<float>(d));
        max_mm = std::max(max_mm, d);
        next += step_mm;
      }
      next -= length;
    }
  }
}

double mean(const std::vector<float>& values) {
  if (values.empty()) return 0;
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

}  // namespace

CrossSection as_section(const Pslg& outline, const Lattice& lattice) {
  CrossSection out;
  out.area_mm2 =
      0.5 * static_cast<double>(doubled_area(outline)) * lattice.step_mm() * lattice.step_mm();
  for (const Ring& ring : outline.rings) {
    auto& points = out.rings.emplace_back();
    for (const LatticePoint p : ring)
      points.push_back({lattice.to_mm(p.x), lattice.to_mm(p.y)});
  }
  return out;
}

Truth::Truth(CrossSection truth) : section(std::move(truth)), distance(section) {}

void add_errors(const CrossSection& outline, const Truth& truth, double step_mm,
                ErrorSamples& into) {
  if (outline.rings.empty() || truth.section.rings.empty()) {
    if (outline.rings.empty() != truth.section.rings.empty()) ++into.unmatched;
    return;
  }
  directed(outline, truth.distance, step_mm, into.outline_to_truth_mm,
           into.outline_to_truth_max_mm);
  directed(truth.section, SectionDistance(outline), step_mm, into.truth_to_outline_mm,
           into.truth_to_outline_max_mm);
  into.area_mm2 += outline.area_mm2;
  into.truth_area_mm2 += truth.section.area_mm2;
  into.worst_area_error =
      std::max(into.worst_area_error, std::abs(outline.area_mm2 / truth.section.area_mm2 - 1));
}

ErrorSummary summarise(const ErrorSamples& samples) {
  ErrorSummary out;
  out.hausdorff_mm = std::max(samples.outline_to_truth_max_mm, samples.truth_to_outline_max_mm);
  out.mean_mm = 0.5 * (mean(samples.outline_to_truth_mm) + mean(samples.truth_to_outline_mm));
  std::vector<float> all = samples.outline_to_truth_mm;
  all.insert(all.end(), samples.truth_to_outline_mm.begin(), samples.truth_to_outline_mm.end());
  if (!all.empty()) {
    const auto at = all.begin() + static_cast<std::ptrdiff_t>(all.size() * 99 / 100);
    std::nth_element(all.begin(), at, all.end());
    out.p99_mm = static_cast<double>(*at);
  }
  if (samples.truth_area_mm2 > 0) out.area_error = samples.area_mm2 / samples.truth_area_mm2 - 1;
  return out;
}

}  // namespace trocar::pipeline::bench
