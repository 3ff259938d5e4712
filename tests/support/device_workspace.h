// SPDX-License-Identifier: Apache-2.0
// Random poses over the device's workspace, the same on every standard library.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <numbers>
#include <random>

#include "runtime/device/device.h"

namespace trocar::runtime::testing_support {

class Random {
 public:
  explicit Random(std::uint64_t seed) : bits_(seed) {}
  /// Uniform in [0, 1), from the generator's upper 53 bits.
  double unit() { return static_cast<double>(bits_() >> 11) * 0x1p-53; }
  double between(double low, double high) { return low + (high - low) * unit(); }
  Eigen::Vector3d direction() {
    const double z = between(-1, 1), azimuth = between(0, 2 * std::numbers::pi);
    const double rho = std::sqrt(1 - z * z);
    return {rho * std::cos(azimuth), rho * std::sin(azimuth), z};
  }
  Eigen::Vector3d in_ball() { return std::cbrt(unit()) * direction(); }

 private:
  std::mt19937_64 bits_;
};

struct Workspace {
  double z_min_m = 0.095, z_max_m = 0.205;
  double lateral_m = 0.02;
  double tilt_rad = 10 * std::numbers::pi / 180;
};

/// z, x, y uniform; rotation about a uniform axis by a uniform angle. Every
/// eighth pose has the largest angle and lateral offsets.
inline Pose random_workspace_pose(Random& random, const Workspace& w = {}) {
  const bool extreme = random.unit() < 0.125;
  const auto lateral = [&] {
    const double x = random.between(-w.lateral_m, w.lateral_m);
    return extreme ? std::copysign(w.lateral_m, x) : x;
  };
  Pose T;
  T.p_m.x() = lateral();
  T.p_m.y() = lateral();
  T.p_m.z() = random.between(w.z_min_m, w.z_max_m);
  const Eigen::Vector3d axis = random.direction();
  const double angle = extreme ? w.tilt_rad : random.between(0, w.tilt_rad);
  T.q = Eigen::Quaterniond(Eigen::AngleAxisd(angle, axis));
  return T;
}

}  // namespace trocar::runtime::testing_support
