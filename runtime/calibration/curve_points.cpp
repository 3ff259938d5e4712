// SPDX-License-Identifier: Apache-2.0
#include "runtime/calibration/curve_points.h"

#include <algorithm>
#include <cmath>

#include "formats/base/text_line.h"

namespace trocar::runtime {
namespace {

constexpr std::size_t kMostMeans = 180, kMostWithdrawalMeans = 100;
constexpr std::size_t kMinBaseline = 5;  ///< means before contact
/// The force of the contact, as a part of the largest force of the curve.
constexpr double kContactPart = 0.05;
constexpr double kMinCut_mm = 1;
/// Stretches are halved while the force changes by more than this part of its range from one to the next.
constexpr double kMostChange = 0.04;
constexpr int kMostSplits = 8;

/// Root mean square of the second differences, which a steady slope does not enter.
double noise_of(const std::vector<CurvePoint>& points) {
  std::vector<double> squares;
  for (std::size_t i = 2; i < points.size(); ++i) {
    const double d = points[i].force_N - 2 * points[i - 1].force_N + points[i - 2].force_N;
    squares.push_back(d * d / 6);
  }
  if (squares.empty()) return 0;
  // The median, because the break of a layer must not count; 0.455 is that of chi squared.
  const auto middle = squares.begin() + static_cast<std::ptrdiff_t>(squares.size() / 2);
  std::nth_element(squares.begin(), middle, squares.end());
  return std::sqrt(*middle / 0.455);
}

struct Line {
  double at_0 = 0, slope = 0;
};

Line line_through(const std::vector<CurveMean>& means, std::size_t first, double origin_mm) {
  double n = 0, x = 0, y = 0, xx = 0, xy = 0;
  for (std::size_t i = first; i < means.size(); ++i) {
    const double d = means[i].depth_mm - origin_mm, f = means[i].force_N;
    n += 1, x += d, y += f, xx += d * d, xy += d * f;
  }
  const double under = n * xx - x * x;
  if (!(under > 1e-12)) return {n > 0 ? y / n : 0, 0};
  Line line;
  line.slope = (n * xy - x * y) / under;
  line.at_0 = (y - line.slope * x) / n;
  return line;
}

/// The last mean before the force exceeds `level_N` for good at the beginning.
std::size_t contact_of(const std::vector<CurveMean>& means, double level_N) {
  std::size_t i = 0;
  while (i + 1 < means.size() && !(means[i].force_N > level_N && means[i + 1].force_N > level_N))
    ++i;
  return i;
}

/// Neighbouring points of a curve and their mean.
struct Stretch {
  std::size_t begin = 0, end = 0;
  CurveMean mean;
};

Stretch stretch_of(const std::vector<CurvePoint>& sorted, std::size_t begin, std::size_t end) {
  Stretch out{begin, end, {0, 0, static_cast<double>(end - begin)}};
  for (std::size_t i = begin; i < end; ++i) {
    out.mean.depth_mm += sorted[i].depth_mm / out.mean.samples;
    out.mean.force_N += sorted[i].force_N / out.mean.samples;
  }
  return out;
}

std::vector<Stretch> equal_stretches(const std::vector<CurvePoint>& sorted, std::size_t most) {
  std::vector<Stretch> stretches;
  if (sorted.empty()) return stretches;
  const double low = sorted.front().depth_mm, length = sorted.back().depth_mm - low;
  const double per_mm = length > 0 ? static_cast<double>(most) / length : 0;
  const auto index_of = [&](const CurvePoint& point) {
    return std::min(static_cast<std::size_t>((point.depth_mm - low) * per_mm), most - 1);
  };
  for (std::size_t begin = 0; begin < sorted.size();) {
    std::size_t end = begin + 1;
    while (end < sorted.size() && index_of(sorted[end]) == index_of(sorted[begin]))
      ++end;
    stretches.push_back(stretch_of(sorted, begin, end));
    begin = end;
  }
  return stretches;
}

Result<void> check_force(const RoughCurve& rough, double first_N, double high_N, double low_N) {
  const double samples = rough.insertion.front().samples;
  const double noise_N = std::max(6 * rough.noise_N / std::sqrt(samples), 1e-9);
  if (high_N - first_N > noise_N && high_N - first_N > 0.5 * (first_N - low_N)) {
    if (std::abs(first_N) > high_N - first_N)
      return refused(
          text_line("begins with a force of %.3g N, which then rises by %.3g N only; it must begin "
                    "before contact, with the load cell at 0",
                    first_N, high_N - first_N));
    return {};
  }
  if (first_N - low_N > noise_N)
    return refused(
        "the force never rises, it falls; force_N must be positive while the tissue resists the "
        "tool");
  return refused(
      text_line("no contact: the force never rises above its noise of %.3g N", rough.noise_N));
}

}  // namespace

std::vector<CurveMean> means_of(const std::vector<CurvePoint>& points, std::size_t most,
                                double noise_N) {
  std::vector<CurvePoint> sorted = points;
  std::stable_sort(sorted.begin(), sorted.end(), [](const CurvePoint& a, const CurvePoint& b) {
    return a.depth_mm < b.depth_mm;
  });
  std::vector<Stretch> stretches = equal_stretches(sorted, most * 3 / 5);
  for (int round = 0; round < kMostSplits; ++round) {
    double low_N = HUGE_VAL, high_N = -HUGE_VAL;
    for (const Stretch& each : stretches) {
      low_N = std::min(low_N, each.mean.force_N);
      high_N = std::max(high_N, each.mean.force_N);
    }
    std::vector<Stretch> next;
    const std::size_t n = stretches.size();
    for (std::size_t i = 0; i < n; ++i) {
      const Stretch& each = stretches[i];
      const CurveMean &before = stretches[i > 0 ? i - 1 : 0].mean,
                      &after = stretches[std::min(i + 1, n - 1)].mean;
      const double max_N =
          std::max(kMostChange * (high_N - low_N),
                   4 * noise_N * std::sqrt(1 / before.samples + 1 / after.samples));
      // Halves of points of one depth would have the same depth.
      const bool splits = std::abs(after.force_N - before.force_N) > 2 * max_N &&
                          sorted[each.begin].depth_mm < sorted[each.end - 1].depth_mm &&
                          next.size() + n - i < most;
      const std::size_t middle = splits ? (each.begin + each.end) / 2 : each.end;
      next.push_back(stretch_of(sorted, each.begin, middle));
      if (splits) next.push_back(stretch_of(sorted, middle, each.end));
    }
    if (next.size() == n) break;
    stretches = std::move(next);
  }
  std::vector<CurveMean> means;
  means.reserve(stretches.size());
  for (const Stretch& each : stretches)
    means.push_back(each.mean);
  return means;
}

Result<RoughCurve> rough_curve(const ForceCurve& curve) {
  RoughCurve rough;
  rough.noise_N = noise_of(curve.insertion);
  rough.insertion = means_of(curve.insertion, kMostMeans, rough.noise_N);
  rough.withdrawal = means_of(curve.withdrawal, kMostWithdrawalMeans, rough.noise_N);
  const std::vector<CurveMean>& means = rough.insertion;
  if (means.size() < kMinCurveRows)
    return refused(text_line("has %zu different depths, and must have at least %zu", means.size(),
                             kMinCurveRows));
  rough.deepest_mm = means.back().depth_mm;
  rough.spacing_mm =
      (means.back().depth_mm - means.front().depth_mm) / static_cast<double>(means.size() - 1);
  const auto [low, high] = std::ranges::minmax(means, {}, &CurveMean::force_N);
  const double first_N = (means[0].force_N + means[1].force_N + means[2].force_N) / 3;
  if (const auto good = check_force(rough, first_N, high.force_N, low.force_N); !good)
    return good.error();

  const std::size_t contact = contact_of(means, first_N + kContactPart * (high.force_N - first_N));
  rough.contact_mm = means[contact].depth_mm;
  rough.has_baseline = contact >= kMinBaseline;
  if (rough.has_baseline) {
    for (std::size_t i = 0; i < contact; ++i)
      rough.baseline_N += means[i].force_N / static_cast<double>(contact);
  }
  if (rough.deepest_mm - rough.contact_mm < kMinCut_mm || means.size() - contact < 12)
    return refused(
        text_line("only %.2g mm lie behind the contact at %.2f mm; it must go at least %g mm deep",
                  rough.deepest_mm - rough.contact_mm, rough.contact_mm, kMinCut_mm));
  const std::size_t deep = contact + (means.size() - contact) * 2 / 5;
  const Line line = line_through(means, deep, rough.contact_mm);
  rough.slope_N_per_mm = line.slope;
  rough.cutting_N = line.at_0 - rough.baseline_N;
  const double least_N = 0.1 * (high.force_N - rough.baseline_N);
  if (!(rough.cutting_N > least_N)) rough.cutting_N = least_N;
  std::size_t i = contact;
  while (i + 1 < means.size() && means[i].force_N - rough.baseline_N < 0.5 * rough.cutting_N)
    ++i;
  const std::size_t rise = std::max(i, contact + 1) - contact;
  const double rise_mm = means[contact + rise].depth_mm - rough.contact_mm;
  rough.rise_spacing_mm = rise_mm / static_cast<double>(rise);
  rough.stiffness_N_per_mm =
      std::max(means[i].force_N - rough.baseline_N, 0.5 * rough.cutting_N) / rise_mm;
  return rough;
}

}  // namespace trocar::runtime
