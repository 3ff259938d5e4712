// SPDX-License-Identifier: Apache-2.0
// Finds tip positions that a device reaches without turning the plate. A position counts as reached
// if pose_fault() (pose_margins.h) finds no fault there.
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
/// Returns the longest range of heights that the tip reaches with the plate's rotation `q`, which
/// is upright by default. The function tests heights 2 mm apart. Returns nullopt if the tip reaches
/// none of these heights.
std::optional<WorkspaceHeights> workspace_heights(
    const DeviceSpecification& device, const SafetyLimits& limits, const Tool& tool,
    const Eigen::Quaterniond& q = Eigen::Quaterniond::Identity());

/// A rectangle of tip positions at one height in {B}. The tip reaches every position in the
/// rectangle with the same rotation of the plate.
struct WorkspaceRectangle {
  Eigen::Vector2d min_m = Eigen::Vector2d::Zero(), max_m = Eigen::Vector2d::Zero();
};
/// Returns a rectangle for the height `tip_z_m` and the plate's rotation `q`. The search begins at
/// the position that the tip has if the plate's origin is on the z axis of {B}. The function first
/// finds the largest square that has this position at its centre, and then moves one side after the
/// other outwards as far as the tip reaches. The function tests positions 2 mm apart. Returns
/// nullopt if the tip does not reach the position at which the search begins.
std::optional<WorkspaceRectangle> workspace_rectangle(
    const DeviceSpecification& device, const SafetyLimits& limits, const Tool& tool, double tip_z_m,
    const Eigen::Quaterniond& q = Eigen::Quaterniond::Identity());

}  // namespace trocar::runtime
