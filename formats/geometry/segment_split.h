// SPDX-License-Identifier: Apache-2.0
// Lattice points at which refinement may split a boundary edge. Near an acute corner of the outline
// the splits lie on concentric shells around the corner. So the subsegments of the two edges that
// meet there end at equal distances and do not encroach upon each other (Ruppert, 1995).
// Tests: tests/formats/geometry/triangle_operations_test.cpp
#pragma once

#include <cmath>
#include <optional>

#include "formats/geometry/edge_predicates.h"
#include "formats/geometry/steiner_points.h"

namespace trocar {

/// A corner has shells if its angle in the material is below this.
inline constexpr double kAcuteCorner_deg = 75, kAcuteCorner_cos = 0.25881904510252074;
/// Two points are on the same shell if their distances from the corner differ by at most this many
/// steps.
inline constexpr double kSameShell_steps = 2;

/// Among the four lattice points around the point at this fraction from a to b, the nearest one
/// that may_split() the edge ab of the triangle abc; std::nullopt if none of the four may.
inline std::optional<LatticePoint> split_near(LatticePoint a, LatticePoint b, LatticePoint c,
                                              double fraction) noexcept {
  const double x = fraction * (static_cast<double>(b.x) - a.x),
               y = fraction * (static_cast<double>(b.y) - a.y);
  const LatticePoint near{round_half_up(a.x, x), round_half_up(a.y, y)};
  const double off_x = x - (static_cast<double>(near.x) - a.x),
               off_y = y - (static_cast<double>(near.y) - a.y);
  // One step towards the exact point along each axis. Which of the four points lie on the inner
  // side of ab cannot be predicted, so the code does not branch on it. The nearest one that does is
  // nearly always allowed.
  const std::int32_t step_x = 1 - 2 * static_cast<std::int32_t>(off_x < 0),
                     step_y = 1 - 2 * static_cast<std::int32_t>(off_y < 0);
  const auto x_first = static_cast<std::int32_t>(std::abs(off_x) > std::abs(off_y));
  const std::int64_t dx = std::int64_t{b.x} - a.x, dy = std::int64_t{b.y} - a.y;
  const std::int64_t side = orient2d(a, b, near), beside_x = side - step_x * dy,
                     beside_y = side + step_y * dx;
  const auto is_left = [](std::int64_t product) { return static_cast<std::int32_t>(product >= 0); };
  const std::int32_t x_is_left = is_left(beside_x), y_is_left = is_left(beside_y),
                     is_last = (x_is_left | y_is_left) ^ 1,
                     prefers_x = (x_is_left & (x_first | (y_is_left ^ 1))),
                     moves = is_left(side) ^ 1;
  const std::int32_t goes_x = moves & (is_last | prefers_x), goes_y = moves & (prefers_x ^ 1);
  const LatticePoint first{near.x + goes_x * step_x, near.y + goes_y * step_y};
  if (may_split(a, b, c, first)) [[likely]]
    return first;
  const LatticePoint beside_in_x{near.x + step_x, near.y}, beside_in_y{near.x, near.y + step_y},
      last{near.x + step_x, near.y + step_y};
  const LatticePoint second = x_first != 0 ? beside_in_x : beside_in_y,
                     third = x_first != 0 ? beside_in_y : beside_in_x;
  for (const LatticePoint m : {near, second, third, last}) {
    if (may_split(a, b, c, m)) return m;
  }
  return std::nullopt;
}

/// The wanted position of a split on an edge ab.
struct SplitAim {
  double fraction;  ///< 0 at a, 1 at b
  bool on_shell_of_a,
      on_shell_of_b;  ///< the split shall lie on a shell around this end; at most one of the two
};

/// The lattice point exactly on ab, other than a and b, that is nearest to the aim; std::nullopt if
/// there is no such point.
std::optional<LatticePoint> split_on_edge(LatticePoint a, LatticePoint b, SplitAim aim) noexcept;

/// A lattice point near the aim that may_split() the edge ab of the triangle abc and lies less than
/// a step from this edge. Among several, the result is the point nearest to the shell or, if there
/// is no shell, the point nearest to the edge (at most half a step from the edge if the aim is the
/// midpoint). std::nullopt if there is no such point.
std::optional<LatticePoint> split_beside_edge(LatticePoint a, LatticePoint b, LatticePoint c,
                                              SplitAim aim) noexcept;

}  // namespace trocar
