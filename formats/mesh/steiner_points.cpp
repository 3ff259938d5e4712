// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/steiner_points.h"

#include <numeric>

namespace trocar {

std::optional<LatticePoint> split_on_edge(LatticePoint a, LatticePoint b, SplitAim aim) noexcept {
  const std::int64_t dx = std::int64_t{b.x} - a.x, dy = std::int64_t{b.y} - a.y;
  const std::int64_t parts = std::gcd(dx, dy);
  if (parts < 2) return std::nullopt;
  const std::int64_t k = std::clamp<std::int64_t>(
      std::llrint(aim.fraction * static_cast<double>(parts)), 1, parts - 1);
  return LatticePoint{static_cast<std::int32_t>(a.x + dx / parts * k),
                      static_cast<std::int32_t>(a.y + dy / parts * k)};
}

std::optional<LatticePoint> split_beside_edge(LatticePoint a, LatticePoint b, LatticePoint c,
                                              SplitAim aim) noexcept {
  const double dx = static_cast<double>(b.x) - a.x, dy = static_cast<double>(b.y) - a.y;
  const double length = std::sqrt(dx * dx + dy * dy);
  const LatticePoint corner = aim.on_shell_of_b ? b : a;
  const double shell = (aim.on_shell_of_b ? 1 - aim.fraction : aim.fraction) * length;
  // The lattice points next to the edge in each column, or in each row if the edge is steep.
  const bool is_level = std::abs(dx) >= std::abs(dy);
  const double slope = is_level ? dy / dx : dx / dy;
  const double from = is_level ? a.x : a.y, across = is_level ? a.y : a.x;
  const auto middle =
      static_cast<std::int32_t>(std::lrint(from + aim.fraction * (is_level ? dx : dy)));

  std::optional<LatticePoint> best;
  double least = 0;
  constexpr std::int32_t kNear = 2,
                         kFar =
                             16;  // largest distances from the aim: first attempt, second attempt
  for (std::int32_t away = 0; away <= kFar && !(best && away > kNear); ++away) {
    for (const std::int32_t column : {middle - away, middle + away}) {
      const double on_edge = across + slope * (column - from);
      for (const double rounded : {std::floor(on_edge), std::ceil(on_edge)}) {
        const auto row = static_cast<std::int32_t>(rounded);
        const LatticePoint m = is_level ? LatticePoint{column, row} : LatticePoint{row, column};
        if (!may_split(a, b, c, m)) continue;
        const double off =
            aim.on_shell_of_a || aim.on_shell_of_b
                ? std::abs(std::sqrt(static_cast<double>(distance2(corner, m))) - shell)
                : static_cast<double>(orient2d(a, b, m)) / length;
        if (!best || off < least) best = m, least = off;
      }
    }
  }
  return best;
}

}  // namespace trocar
