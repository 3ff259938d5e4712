// SPDX-License-Identifier: Apache-2.0
// The DeviceSpecification of a pose device (runtime/device/pose_device.h), a device that measures
// the pose of its handle itself. The values are taken from the device's description. Force laws
// and the checks of a scene use them.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <utility>

#include "formats/session/pose_device_description.h"
#include "runtime/device/hand_device.h"
#include "runtime/pose_device/pose_frame.h"

namespace trocar::runtime {

/// Returns the fraction of the wrench that a device of this description can render, at most 1. The
/// moment is ignored if the device renders no moments.
double renderable_fraction(const PoseDeviceDescription& description, const Wrench& wrench) noexcept;

/// A side of the box that a description states as the workspace, and a position beyond this side.
struct BoxSide {
  int axis = 0;                  ///< index of the axis in the device's frame
  double at_m = 0, limit_m = 0;  ///< coordinates of the position and of the side along the axis
};
/// Finds a side of the box beyond which the position `p_m` lies. `p_m` is in the device's frame. A
/// nanometre is allowed for rounding. Returns nullopt if the position is in the box.
std::optional<BoxSide> side_beyond(const PoseDeviceDescription& description,
                                   const std::array<double, 3>& p_m) noexcept;

class PoseSpecification final : public DeviceSpecification {
 public:
  PoseSpecification(PoseDeviceDescription description, const PoseFrame& frame)
      : description_(std::move(description)), frame_(frame) {}

  std::string_view name() const noexcept override { return description_.name; }
  std::string describe_strength() const override;
  bool senses_rotation() const noexcept override { return description_.senses_rotation; }
  std::optional<WorkspaceBox> workspace() const noexcept override;
  double mass_kg() const noexcept override { return description_.mass_kg; }
  std::array<double, 3> inertia_kg_m2() const noexcept override {
    return description_.inertia_kg_m2;
  }
  double stiffness_max_N_per_m() const noexcept override {
    return description_.stiffness_max_N_per_m;
  }
  /// Returns 0 if the description states a resolution of 0 (exact readings). Otherwise returns 1,
  /// because PoseHand::measured() is then in multiples of the device's resolution.
  double resolution() const noexcept override;
  std::optional<Eigen::Matrix<double, 6, 6>> damping(const Pose& T_device_plate) const override;
  double renderable_fraction(const Pose& T_device_plate,
                             const Wrench& wrench_device) const override;
  std::string describe_demand(std::string_view what, const Pose& T_device_plate,
                              const Wrench& wrench_device) const override;

  DeviceMargins margins(const Pose& T_device_plate) const noexcept override;
  std::string describe_fault(Fault fault, const Pose& T_device_plate) const override;
  std::optional<Pose> pose_of(const RecordingRow& row) const override;

  const PoseDeviceDescription& description() const noexcept { return description_; }
  const PoseFrame& frame() const noexcept { return frame_; }

 private:
  bool renders_moment() const noexcept { return description_.moment_max_Nm > 0; }

  PoseDeviceDescription description_;
  PoseFrame frame_;
};

}  // namespace trocar::runtime
