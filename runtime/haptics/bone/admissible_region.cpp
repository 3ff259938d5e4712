// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/bone/admissible_region.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;

// Half the side of the square that contains the region. The square's corners are at
// the distance kSight_m.
constexpr double kHalfSquare_m = kSight_m / std::numbers::sqrt2;
constexpr double kCrossingSlack_m = 1e-9;

// A half plane: the region satisfies towards . p <= reach_m, with p relative to the axis.
struct Wall {
  Vector2d towards = Vector2d::Zero();
  double reach_m = 0;
};

// The part of a segment that can be nearer to the region than a radius, because no wall
// keeps it away.
struct Part {
  double from = 0, to = 1;
  bool is_none() const noexcept { return !(from <= to); }
};

// The sides of the square, followed by the walls found so far.
struct Walls {
  static constexpr int kSides = 4;
  int count = kSides;
  std::array<Wall, kSides + kMaxWalls> wall;

  Walls() noexcept {
    for (int i = 0; i < kSides; ++i) {
      const double sign = i < 2 ? 1 : -1;
      wall[i] = {i % 2 == 0 ? Vector2d(sign, 0) : Vector2d(0, sign), kHalfSquare_m};
    }
  }

  Part part(const Vector2d& a, const Vector2d& b, double radius_m) const noexcept {
    Part out;
    for (int i = 0; i < count; ++i) {
      const double at_a = wall[i].towards.dot(a) - wall[i].reach_m - radius_m,
                   change = wall[i].towards.dot(b - a);
      if (std::abs(change) < kCrossingSlack_m) {
        if (at_a > -kCrossingSlack_m) return {1, 0};
        continue;
      }
      const double cross = -(at_a + kCrossingSlack_m) / change;
      if (change > 0)
        out.to = std::min(out.to, cross);
      else
        out.from = std::max(out.from, cross);
    }
    return out;
  }

  // Returns the point nearest to the axis on that part of a segment; infinite if the part is empty.
  Vector2d nearest(const Vector2d& a, const Vector2d& b, double radius_m) const noexcept {
    const Part free = part(a, b, radius_m);
    if (free.is_none()) return {HUGE_VAL, HUGE_VAL};
    const Vector2d d = b - a;
    const double length2 = d.squaredNorm();
    const double at = length2 > 0 ? -a.dot(d) / length2 : 0;
    return a + std::clamp(at, free.from, free.to) * d;
  }

  // Moves one wall inwards so that it keeps the whole segment a radius away. Chooses the wall that
  // then remains farthest from the axis.
  void shift(const Vector2d& a, const Vector2d& b, double radius_m) noexcept {
    const Part free = part(a, b, radius_m);
    if (free.is_none()) return;
    const Vector2d p = a + free.from * (b - a), q = a + free.to * (b - a);
    int best = 0;
    double reach_m = -HUGE_VAL;
    for (int i = 0; i < count; ++i) {
      const double to_m = std::min(wall[i].towards.dot(p), wall[i].towards.dot(q)) - radius_m;
      if (!(to_m > reach_m)) continue;
      reach_m = to_m;
      best = i;
    }
    wall[best].reach_m = reach_m;
  }
};

// A convex polygon, counter-clockwise; each wall adds at most a corner.
struct ConvexPolygon {
  int size = 0;
  std::array<Vector2d, Walls::kSides + kMaxWalls> corner;

  void cut(const Wall& wall) noexcept {
    ConvexPolygon out;
    for (int i = 0; i < size; ++i) {
      const Vector2d &p = corner[i], &q = corner[i + 1 == size ? 0 : i + 1];
      const double at_p = wall.towards.dot(p) - wall.reach_m,
                   at_q = wall.towards.dot(q) - wall.reach_m;
      const auto capacity = static_cast<int>(out.corner.size());
      if (at_p <= 0 && out.size < capacity) out.corner[out.size++] = p;
      if (((at_p < 0 && at_q > 0) || (at_p > 0 && at_q < 0)) && out.size < capacity)
        out.corner[out.size++] = p + at_p / (at_p - at_q) * (q - p);
    }
    *this = out;
  }

  // Removes the corner whose removal takes least area away.
  void leave_one_out() noexcept {
    int least = 0;
    double least_m2 = HUGE_VAL;
    for (int i = 0; i < size; ++i) {
      const Vector2d before = corner[i] - corner[(i + size - 1) % size],
                     after = corner[(i + 1) % size] - corner[i];
      const double m2 = before.x() * after.y() - before.y() * after.x();
      if (!(m2 < least_m2)) continue;
      least_m2 = m2;
      least = i;
    }
    std::copy(corner.begin() + least + 1, corner.begin() + size, corner.begin() + least);
    --size;
  }
};

}  // namespace

Slot admissible_region(const Sheet& sheet, const Vector2d& at_m, double radius_m) noexcept {
  Slot slot;
  slot.open(at_m, 0);
  const PlanarTransform& transform = sheet.transform;
  const double sight_m = kSight_m + radius_m;
  const Vector2d middle = transform.to_lattice(at_m);
  const double half = sight_m / transform.lattice.step_m();
  // Written so that nan fails as well.
  if (!(middle.cwiseAbs().maxCoeff() + half <= 0.5 * kMaxCoordinate)) return slot;
  const LatticeBox box{{static_cast<std::int32_t>(std::floor(middle.x() - half)),
                        static_cast<std::int32_t>(std::floor(middle.y() - half))},
                       {static_cast<std::int32_t>(std::ceil(middle.x() + half)),
                        static_cast<std::int32_t>(std::ceil(middle.y() + half))}};
  const auto place = [&](LatticePoint p) -> Vector2d {
    return transform.to_scene({static_cast<double>(p.x), static_cast<double>(p.y)}) - at_m;
  };

  const auto corners_of = [&](std::uint32_t t) -> std::array<Vector2d, 3> {
    const auto corner = corners(sheet.mesh, t);
    return {place(corner[0]), place(corner[1]), place(corner[2])};
  };

  bool is_inside = false;
  const LatticePoint below{static_cast<std::int32_t>(std::floor(middle.x())),
                           static_cast<std::int32_t>(std::floor(middle.y()))};
  sheet.grid.for_each(sheet.mesh, {below, {below.x + 1, below.y + 1}}, [&](std::uint32_t t) {
    const std::array<Vector2d, 3> p = corners_of(t);
    const auto left_of = [](const Vector2d& a, const Vector2d& b) {
      return a.x() * b.y() - a.y() * b.x() >= 0;  // the axis is left of a -> b
    };
    is_inside = is_inside || (left_of(p[0], p[1]) && left_of(p[1], p[2]) && left_of(p[2], p[0]));
  });
  if (is_inside) return slot;

  Walls walls;
  const auto for_each_edge = [&](auto use) {
    sheet.boundary_grid.for_each(sheet.mesh, box, [&](std::uint32_t t) {
      const auto& across = sheet.mesh.across[t];
      const std::array<Vector2d, 3> p = corners_of(t);
      for (std::size_t i = 0; i < 3; ++i)
        if (across[i] == kNoSlot) use(p[i], p[i == 2 ? 0 : i + 1]);
    });
  };
  bool is_whole = false;
  while (!is_whole && walls.count < Walls::kSides + kMaxWalls) {
    Vector2d nearest = Vector2d::Zero();
    double least2 = sight_m * sight_m;
    for_each_edge([&](const Vector2d& a, const Vector2d& b) {
      const Vector2d q = walls.nearest(a, b, radius_m);
      if (!(q.squaredNorm() < least2)) return;
      least2 = q.squaredNorm();
      nearest = q;
    });
    is_whole = !(least2 < sight_m * sight_m);
    if (is_whole) break;
    const double distance_m = std::sqrt(least2);
    if (!(distance_m > 1e-9)) return slot;  // the axis is on the edge of the material
    walls.wall[walls.count++] = {nearest / distance_m, distance_m - radius_m};
  }
  // Move lines inwards past the remaining edges; a round hole has more edges than kMaxWalls.
  if (!is_whole) {
    for_each_edge([&](const Vector2d& a, const Vector2d& b) {
      if (walls.nearest(a, b, radius_m).squaredNorm() < sight_m * sight_m)
        walls.shift(a, b, radius_m);
    });
  }

  ConvexPolygon polygon;
  polygon.size = 4;
  polygon.corner[0] = {-kHalfSquare_m, -kHalfSquare_m};
  polygon.corner[1] = {kHalfSquare_m, -kHalfSquare_m};
  polygon.corner[2] = {kHalfSquare_m, kHalfSquare_m};
  polygon.corner[3] = {-kHalfSquare_m, kHalfSquare_m};
  for (int i = 0; i < walls.count; ++i)
    polygon.cut(walls.wall[i]);
  if (polygon.size == 0) return slot;  // the gap is narrower than the tool
  while (polygon.size > Slot::kMaxCorners)
    polygon.leave_one_out();
  slot.open(at_m + polygon.corner[0], 0);
  for (int i = 1; i < polygon.size; ++i)
    slot.include(at_m + polygon.corner[i]);
  return slot;
}

}  // namespace trocar::runtime
