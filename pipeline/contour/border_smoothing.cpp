// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/contour/border_smoothing.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>

namespace trocar::pipeline {
namespace {

constexpr std::size_t kCrossingsPerSigma = 14;
constexpr std::size_t kMaxSigma = 3;
constexpr std::size_t kMaxKernelCrossings = kCrossingsPerSigma * kMaxSigma;  // crossings
constexpr std::size_t kMinCrossings = 6;  // a shorter border would hardly move: sigma is below 0.4
// In each pass, crossings that the curve would move beyond their pixels are clamped, and the next
// curve takes account of that.
constexpr int kPasses = 6;
constexpr double kFar = 1e9;
// Rounds that restore the area after the last pass; one is enough after the earlier ones.
constexpr int kRounds = 8;
constexpr std::size_t kWindow = 4;  // crossings on either side where the curve may meet a grid line

// The kernel from its middle outwards, for borders of n crossings.
std::vector<double> make_kernel(std::size_t n) {
  const double sigma = static_cast<double>(n) / static_cast<double>(kCrossingsPerSigma);
  const auto radius = static_cast<std::size_t>(std::ceil(3 * std::sqrt(2.0) * sigma));
  std::array<double, 2> sums{};
  const auto gauss = [sigma](std::size_t k, int twice) {
    const auto x = static_cast<double>(k);
    return std::exp(-x * x / (2 * sigma * sigma * (1 + twice)));
  };
  for (std::size_t k = 0; k <= radius; ++k) {
    for (int twice = 0; twice < 2; ++twice)
      sums[static_cast<std::size_t>(twice)] += (k == 0 ? 1 : 2) * gauss(k, twice);
  }
  // Weights are rounded to 2^-24, because the last bits of exp() may differ between machines.
  constexpr double kStep = 1.0 / (1 << 24);
  std::vector<double> out(radius + 1);
  double rest = 0;
  for (std::size_t k = 1; k <= radius; ++k) {
    out[k] = std::rint((2 * gauss(k, 0) / sums[0] - gauss(k, 1) / sums[1]) / kStep) * kStep;
    rest += 2 * out[k];
  }
  out[0] = 1 - rest;
  return out;
}

std::span<const double> kernel(std::size_t n) {
  static const std::vector<std::vector<double>> kKernels = [] {
    std::vector<std::vector<double>> out(kMaxKernelCrossings + 1);
    for (std::size_t k = kMinCrossings; k <= kMaxKernelCrossings; ++k)
      out[k] = make_kernel(k);
    return out;
  }();
  return kKernels[std::min(n, kMaxKernelCrossings)];
}

Point position(const Crossing& c) {
  return {c.x + (c.along_v ? 0 : c.t), c.y + (c.along_v ? c.t : 0)};
}

// Consecutive crossings none of which is fixed.
class FreeCrossings {
 public:
  FreeCrossings(std::span<Crossing> crossings, const std::optional<BorderEnds>& ends)
      : crossings_(crossings), ends_(ends), n_(crossings.size()) {}

  void smooth() {
    const std::span<const double> weights = kernel(n_);
    const std::size_t margin = std::max(weights.size() - 1, kWindow);
    std::vector<Point> points(n_), curve(n_);
    locate(points);
    const double area = doubled_area(points);
    for (int pass = 0; pass < kPasses; ++pass) {
      const std::vector<Point> wide = extended(points, margin);
      for (std::size_t i = 0; i < n_; ++i) {
        const Point* at = &wide[i + margin];
        Point sum{weights[0] * at->x, weights[0] * at->y};
        for (std::size_t k = 1; k < weights.size(); ++k) {
          const Point &before = *(at - k), &after = *(at + k);
          sum.x += weights[k] * (before.x + after.x);
          sum.y += weights[k] * (before.y + after.y);
        }
        curve[i] = sum;
      }
      put_back(extended(curve, kWindow));
      restore(area, points, pass + 1 < kPasses ? 1 : kRounds);
    }
  }

 private:
  void locate(std::vector<Point>& points) const {
    for (std::size_t i = 0; i < n_; ++i)
      points[i] = position(crossings_[i]);
  }

  // Beyond its ends an open border continues as its own point reflection; a closed one is periodic.
  std::vector<Point> extended(const std::vector<Point>& points, std::size_t margin) const {
    std::vector<Point> out(n_ + 2 * margin);
    std::copy(points.begin(), points.end(), out.begin() + static_cast<std::ptrdiff_t>(margin));
    for (std::size_t k = 0; k < margin; ++k) {
      Point &before = out[margin - 1 - k], &after = out[margin + n_ + k];
      if (!ends_) {
        before = points[n_ - 1 - k % n_];
        after = points[k % n_];
      } else if (k == 0) {
        before = ends_->from;
        after = ends_->to;
      } else {
        const Point p = points[k - 1], q = points[n_ - k];
        before = {2 * ends_->from.x - p.x, 2 * ends_->from.y - p.y};
        after = {2 * ends_->to.x - q.x, 2 * ends_->to.y - q.y};
      }
    }
    return out;
  }

  // Moves each crossing to the point where the curve meets its grid line, near the crossing's own
  // point of the curve.
  void put_back(const std::vector<Point>& curve) {
    for (std::size_t i = 0; i < n_; ++i) {
      Crossing& c = crossings_[i];
      const std::size_t middle = i + kWindow;
      const double line = c.along_v ? c.x : c.y;
      const auto along = [&c](Point p) { return c.along_v ? p.y : p.x; };
      const auto off = [&c, line](Point p) { return (c.along_v ? p.x : p.y) - line; };
      const double here = along(curve[middle]);
      double best = here, least = kFar;
      const auto meet = [&](const Point& p, const Point& q) {
        const double f = off(p), g = off(q);
        if ((f > 0) == (g > 0)) return;
        const double at = along(p) + f / (f - g) * (along(q) - along(p));
        if (std::abs(at - here) < least) least = std::abs(at - here), best = at;
      };
      for (std::size_t k = 0; k < kWindow && least == kFar; ++k) {
        meet(curve[middle - k - 1], curve[middle - k]);
        meet(curve[middle + k], curve[middle + k + 1]);
      }
      c.t = clamped(best - (c.along_v ? c.y : c.x));
    }
  }

  static double clamped(double t) {
    return std::clamp(t, kMinPixelDistance, 1 - kMinPixelDistance);
  }

  Point before(const std::vector<Point>& points, std::size_t i) const {
    return i > 0 ? points[i - 1] : ends_ ? ends_->from : points[n_ - 1];
  }
  Point after(const std::vector<Point>& points, std::size_t i) const {
    return i + 1 < n_ ? points[i + 1] : ends_ ? ends_->to : points[0];
  }

  // Twice the area inside the border, which is closed by the line from its end to its start if it
  // is open. Coordinates are relative to the first point.
  double doubled_area(const std::vector<Point>& points) const {
    const Point o = before(points, 0);
    double sum = 0;
    for (std::size_t i = 0; i < n_; ++i) {
      const Point p = points[i], q = after(points, i);
      sum += (p.x - o.x) * (q.y - o.y) - (p.y - o.y) * (q.x - o.x);
    }
    return sum;
  }

  // Moves the crossings in proportion to the area that each one's move gains, until the area is
  // `area`. Few rounds suffice: only the products of neighbours' moves and the clamped crossings
  // remain after each.
  void restore(double area, std::vector<Point>& points, int rounds) {
    constexpr double kNegligible = 1e-7;  // pixels^2
    for (int round = 0;; ++round) {
      locate(points);
      const double missing = area - doubled_area(points);
      if (round == rounds || std::abs(missing) < kNegligible) return;
      double squares = 0;
      for (std::size_t i = 0; i < n_; ++i) {
        const double g = free_gain(points, i, missing);
        squares += g * g;
      }
      if (squares < 1e-9) return;
      for (std::size_t i = 0; i < n_; ++i) {
        Crossing& c = crossings_[i];
        c.t = clamped(c.t + free_gain(points, i, missing) * missing / squares);
      }
    }
  }

  // The change of twice the area if crossing i moves by one pixel; 0 if it cannot move in the
  // direction that reduces `missing`.
  double free_gain(const std::vector<Point>& points, std::size_t i, double missing) const {
    const Point p = before(points, i), q = after(points, i);
    const Crossing& c = crossings_[i];
    const double gain = c.along_v ? p.x - q.x : q.y - p.y;
    const bool is_up = gain * missing > 0;
    return is_up ? (c.t < 1 - kMinPixelDistance ? gain : 0) : (c.t > kMinPixelDistance ? gain : 0);
  }

  std::span<Crossing> crossings_;
  const std::optional<BorderEnds>& ends_;
  std::size_t n_;
};

}  // namespace

void smooth_border(std::vector<Crossing>& border, const std::optional<BorderEnds>& ends) {
  const auto is_fixed = [](const Crossing& c) { return c.fixed; };
  const auto first = std::find_if(border.begin(), border.end(), is_fixed);
  if (first == border.end()) {
    if (border.size() >= kMinCrossings) FreeCrossings(border, ends).smooth();
    return;
  }
  if (!ends) std::rotate(border.begin(), first, border.end());
  for (std::size_t i = 0; i < border.size();) {
    if (border[i].fixed) {
      ++i;
      continue;
    }
    std::size_t end = i;
    while (end < border.size() && !border[end].fixed)
      ++end;
    if (end - i >= kMinCrossings) {
      const std::optional<BorderEnds> run_ends = BorderEnds{
          i > 0 ? position(border[i - 1]) : ends->from, end < border.size() ? position(border[end])
                                                        : ends              ? ends->to
                                                                            : position(border[0])};
      FreeCrossings(std::span(border).subspan(i, end - i), run_ends).smooth();
    }
    i = end;
  }
}

}  // namespace trocar::pipeline
