// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/contour/contour_crossing.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <vector>

namespace trocar::pipeline {
namespace {

// The position of a jump between the constant values on both sides that gives the same sum of
// samples; nothing if the samples do not rise or fall monotonically between two constant values.
std::optional<double> jump_between_flats(const GridLine& line) {
  const auto& f = line.value;
  int from = 2, to = 5;
  while (from > line.first && f[from] != f[from - 1])
    --from;
  if (from <= line.first) return std::nullopt;
  while (to < line.last && f[to] != f[to + 1])
    ++to;
  if (to >= line.last) return std::nullopt;
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
  // Newton's method inside a bracket that shrinks with every value. The end of the bracket is
  // chosen without a branch, because the branch would be unpredictable.
  std::array<double, 2> bracket{0, 1};
  double t = f[3] / (f[3] - f[4]);
  for (int i = 0; i < 32; ++i) {
    const double value = f[3] + t * (m3 + t * (c2 + t * c3));
    bracket[(value >= 0) == (f[3] >= 0) ? 0 : 1] = t;
    const double step = value / (m3 + t * (2 * c2 + t * 3 * c3));
    const double next = t - step;
    if (std::abs(step) < 1e-6) break;
    t = next > bracket[0] && next < bracket[1] ? next : 0.5 * (bracket[0] + bracket[1]);
  }
  return t;
}

void restore_chord_areas(std::span<Crossing> ring) {
  constexpr double kMaxCurvature = 1;  // 1 / pixel; more is a corner
  constexpr double kMaxShift = 1.0 / 16;
  constexpr std::size_t kNeighbours = 3;  // neighbours on either side: about two pixels
  const std::size_t n = ring.size();
  const std::size_t neighbours = std::min(kNeighbours, (n - 1) / 3);
  if (n < 4) return;
  struct Offset {
    double u, v;
    double squared() const { return u * u + v * v; }
    double length() const { return std::sqrt(squared()); }
  };
  // The arrays below have one entry per crossing, and copies of the nearest `neighbours` entries
  // before the first and after the last, so that no index has to wrap round.
  const auto wrap = [n, neighbours](auto* values) {
    std::copy(values + n, values + n + neighbours, values);
    std::copy(values + neighbours, values + 2 * neighbours, values + n + neighbours);
  };
  // A crossing's position: the pixel before it (x, y) plus the offset (u, v) from there. Keeping
  // the two apart avoids rounding errors in differences.
  struct Position {
    double x, y, u, v;
  };
  thread_local std::vector<Position> all_positions;
  all_positions.resize(n + 2 * neighbours);
  Position* const positions = all_positions.data() + neighbours;
  for (std::size_t i = 0; i < n; ++i) {
    const double v = ring[i].along_v ? 1 : 0;
    positions[i] = {static_cast<double>(ring[i].x), static_cast<double>(ring[i].y),
                    (1 - v) * ring[i].t, v * ring[i].t};
  }
  wrap(all_positions.data());
  const auto step = [](const Position& a, const Position& b) {
    return Offset{b.x - a.x + (b.u - a.u), b.y - a.y + (b.v - a.v)};
  };
  // Each crossing accounts for half of the area that its two chords cut off. Curvature is that of
  // the circle through the crossing and its third neighbours on both sides, since nearer neighbours
  // would make it noisy. `gain` is the area that the polygon gains if the crossing moves by one
  // pixel along its grid line.
  struct ChordArea {
    double missing = 0, gain = 0;
  };
  thread_local std::vector<ChordArea> all_areas;
  all_areas.assign(n + 2 * neighbours, {});
  ChordArea* const areas = all_areas.data() + neighbours;
  for (std::size_t i = 0; i < n; ++i) {
    if (ring[i].fixed) continue;
    const Position* const at = positions + i;
    const Offset in = step(*(at - neighbours), *at), out = step(*at, *(at + neighbours));
    const double sides =
        std::sqrt(in.squared() * out.squared() * Offset{in.u + out.u, in.v + out.v}.squared());
    if (!(sides > 1e-9)) continue;
    const double curvature =
        std::clamp(2 * (in.u * out.v - in.v * out.u) / sides, -kMaxCurvature, kMaxCurvature);
    const Offset before = step(*(at - 1), *at), after = step(*at, *(at + 1));
    const double c1 = before.length(), c2 = after.length();
    areas[i].missing = curvature * (c1 * c1 * c1 + c2 * c2 * c2) / 24;
    areas[i].gain = ring[i].along_v ? -0.5 * (before.u + after.u) : 0.5 * (before.v + after.v);
  }
  wrap(all_areas.data());
  // The area missing around a crossing is spread over the neighbours in proportion to their gain: a
  // crossing whose grid line runs along the outline hardly moves.
  for (std::size_t i = 0; i < n; ++i) {
    double missing = 0, squares = 0;
    for (const ChordArea* area = areas + i - neighbours; area <= areas + i + neighbours; ++area) {
      missing += area->missing;
      squares += area->gain * area->gain;
    }
    if (squares > 1e-9)
      ring[i].t += std::clamp(areas[i].gain * missing / squares, -kMaxShift, kMaxShift);
  }
}

}  // namespace trocar::pipeline
