// SPDX-License-Identifier: Apache-2.0
#include "runtime/contact/tool.h"

#include <cmath>
#include <numbers>

namespace trocar::runtime {
namespace {

/// Convex hull by A. M. Andrew's monotone chain, collinear points dropped. Exact.
LatticeOutline convex_hull(std::array<LatticePoint, kMaxToolSides> points, int count) noexcept {
  std::sort(points.begin(), points.begin() + count);
  std::array<LatticePoint, std::size_t{2} * kMaxToolSides> hull;
  int size = 0;
  for (int i = 0; i < count; ++i) {  // lower chain
    while (size >= 2 && orient2d(hull[size - 2], hull[size - 1], points[i]) <= 0)
      --size;
    hull[size++] = points[i];
  }
  const int lower = size + 1;
  for (int i = count - 2; i >= 0; --i) {  // upper chain
    while (size >= lower && orient2d(hull[size - 2], hull[size - 1], points[i]) <= 0)
      --size;
    hull[size++] = points[i];
  }
  --size;  // the first point again
  LatticeOutline outline;
  if (size < 3) return outline;
  outline.size = size;
  std::copy(hull.begin(), hull.begin() + size, outline.points.begin());
  return outline;
}

}  // namespace

Tool make_tool(const SceneTool& scene_tool) {
  Tool tool;
  tool.sides = scene_tool.sides;
  tool.tip_plate_m = Eigen::Vector3d(scene_tool.tip_in_plate_m.data());
  const double start_rad = scene_tool.rotation_deg * std::numbers::pi / 180;
  for (int i = 0; i < tool.sides; ++i) {
    const double angle_rad = start_rad + 2 * std::numbers::pi * i / tool.sides;
    tool.corner_plate_m[i] =
        tool.tip_plate_m +
        scene_tool.radius_m * Eigen::Vector3d(std::cos(angle_rad), std::sin(angle_rad), 0);
  }
  return tool;
}

Eigen::Vector2d PlanarTransform::to_lattice(const Eigen::Vector2d& p_m) const noexcept {
  const Eigen::Vector2d d_mm = (p_m - at_m) * 1e3;
  const Eigen::Vector2d uv_mm(anchor_mm.x() + cosine * d_mm.x() + sine * d_mm.y(),
                              anchor_mm.y() - sine * d_mm.x() + cosine * d_mm.y());
  return uv_mm * std::ldexp(1.0, lattice.bits);
}

Eigen::Vector2d PlanarTransform::to_scene(const Eigen::Vector2d& steps) const noexcept {
  const Eigen::Vector2d d_m = (steps * lattice.step_mm() - anchor_mm) * 1e-3;
  return at_m +
         Eigen::Vector2d(cosine * d_m.x() - sine * d_m.y(), sine * d_m.x() + cosine * d_m.y());
}

Ring to_ring(const LatticeOutline& outline) {
  return Ring(outline.points.begin(), outline.points.begin() + outline.size);
}

LatticeOutline outline_on_lattice(const Tool& tool, const Pose& T_device_plate,
                                  const PlanarTransform& transform) noexcept {
  std::array<LatticePoint, kMaxToolSides> points;
  for (int i = 0; i < tool.sides; ++i) {
    const Eigen::Vector3d corner_device_m = T_device_plate * tool.corner_plate_m[i];
    const Eigen::Vector2d steps = transform.to_lattice(corner_device_m.head<2>());
    // Written so that nan fails it too.
    if (!(steps.cwiseAbs().maxCoeff() <= 0.5 * kMaxCoordinate)) return {};
    points[i] = {static_cast<std::int32_t>(std::lrint(steps.x())),
                 static_cast<std::int32_t>(std::lrint(steps.y()))};
  }
  return convex_hull(points, tool.sides);
}

}  // namespace trocar::runtime
