// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/same_grid.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "pipeline/base/number_ranges.h"

namespace trocar::pipeline {
namespace {

std::string point_text(const Eigen::Vector3d& p) {
  // The text is appended, because g++ 12 warns of an overlap (-Wrestrict) for a literal + a
  // temporary string here.
  std::string out = "(";
  out += text_of(p.x()) + ", " + text_of(p.y()) + ", " + text_of(p.z()) + ")";
  return out;
}

// The largest component of the difference, in units of the voxel's sides.
double in_voxels(const Eigen::Vector3d& apart, const SlicePlane& plane, double step_mm) {
  const Eigen::Vector3d along = plane.T_lps_plane.linear().transpose() * apart;
  // The sides of a voxel along u, v and the normal.
  const Eigen::Vector3d sides(plane.spacing_u_mm, plane.spacing_v_mm, step_mm);
  return along.cwiseQuotient(sides).cwiseAbs().maxCoeff();
}

std::string size_text(const SliceStack& stack) {
  return std::to_string(stack.width()) + " x " + std::to_string(stack.height()) + " x " +
         std::to_string(stack.size());
}

}  // namespace

std::optional<std::string> plane_difference(const SlicePlane& plane, const SlicePlane& other,
                                            int width, int height, double step_mm) {
  // A difference of the spacing adds up over a whole row or column.
  const double across = std::max(width, height) - 1;
  const auto spacing_differs = [across](double a, double b) {
    return !(std::abs(a - b) * across <= kSameVoxel * b);
  };
  if (spacing_differs(plane.spacing_u_mm, other.spacing_u_mm) ||
      spacing_differs(plane.spacing_v_mm, other.spacing_v_mm)) {
    return "spacing is " + text_of(plane.spacing_u_mm) + " x " + text_of(plane.spacing_v_mm) +
           " mm, not " + text_of(other.spacing_u_mm) + " x " + text_of(other.spacing_v_mm);
  }
  for (const int axis : {0, 1}) {
    const Eigen::Vector3d a = plane.T_lps_plane.linear().col(axis),
                          b = other.T_lps_plane.linear().col(axis);
    const double length_mm =
        axis == 0 ? (width - 1) * plane.spacing_u_mm : (height - 1) * plane.spacing_v_mm;
    if (!(in_voxels((a - b) * length_mm, other, step_mm) <= kSameVoxel)) {
      return std::string("orientation differs: its ") + (axis == 0 ? "rows" : "columns") +
             " run along " + point_text(a) + ", not " + point_text(b);
    }
  }
  const Eigen::Vector3d a = plane.T_lps_plane.translation(), b = other.T_lps_plane.translation();
  if (!(in_voxels(a - b, other, step_mm) <= kSameVoxel))
    return "origin is " + point_text(a) + " mm, not " + point_text(b);
  return {};
}

double slice_step_mm(const SliceStack& stack, int slice) {
  if (stack.size() < 2) {
    const SlicePlane& only = stack.plane(0);
    return std::min(only.spacing_u_mm, only.spacing_v_mm);
  }
  const int from = std::min(slice, stack.size() - 2);
  return stack.plane(from + 1).z_mm - stack.plane(from).z_mm;
}

std::optional<GridDifference> grid_difference(const SliceStack& stack, const SliceStack& other) {
  if (stack.width() != other.width() || stack.height() != other.height() ||
      stack.size() != other.size())
    return GridDifference{-1, "size is " + size_text(stack) + " voxels, not " + size_text(other)};
  for (int k = 0; k < stack.size(); ++k) {
    const SlicePlane &a = stack.plane(k), &b = other.plane(k);
    auto what = plane_difference(a, b, other.width(), other.height(), slice_step_mm(other, k));
    if (!what) continue;
    const double step = slice_step_mm(stack, k), wanted = slice_step_mm(other, k);
    if (k > 0 && std::abs(step - wanted) > kSameVoxel * wanted)
      return GridDifference{-1,
                            "slices are " + text_of(step) + " mm apart, not " + text_of(wanted)};
    return GridDifference{k == 0 ? -1 : k, std::move(*what)};
  }
  return {};
}

}  // namespace trocar::pipeline
