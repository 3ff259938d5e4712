// SPDX-License-Identifier: Apache-2.0
#include "runtime/bone_cutting/contact/surface_slope.h"

#include <algorithm>
#include <cmath>

#include "runtime/contact/edge_distance.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;

constexpr double kLimit_m = 1e-3 * EdgeDistance::kReach_mm * (1 - 1e-6);

/// The contact passes from the surface to the face of the tip between kMaxSlope and twice that tangent.
double limited(double steepness, const ToolShape& tool) noexcept {
  const double face = std::clamp(1 / std::tan(tool.half_angle_rad), 0.0, kMaxSlope);
  const double part = std::clamp(steepness / kMaxSlope - 1, 0.0, 1.0);
  return std::min(steepness, kMaxSlope) * (1 - part) + face * part;
}

/// Downhill, away from the material. A gradient of 0 has no direction.
Vector2d downhill(const Vector2d& inwards, double steepness, const ToolShape& tool) noexcept {
  const double length = inwards.norm();
  return length > 0 ? Vector2d(inwards * (-limited(steepness, tool) / length)) : Vector2d::Zero();
}

/// Straight line through distances over depth, and the mean of their gradients.
class LineFit {
 public:
  void add(double depth_m, const EdgeDistance::Sample& at) noexcept {
    ++count_;
    depth_m_ += depth_m;
    distance_m_ += at.distance_m;
    depths_m2_ += depth_m * depth_m;
    mixed_m2_ += depth_m * at.distance_m;
    gradient_ += at.gradient;
  }
  /// Growth of the distance per depth. Needs two depths.
  double growth() const noexcept {
    return (count_ * mixed_m2_ - depth_m_ * distance_m_) /
           (count_ * depths_m2_ - depth_m_ * depth_m_);
  }
  Vector2d gradient() const noexcept { return gradient_ / count_; }

 private:
  double count_ = 0, depth_m_ = 0, distance_m_ = 0, depths_m2_ = 0, mixed_m2_ = 0;
  Vector2d gradient_ = Vector2d::Zero();
};

}  // namespace

std::optional<Vector2d> surface_slope(const BoneVolume& bone, std::span<const Sheet* const> sheets,
                                      int sheet, double front_m, const Vector2d& at_m) noexcept {
  const auto sample = [&](int i) { return sheets[i]->edge->at(sheets[i]->transform, at_m); };
  const EdgeDistance::Sample front = sample(sheet);
  if (front.distance_m <= -kLimit_m) return std::nullopt;
  const Vector2d face = downhill(front.gradient, 2 * kMaxSlope, bone.shape);
  // The surface lies between the sheets `above` and `above + 1`.
  int above = sheet;
  EdgeDistance::Sample high = front, low = front;
  if (front.distance_m >= 0) {
    if (!bone.sheets[sheet].meets_above) return Vector2d::Zero();
    high = sample(--above);
    if (high.distance_m >= 0) return std::nullopt;
  } else {
    for (int left = kMaxSlopeSheets;; ++above) {
      if (left-- == 0 || !bone.sheets[above].meets_below) return face;
      low = sample(above + 1);
      if (low.distance_m >= 0) break;
      high = low;
    }
  }
  const double high_m = -sheets[above]->z_m, low_m = -sheets[above + 1]->z_m,
               difference_m = low.distance_m - high.distance_m;
  const double surface_m = low_m - (low_m - high_m) * low.distance_m / difference_m;
  if (surface_m - front_m > 2 * bone.radius_m) return face;
  if (high.distance_m <= -kLimit_m) return Vector2d::Zero();
  LineFit line;
  line.add(high_m - surface_m, high);
  line.add(low_m - surface_m, low);
  const auto add = [&](int i) {
    const double depth_m = -sheets[i]->z_m - surface_m;
    const EdgeDistance::Sample at = sample(i);
    if (std::abs(depth_m) > kSlopeWindow_m || std::abs(at.distance_m) >= kLimit_m) return false;
    line.add(depth_m, at);
    return true;
  };
  for (int i = above; i > above - kMaxSlopeSheets && bone.sheets[i].meets_above && add(i - 1);)
    --i;
  for (int i = above + 1; i <= above + kMaxSlopeSheets && bone.sheets[i].meets_below && add(i + 1);)
    ++i;
  const double nearest = difference_m / (low_m - high_m),
               growth = std::max(line.growth(), nearest / kMostSteeper);
  const Vector2d inwards = line.gradient();
  return downhill(inwards, inwards.norm() / std::max(growth, 1e-9), bone.shape);
}

}  // namespace trocar::runtime
