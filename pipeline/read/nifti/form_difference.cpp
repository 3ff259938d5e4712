// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/nifti/form_difference.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "pipeline/base/number_ranges.h"

namespace trocar::pipeline {
namespace {

// The orthogonal matrix that is nearest to the array's axes.
Eigen::Matrix3d directions(const Eigen::Matrix4d& form) {
  const Eigen::Matrix3d axes = form.topLeftCorner<3, 3>().colwise().normalized();
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(axes, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return svd.matrixU() * svd.matrixV().transpose();
}

std::string sides_text(const Eigen::Matrix4d& form) {
  std::string out;
  for (int k = 0; k < 3; ++k)
    out += (k == 0 ? "" : " x ") + text_of(form.col(k).head<3>().norm(), 4);
  return out + " mm";
}

double angle_deg(const Eigen::Matrix3d& rotation) {
  return Eigen::AngleAxisd(rotation).angle() * 180 / std::numbers::pi;
}

}  // namespace

std::string form_difference(const Eigen::Matrix4d& qform, const Eigen::Matrix4d& sform,
                            const std::array<std::int64_t, 3>& n) {
  constexpr double kMaxVoxels = 0.5;
  const Eigen::Array3d last(static_cast<double>(n[0] - 1), static_cast<double>(n[1] - 1),
                            static_cast<double>(n[2] - 1));
  const auto apart_mm = [&](const Eigen::Array3d& voxel) -> Eigen::Vector3d {
    return ((qform - sform) * voxel.matrix().homogeneous()).head<3>();
  };
  const Eigen::Matrix3d to_voxels = sform.topLeftCorner<3, 3>().inverse();
  double most_mm = 0, most_voxels = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3d apart =
        apart_mm(last * Eigen::Array3d(corner & 1, corner >> 1 & 1, corner >> 2));
    most_mm = std::max(most_mm, apart.norm());
    most_voxels = std::max(most_voxels, (to_voxels * apart).cwiseAbs().maxCoeff());
  }
  const Eigen::Matrix3d from = directions(sform), to = directions(qform);
  Eigen::Matrix3d turn = to * from.transpose();
  const bool is_mirrored = turn.determinant() < 0;
  if (!is_mirrored && !(most_voxels > kMaxVoxels)) return {};

  std::string out;
  const auto add = [&out](const std::string& text) { out += (out.empty() ? "" : ", ") + text; };
  if (is_mirrored) {
    // The mirror that leaves the smallest rotation.
    constexpr std::array<const char*, 3> kAxes{"from left to right", "from front to back",
                                               "from head to feet"};
    int best = 0;
    Eigen::Matrix3d left = turn;
    for (int k = 0; k < 3; ++k) {
      Eigen::Matrix3d mirror = Eigen::Matrix3d::Identity();
      mirror(k, k) = -1;
      const Eigen::Matrix3d rest = turn * mirror;
      if (k > 0 && !(angle_deg(rest) < angle_deg(left) - 1e-6)) continue;
      best = k;
      left = rest;
    }
    turn = left;
    add(std::string("mirrored ") + kAxes[static_cast<std::size_t>(best)]);
  }
  if (const double angle = angle_deg(turn); angle > 0.01)
    add("rotated by " + text_of(angle, 4) + " degrees");
  if (const double shift = apart_mm(last / 2).norm(); shift > 0.001)
    add("shifted by " + text_of(shift, 4) + " mm");
  for (int k = 0; k < 3; ++k) {
    const double by_sform = sform.col(k).head<3>().norm();
    if (!(std::abs(qform.col(k).head<3>().norm() - by_sform) > 1e-3 * by_sform)) continue;
    add("has voxels of " + sides_text(qform) + " instead of " + sides_text(sform));
    break;
  }
  add("a voxel moves by up to " + text_of(most_mm, 4) + " mm");
  return out;
}

}  // namespace trocar::pipeline
