// SPDX-License-Identifier: Apache-2.0
#include "runtime/refine/outline_split.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace trocar::runtime {
namespace {

constexpr double kAcute_cos = 0.25881904510252074;  // of 75 degrees

bool is_acute(LatticePoint corner, LatticePoint next, LatticePoint previous) noexcept {
  if (orient2d(corner, next, previous) <= 0) return false;
  const double dot = static_cast<double>(diametral_dot(next, previous, corner));
  const double lengths2 = static_cast<double>(distance2(corner, next)) *
                          static_cast<double>(distance2(corner, previous));
  return dot > 0 && dot * dot > kAcute_cos * kAcute_cos * lengths2;
}

std::uint32_t side_towards(const SheetMesh& mesh, std::uint32_t t, std::uint32_t from) noexcept {
  return mesh.across[t][0] == from ? 0 : mesh.across[t][1] == from ? 1 : 2;
}

// The other end of the boundary side that ends where side `side` of t starts: around that vertex.
std::uint32_t previous_on_boundary(const SheetMesh& mesh, std::uint32_t t,
                                   std::uint32_t side) noexcept {
  std::uint32_t back = (side + 2) % 3;  // the side of t that ends at the vertex
  while (mesh.across[t][back] != kNone) {
    const std::uint32_t next = mesh.across[t][back];
    back = (side_towards(mesh, next, t) + 2) % 3;
    t = next;
  }
  return mesh.triangles[t][back];
}

// The other end of the boundary side that starts where side `side` of t ends.
std::uint32_t next_on_boundary(const SheetMesh& mesh, std::uint32_t t,
                               std::uint32_t side) noexcept {
  std::uint32_t on = (side + 1) % 3;
  while (mesh.across[t][on] != kNone) {
    const std::uint32_t next = mesh.across[t][on];
    on = (side_towards(mesh, next, t) + 1) % 3;
    t = next;
  }
  return mesh.triangles[t][(on + 1) % 3];
}

}  // namespace

SplitAim aim_split(const SheetMesh& mesh, std::uint32_t t, std::uint32_t side,
                   int pieces) noexcept {
  const LatticePoint a = mesh.vertices[mesh.triangles[t][side]];
  const LatticePoint b = mesh.vertices[mesh.triangles[t][(side + 1) % 3]];
  const LatticePoint before = mesh.vertices[previous_on_boundary(mesh, t, side)];
  const LatticePoint after = mesh.vertices[next_on_boundary(mesh, t, side)];
  const bool acute_at_a = is_acute(a, b, before), acute_at_b = is_acute(b, after, a);
  if (acute_at_a == acute_at_b) {
    const int before_it = pieces / 2;
    return {static_cast<double>(before_it) / pieces, false, false};
  }
  const double length = std::sqrt(static_cast<double>(distance2(a, b)));
  double shell = 1;  // the power of two in (1/3, 2/3] of the length
  while (shell <= length / 3)
    shell *= 2;
  return {acute_at_a ? shell / length : 1 - shell / length, acute_at_a, acute_at_b};
}

std::optional<LatticePoint> point_on_side(LatticePoint a, LatticePoint b, SplitAim aim) noexcept {
  const std::int64_t dx = std::int64_t{b.x} - a.x, dy = std::int64_t{b.y} - a.y;
  const std::int64_t parts = std::gcd(dx, dy);
  if (parts < 2) return std::nullopt;
  const std::int64_t k = std::clamp<std::int64_t>(
      std::llrint(aim.fraction * static_cast<double>(parts)), 1, parts - 1);
  return LatticePoint{static_cast<std::int32_t>(a.x + dx / parts * k),
                      static_cast<std::int32_t>(a.y + dy / parts * k)};
}

std::optional<LatticePoint> point_beside_side(LatticePoint a, LatticePoint b, LatticePoint c,
                                              SplitAim aim) noexcept {
  const double dx = static_cast<double>(b.x) - a.x, dy = static_cast<double>(b.y) - a.y;
  const double length = std::sqrt(dx * dx + dy * dy);
  const LatticePoint corner = aim.on_shell_of_b ? b : a;
  const double shell = (aim.on_shell_of_b ? 1 - aim.fraction : aim.fraction) * length;
  // Columns if the side is rather level, else rows; the lattice points of each next to
  // the side.
  const bool is_level = std::abs(dx) >= std::abs(dy);
  const double slope = is_level ? dy / dx : dx / dy;
  const double from = is_level ? a.x : a.y, across = is_level ? a.y : a.x;
  const auto middle =
      static_cast<std::int32_t>(std::lrint(from + aim.fraction * (is_level ? dx : dy)));

  std::optional<LatticePoint> best;
  double least = 0;
  constexpr std::int32_t kNear = 2, kFar = 16;  // how far from the aim; farther only if it must be
  for (std::int32_t away = 0; away <= kFar && !(best && away > kNear); ++away) {
    for (const std::int32_t column : {middle - away, middle + away}) {
      const double on_side = across + slope * (column - from);
      for (const double rounded : {std::floor(on_side), std::ceil(on_side)}) {
        const auto row = static_cast<std::int32_t>(rounded);
        const LatticePoint m = is_level ? LatticePoint{column, row} : LatticePoint{row, column};
        if (orient2d(a, b, m) < 0 || orient2d(b, c, m) <= 0 || orient2d(c, a, m) <= 0) continue;
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

}  // namespace trocar::runtime
