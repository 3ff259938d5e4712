// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/contour/contour_crossing.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

namespace trocar::pipeline {
namespace {

// The place of a jump between the flats on either side that leaves the line's sum as it is.
std::optional<double> jump_between_flats(const GridLine& line) {
  const auto& f = line.value;
  int from = 2, to = 5;
  while (from > line.first && f[from] != f[from - 1])
    --from;
  while (to < line.last && f[to] != f[to + 1])
    ++to;
  if (from <= line.first || to >= line.last) return std::nullopt;
  const double low = f[from], high = f[to], rise = high - low;
  // A jump has no place of its own away from the middle: there the blur counts.
  if (!(std::abs(low + high) < 0.2 * std::abs(rise))) return std::nullopt;
  double at = from + 0.5 - 3;
  for (int i = from; i < to; ++i) {
    if ((f[i + 1] - f[i]) * rise < 0) return std::nullopt;
    if (i > from) at += (high - f[i]) / rise;
  }
  return std::clamp(at, 0.0, 1.0);
}

// Steffen's slope at a sample between the differences s and t: never more than lets it overshoot.
double slope(double s, double t) {
  if (!(s * t > 0)) return 0;
  return std::copysign(2 * std::min({std::abs(s), std::abs(t), 0.25 * std::abs(s + t)}), s);
}

}  // namespace

double crossing(const GridLine& line) {
  const auto& f = line.value;
  if (const auto jump = jump_between_flats(line)) return *jump;
  const double rise = f[4] - f[3];
  const double m3 = line.first <= 2 ? slope(f[3] - f[2], rise) : rise;
  const double m4 = line.last >= 5 ? slope(rise, f[5] - f[4]) : rise;
  const double c2 = 3 * rise - 2 * m3 - m4, c3 = m3 + m4 - 2 * rise;
  // Newton's method, kept in the bracket that its own values narrow.
  double low = 0, high = 1, t = f[3] / (f[3] - f[4]);
  for (int i = 0; i < 32; ++i) {
    const double value = f[3] + t * (m3 + t * (c2 + t * c3));
    ((value >= 0) == (f[3] >= 0) ? low : high) = t;
    const double step = value / (m3 + t * (2 * c2 + t * 3 * c3));
    const double next = t - step;
    if (std::abs(step) < 1e-6) break;
    t = next > low && next < high ? next : 0.5 * (low + high);
  }
  return t;
}

void restore_chord_areas(std::span<Crossing> ring) {
  constexpr double kMostCurved = 1;  // 1 / pixel; more is a corner
  constexpr double kFarthest = 1.0 / 16;
  constexpr std::size_t kReach = 3;  // neighbours: two pixels or so
  const std::size_t n = ring.size();
  const std::size_t reach = std::min(kReach, (n - 1) / 3);
  if (n < 4) return;
  struct Step {
    double u, v;
    double squared() const { return u * u + v * v; }
    double length() const { return std::sqrt(squared()); }
  };
  const auto step = [&ring](const std::size_t from, const std::size_t to) {
    const Crossing &a = ring[from], &b = ring[to];
    return Step{b.x - a.x + ((b.along_v ? 0 : b.t) - (a.along_v ? 0 : a.t)),
                b.y - a.y + ((b.along_v ? b.t : 0) - (a.along_v ? a.t : 0))};
  };
  // Of each crossing: the area missing about it, by the curvature of the circle through it and the
  // third neighbours on either side, which noise in their places hardly bends; and the area that
  // the polygon gains as it moves by one along its grid line.
  struct Share {
    double missing = 0, gain = 0;
  };
  thread_local std::vector<Share> shares;
  shares.assign(n, {});
  const auto wrapped = [n](std::size_t i) { return i < n ? i : i - n; };
  for (std::size_t i = 0; i < n; ++i) {
    if (ring[i].fixed) continue;
    const Step in = step(wrapped(i + n - reach), i), out = step(i, wrapped(i + reach));
    const double sides =
        std::sqrt(in.squared() * out.squared() * Step{in.u + out.u, in.v + out.v}.squared());
    if (!(sides > 1e-9)) continue;
    const double curvature =
        std::clamp(2 * (in.u * out.v - in.v * out.u) / sides, -kMostCurved, kMostCurved);
    const Step before = step(wrapped(i + n - 1), i), after = step(i, wrapped(i + 1));
    const double c1 = before.length(), c2 = after.length();
    shares[i].missing = curvature * (c1 * c1 * c1 + c2 * c2 * c2) / 24;
    shares[i].gain = ring[i].along_v ? -0.5 * (before.u + after.u) : 0.5 * (before.v + after.v);
  }
  // What is missing within the reach is made up by those crossings there that can, each as much as
  // moving it gains: one whose grid line runs along the outline would move far for nothing.
  for (std::size_t i = 0; i < n; ++i) {
    double missing = 0, squares = 0;
    for (std::size_t k = i + n - reach; k <= i + n + reach; ++k) {
      const Share& share = shares[k % n];
      missing += share.missing;
      squares += share.gain * share.gain;
    }
    if (squares > 1e-9)
      ring[i].t += std::clamp(shares[i].gain * missing / squares, -kFarthest, kFarthest);
  }
}

}  // namespace trocar::pipeline
