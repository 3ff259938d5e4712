// SPDX-License-Identifier: Apache-2.0
#include "runtime/contact/overlap.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>

#include "formats/geometry/lattice_offset.h"

namespace trocar::runtime {
namespace {

// A coverage within kSnap of 0 or 1 is set to 0 or 1. The sum over triangles has an error of about 1e-13.
constexpr double kSnap = 1e-9;

/// A counter-clockwise polygon relative to a corner of the tool. Clipping to a half plane adds at most one
/// vertex to a convex polygon, and at most half its number of vertices to any polygon. So the capacity
/// suffices for the tool clipped to a triangle, and for a convex piece of the tool clipped to all pieces
/// of all holes.
struct Polygon {
  static constexpr int kCapacity =
      kMaxToolSides + 3 + kMaxPendingHoles * (kMaxToolSides + 2 * kMaxToolPieces);
  int size = 0;
  std::array<Eigen::Vector2d, kCapacity> points;
};
static_assert(Polygon::kCapacity >= kMaxToolSides * 27 / 8);

/// Sums of the doubled area and of six times the first moment. The terms are summed as integers, in units
/// of about 2^-56 of the tool's box, so the sum has the same bits in any order.
class Moments {
 public:
  /// `doubled_area` and `reach` (the largest |coordinate|) of a box around all pieces.
  Moments(double doubled_area, double reach) noexcept
      : area_unit_(unit(doubled_area)), first_unit_(unit(3 * doubled_area * reach)) {}

  void add(const Polygon& polygon) noexcept {
    for (int i = 2; i < polygon.size; ++i) {
      const Eigen::Vector2d &o = polygon.points[0], &p = polygon.points[i - 1],
                            &q = polygon.points[i];
      const Eigen::Vector2d a = p - o, b = q - o;
      const double doubled = a.x() * b.y() - a.y() * b.x();
      const Eigen::Vector2d first = doubled * (o + p + q);
      area_ += std::llrint(doubled / area_unit_);
      first_x_ += std::llrint(first.x() / first_unit_);
      first_y_ += std::llrint(first.y() / first_unit_);
    }
  }
  double area() const noexcept { return static_cast<double>(area_) * area_unit_; }
  Eigen::Vector2d centroid() const noexcept {
    const Eigen::Vector2d first(static_cast<double>(first_x_), static_cast<double>(first_y_));
    return first_unit_ / (3 * area()) * first;
  }

 private:
  // Returns a power of two, so that dividing by it is exact. Seven bits are spare for polygons that
  // overlap themselves, whose terms are larger than their sum.
  static double unit(double most) noexcept {
    int exponent = 0;
    std::frexp(most, &exponent);
    return std::ldexp(1.0, exponent - 56);
  }
  double area_unit_, first_unit_;
  std::int64_t area_ = 0, first_x_ = 0, first_y_ = 0;
};

/// Clips a polygon to the left side of a -> b (Sutherland and Hodgman, one plane). If a polygon
/// that is not convex falls into parts, the parts stay joined by edges along the line, which cancel
/// in the moments.
void clip(const Polygon& polygon, const Eigen::Vector2d& a, const Eigen::Vector2d& b,
          Polygon& result) noexcept {
  result.size = 0;
  const Eigen::Vector2d d = b - a;
  const auto side = [&](const Eigen::Vector2d& p) {
    return d.x() * (p.y() - a.y()) - d.y() * (p.x() - a.x());
  };
  for (int i = 0; i < polygon.size; ++i) {
    const Eigen::Vector2d& p = polygon.points[i];
    const Eigen::Vector2d& q = polygon.points[i + 1 == polygon.size ? 0 : i + 1];
    const double at_p = side(p), at_q = side(q);
    // Because of rounding, a convex polygon can cross a line more than twice, by about one rounding error.
    // Then the capacity bounds the size, and the loss is of the order of that error.
    if (at_p >= 0 && result.size < Polygon::kCapacity) result.points[result.size++] = p;
    if (((at_p > 0 && at_q < 0) || (at_p < 0 && at_q > 0)) && result.size < Polygon::kCapacity) {
      result.points[result.size++] = p + (at_p / (at_p - at_q)) * (q - p);
    }
  }
  if (result.size < 3) result.size = 0;
}

/// All convex pieces of all holes, as one list.
struct Holes {
  const Tool& tool;
  std::span<const LatticeOutline> outlines;
  LatticePoint origin;
  int size() const noexcept { return static_cast<int>(outlines.size()) * tool.pieces; }
  const ConvexPiece& piece(int k) const noexcept { return tool.piece[k % tool.pieces]; }
  Eigen::Vector2d corner(int k, int i) const noexcept {
    return offset_in_steps(
        outlines[static_cast<std::size_t>(k / tool.pieces)].points[piece(k).corner[i]], origin);
  }
};

/// Adds the part of a convex polygon outside the union of the holes from the k-th on. It cuts
/// off, edge by edge, the disjoint convex parts outside the k-th hole, and treats each of them
/// with the remaining holes.
void add_outside(const Polygon& polygon, const Holes& holes, int k, Moments& moments) noexcept {
  if (k == holes.size()) return moments.add(polygon);
  const int sides = holes.piece(k).size;
  Polygon rest = polygon, outside, inside;
  for (int i = 0; i < sides && rest.size > 0; ++i) {
    const Eigen::Vector2d a = holes.corner(k, i), b = holes.corner(k, i + 1 == sides ? 0 : i + 1);
    clip(rest, b, a, outside);
    if (outside.size > 0) add_outside(outside, holes, k + 1, moments);
    clip(rest, a, b, inside);
    std::swap(rest, inside);
  }
}

/// The tool's outline relative to its first corner.
Polygon whole_outline(const LatticeOutline& outline) noexcept {
  Polygon whole;
  whole.size = outline.size;
  for (int i = 0; i < outline.size; ++i) {
    whole.points[i] = offset_in_steps(outline.points[i], outline.points[0]);
  }
  return whole;
}

/// Whether one edge of a convex outline has the whole triangle on its outer side, with some distance, so that they
/// have no area in common.
bool is_beyond_an_edge(const Polygon& convex,
                       const std::array<Eigen::Vector2d, 3>& corner) noexcept {
  constexpr double kDistance_steps = 1e-3;
  for (int i = 0; i < convex.size; ++i) {
    const Eigen::Vector2d& a = convex.points[i];
    const Eigen::Vector2d d = convex.points[i + 1 == convex.size ? 0 : i + 1] - a;
    const auto side = [&](const Eigen::Vector2d& p) {
      return d.x() * (p.y() - a.y()) - d.y() * (p.x() - a.x());
    };
    const double limit = -kDistance_steps * (std::abs(d.x()) + std::abs(d.y()));
    if (side(corner[0]) < limit && side(corner[1]) < limit && side(corner[2]) < limit) return true;
  }
  return false;
}

/// The k-th convex piece of the tool's outline.
Polygon convex_part(const Tool& tool, int k, const Polygon& whole) noexcept {
  Polygon part;
  part.size = tool.piece[k].size;
  for (int i = 0; i < part.size; ++i)
    part.points[i] = whole.points[tool.piece[k].corner[i]];
  return part;
}

/// Returns empty sums whose units suit convex parts of that outline.
Moments moments_of_parts(const Polygon& whole) noexcept {
  double reach = 0;
  for (int i = 0; i < whole.size; ++i)
    reach = std::max(reach, whole.points[i].cwiseAbs().maxCoeff());
  return {4 * reach * reach, reach};  // values of the square around the origin with this half side
}

}  // namespace

Overlap overlap(const Sheet& sheet, const Tool& tool, const LatticeOutline& outline,
                std::span<const LatticeOutline> holes) noexcept {
  Overlap result;
  if (outline.size < 3 || outline.size != tool.sides) return result;
  const LatticePoint origin = outline.points[0];
  const Polygon whole = whole_outline(outline);
  Polygon first, second;
  Moments covered = moments_of_parts(whole), all = covered;
  const Holes pending{tool, holes, origin};
  const auto add = [&](const Polygon& part, const std::array<Eigen::Vector2d, 3>& corner) {
    clip(part, corner[0], corner[1], first);
    clip(first, corner[1], corner[2], second);
    clip(second, corner[2], corner[0], first);
    if (first.size > 0) add_outside(first, pending, 0, covered);
  };
  sheet.grid.for_each(sheet.mesh, box_around(outline), [&](std::uint32_t index) {
    const Triangle& t = sheet.mesh.triangles[index];
    const std::array<Eigen::Vector2d, 3> corner{offset_in_steps(sheet.mesh.vertices[t[0]], origin),
                                                offset_in_steps(sheet.mesh.vertices[t[1]], origin),
                                                offset_in_steps(sheet.mesh.vertices[t[2]], origin)};
    if (tool.pieces == 1 && is_beyond_an_edge(whole, corner)) return;
    if (holes.empty()) return add(whole, corner);
    for (int k = 0; k < tool.pieces; ++k)  // add_outside() needs convex parts
      add(convex_part(tool, k, whole), corner);
  });

  all.add(whole);
  const Eigen::Vector2d offset(origin.x, origin.y);
  result.coverage = covered.area() / all.area();
  result.centroid_steps = offset + all.centroid();
  if (!(result.coverage > kSnap)) {
    result.coverage = 0;
  } else if (result.coverage > 1 - kSnap) {
    result.coverage = 1;
  } else {
    result.centroid_steps = offset + covered.centroid();
  }
  return result;
}

double outline_outside(const Tool& tool, const LatticeOutline& outline,
                       std::span<const LatticeOutline> holes) noexcept {
  if (outline.size < 3 || outline.size != tool.sides) return 1;
  const Polygon whole = whole_outline(outline);
  Moments outside = moments_of_parts(whole), all = outside;
  const Holes open{tool, holes, outline.points[0]};
  for (int k = 0; k < tool.pieces; ++k)
    add_outside(convex_part(tool, k, whole), open, 0, outside);
  all.add(whole);
  const double share = outside.area() / all.area();
  if (!(share > kSnap)) return 0;
  return share > 1 - kSnap ? 1 : share;
}

}  // namespace trocar::runtime
