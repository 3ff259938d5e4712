// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/contour/contour_crossing.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

namespace trocar::pipeline {
namespace {

// The position of a jump between the constant values on either side that gives the same sum.
std::optional<double> jump_between_flats(const GridLine& line) {
  const auto& f = line.value;
  int from = 2, to = 5;
  while (from > line.first && f[from] != f[from - 1])
    --from;
  while (to < line.last && f[to] != f[to + 1])
    ++to;
  if (from <= line.first || to >= line.last) return std::nullopt;
  const double low = f[from], high = f[to], rise = high - low;
  // If the iso-value is not near the middle, its crossing depends on how blurred the edge is.
  if (!(std::abs(low + high) < 0.2 * std::abs(rise))) return std::nullopt;
  double at = from + 0.5 - 3;
  for (int i = from; i < to; ++i) {
    if ((f[i + 1] - f[i]) * rise < 0) return std::nullopt;
    if (i > from) at += (high - f[i]) / rise;
  }
  return std::clamp(at, 0.0, 1.0);
}

// Steffen's slope at a sample between the differences s and t: limited so that the interpolant does
// not overshoot.
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
  // Newton's method inside a bracket that shrinks with every value.
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
  constexpr double kMaxCurvature = 1;  // 1 / pixel; more is a corner
  constexpr double kMaxShift = 1.0 / 16;
  constexpr std::size_t kReach = 3;  // neighbours on either side: about two pixels
  const std::size_t n = ring.size();
  const std::size_t reach = std::min(kReach, (n - 1) / 3);
  if (n < 4) return;
  struct Offset {
    double u, v;
    double squared() const { return u * u + v * v; }
    double length() const { return std::sqrt(squared()); }
  };
  const auto step = [&ring](const std::size_t from, const std::size_t to) {
    const Crossing &a = ring[from], &b = ring[to];
    return Offset{b.x - a.x + ((b.along_v ? 0 : b.t) - (a.along_v ? 0 : a.t)),
                  b.y - a.y + ((b.along_v ? b.t : 0) - (a.along_v ? a.t : 0))};
  };
  // For each crossing: half of the area that its two chords cut off, from the curvature of the
  // circle through it and its third neighbours on either side (nearer ones would make the curvature
  // noisy); and the area that the polygon gains as the crossing moves by one pixel along its grid
  // line.
  struct Share {
    double missing = 0, gain = 0;
  };
  thread_local std::vector<Share> shares;
  shares.assign(n, {});
  const auto wrapped = [n](std::size_t i) { return i < n ? i : i - n; };
  for (std::size_t i = 0; i < n; ++i) {
    if (ring[i].fixed) continue;
    const Offset in = step(wrapped(i + n - reach), i), out = step(i, wrapped(i + reach));
    const double sides =
        std::sqrt(in.squared() * out.squared() * Offset{in.u + out.u, in.v + out.v}.squared());
    if (!(sides > 1e-9)) continue;
    const double curvature =
        std::clamp(2 * (in.u * out.v - in.v * out.u) / sides, -kMaxCurvature, kMaxCurvature);
    const Offset before = step(wrapped(i + n - 1), i), after = step(i, wrapped(i + 1));
    const double c1 = before.length(), c2 = after.length();
    shares[i].missing = curvature * (c1 * c1 * c1 + c2 * c2 * c2) / 24;
    shares[i].gain = ring[i].along_v ? -0.5 * (before.u + after.u) : 0.5 * (before.v + after.v);
  }
  // The area missing within the reach is spread over its crossings, in proportion to what moving
  // each of them gains: a crossing whose grid line runs along the outline hardly moves.
  for (std::size_t i = 0; i < n; ++i) {
    double missing = 0, squares = 0;
    for (std::size_t k = i + n - reach; k <= i + n + reach; ++k) {
      const Share& share = shares[k % n];
      missing += share.missing;
      squares += share.gain * share.gain;
    }
    if (squares > 1e-9)
      ring[i].t += std::clamp(shares[i].gain * missing / squares, -kMaxShift, kMaxShift);
  }
}

}  // namespace trocar::pipeline
