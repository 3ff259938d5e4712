// SPDX-License-Identifier: Apache-2.0
// Lattice points at which refinement may split a boundary edge. Near an acute corner of the outline
// the splits lie on concentric shells around the corner, so that the pieces of the two edges that
// meet there end at equal distances and do not encroach upon each other (Ruppert, 1995).
#pragma once

#include <cmath>
#include <optional>

#include "formats/geometry/edge_predicates.h"
#include "formats/geometry/steiner_places.h"

namespace trocar {

/// Corners at which the angle in the material is below this have shells.
inline constexpr double kAcuteCorner_deg = 75, kAcuteCorner_cos = 0.25881904510252074;
/// Distances from a corner that differ by no more than this many steps are on one shell.
inline constexpr double kSameShell_steps = 2;

/// The lattice point nearest to the point at this fraction from a to b, among the four around it,
/// that may_split() the edge ab of the triangle abc; none if none of the four may.
inline std::optional<LatticePoint> split_near(LatticePoint a, LatticePoint b, LatticePoint c,
                                              double fraction) noexcept {
  const double x = fraction * (static_cast<double>(b.x) - a.x),
               y = fraction * (static_cast<double>(b.y) - a.y);
  const LatticePoint near{round_half_up(a.x, x), round_half_up(a.y, y)};
  const double off_x = x - (static_cast<double>(near.x) - a.x),
               off_y = y - (static_cast<double>(near.y) - a.y);
  // One step towards the place along each axis. Which of the four places lie on the right side of
  // ab cannot be predicted, so nothing here branches on that; the first that does is nearly always
  // allowed.
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

/// Where on an edge ab a split is wanted.
struct SplitAim {
  double fraction;                    ///< of the way from a to b
  bool on_shell_of_a, on_shell_of_b;  ///< the distance from this end matters; at most one of them
};

/// The lattice point exactly on ab that is nearest to the aim and is neither a nor b; none if there
/// is none.
std::optional<LatticePoint> split_on_edge(LatticePoint a, LatticePoint b, SplitAim aim) noexcept;

/// Of the lattice points near the aim that may_split() the edge ab of the triangle abc and lie less
/// than a step from it: the one nearest to the shell or, without a shell, to the edge (for the
/// middle of the edge no more than half a step off); none if there is no such point.
std::optional<LatticePoint> split_beside_edge(LatticePoint a, LatticePoint b, LatticePoint c,
                                              SplitAim aim) noexcept;

}  // namespace trocar
