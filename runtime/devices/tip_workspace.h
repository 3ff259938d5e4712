// SPDX-License-Identifier: Apache-2.0
// The volume that the tip can reach without turning the plate.
// Tests: tests/runtime/checking/hand_path_test.cpp
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>

#include "runtime/contact/tool.h"
#include "runtime/control/limits.h"
#include "runtime/device/hand_device.h"

namespace trocar::runtime {

/// A range of heights of the tip in {B}, for a plate whose origin is on the z axis of {B}.
struct WorkspaceHeights {
  double min_m = 0, max_m = 0;
};
/// Returns the longest range of heights that the tip reaches with the plate's rotation `q`,
/// which is upright by default. Heights 2 mm apart are tested. Returns nullopt if the tip
/// reaches none of them.
std::optional<WorkspaceHeights> workspace_heights(
    const DeviceSpecification& device, const SafetyLimits& limits, const Tool& tool,
    const Eigen::Quaterniond& q = Eigen::Quaterniond::Identity());

/// A rectangle of tip positions at one height. The tip reaches all of them with the same rotation
/// of the plate.
struct WorkspaceRectangle {
  Eigen::Vector2d min_m = Eigen::Vector2d::Zero(), max_m = Eigen::Vector2d::Zero();
};
/// Returns such a rectangle for the height `tip_z_m` and the plate's rotation `q`. The search
/// begins with a plate whose origin is on the z axis of {B}. It finds the largest square around
/// this plate's tip, and then moves each side of the square outwards as far as possible. Positions
/// 2 mm apart are tested. Returns nullopt if the tip does not reach the first position.
std::optional<WorkspaceRectangle> workspace_rectangle(
    const DeviceSpecification& device, const SafetyLimits& limits, const Tool& tool, double tip_z_m,
    const Eigen::Quaterniond& q = Eigen::Quaterniond::Identity());

}  // namespace trocar::runtime
