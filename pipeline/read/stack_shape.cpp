// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/stack_shape.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace trocar::pipeline {

bool StackShape::is_uneven(std::size_t gap) const {
  return std::abs(gaps_mm[gap] - step_mm) > 0.01 * step_mm;
}

std::optional<std::size_t> StackShape::first_uneven() const {
  for (std::size_t i = 0; i < gaps_mm.size(); ++i) {
    if (is_uneven(i)) return i;
  }
  return {};
}

StackShape stack_shape(const std::vector<Eigen::Vector3d>& positions,
                       const Eigen::Vector3d& normal) {
  StackShape out;
  if (positions.size() < 2) return out;
  for (std::size_t i = 1; i < positions.size(); ++i) {
    const Eigen::Vector3d step = positions[i] - positions[i - 1];
    out.gaps_mm.push_back(normal.dot(step));
    out.shift_mm = std::max(out.shift_mm, (step - normal * normal.dot(step)).norm());
  }
  std::vector<double> sorted = out.gaps_mm;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  out.step_mm = *middle;
  const Eigen::Vector3d way = positions.back() - positions.front();
  const double along = normal.dot(way);
  out.tilt_deg = std::atan2((way - normal * along).norm(), along) * 180 / std::numbers::pi;
  return out;
}

StackShape stack_shape(const SliceStack& stack) {
  std::vector<Eigen::Vector3d> positions(static_cast<std::size_t>(stack.size()));
  for (int k = 0; k < stack.size(); ++k)
    positions[static_cast<std::size_t>(k)] = stack.plane(k).T_lps_plane.translation();
  return stack_shape(positions, stack.plane(0).T_lps_plane.linear().col(2));
}

Result<void> check_parallel(const SliceStack& stack, int first, int last,
                            const std::string& advice) {
  const SlicePlane& a = stack.plane(first);
  for (int k = first + 1; k <= last; ++k) {
    const SlicePlane& b = stack.plane(k);
    const Eigen::Matrix3d turn = a.T_lps_plane.linear().transpose() * b.T_lps_plane.linear();
    if (!turn.isApprox(Eigen::Matrix3d::Identity(), 1e-3) ||
        std::abs(b.spacing_u_mm / a.spacing_u_mm - 1) > 1e-3 ||
        std::abs(b.spacing_v_mm / a.spacing_v_mm - 1) > 1e-3) {
      return refused(stack.name(k) + ": is not parallel to the first slice or has other pixels; " +
                     advice);
    }
    if (!(b.z_mm > stack.plane(k - 1).z_mm))
      return refused(stack.name(k) + ": lies at the height of the slice before it; " + advice);
  }
  return {};
}

}  // namespace trocar::pipeline
