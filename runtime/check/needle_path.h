// SPDX-License-Identifier: Apache-2.0
// The needle's path of a proposed scene: the thickest column of bone, the path through chosen
// points, and the path of the scene's hand.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/base/result.h"
#include "runtime/device/hand_device.h"
#include "runtime/device/simulated/hand.h"
#include "runtime/haptics/loop/safety.h"
#include "runtime/haptics/sheet.h"
#include "runtime/haptics/tool.h"
#include "runtime/session/pose_session.h"

namespace trocar::runtime {

// Finds the column of an asset where its bone is thickest. A column is a vertical line through the
// slices. A proposed scene (new_scene.h) has its entry point in this column.

/// A slice with material.
struct Level {
  const AssetSlice* slice = nullptr;
  double z_mm = 0;
};

/// Returns the number of the asset's slices from one level to another, including both levels and
/// the slices without material between them. A bone volume from one level to the other has this
/// number of slices; a scene allows at most kMaxSceneSlices.
std::size_t slices_between(const Level& a, const Level& b);

/// A longer part of a path without bone ends the path's bone: a needle must not go through the
/// spinal canal unnoticed.
inline constexpr double kMaxBoneGap_mm = 3;
/// Returns the height without bone between two levels with bone on a path, if no level between them
/// has bone there: the number of slices between them times their mean spacing.
double gap_mm(const Level& above, const Level& below);

/// Returns the smallest rectangle around the material of all slices, u and v in mm.
Eigen::AlignedBox2d material_box(const Asset& asset, const std::vector<Level>& levels);

// The straight path of a proposed scene's needle through the slices: at the position where the bone
// is thickest, or through points that a person has chosen.

/// Points that a person has chosen, in the patient's frame (DICOM's LPS, mm). Without a target the
/// needle goes straight down.
struct ChosenPoints {
  std::array<double, 3> entry_mm{};
  std::optional<std::array<double, 3>> target_mm;
};

/// How far a path without a target may go. By default nothing limits it.
struct PathLimits {
  double height_mm = std::numeric_limits<double>::max();
  double gap_mm = std::numeric_limits<double>::max();            ///< between consecutive levels
  std::size_t slices = std::numeric_limits<std::size_t>::max();  ///< the result of slices_between()
};

/// Positions are (u, v, z) in mm; z is the height in the stack of slices, as in Level::z_mm.
struct NeedlePath {
  /// The point where the needle meets the bone.
  Eigen::Vector3d entry_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d direction = -Eigen::Vector3d::UnitZ();  ///< unit vector, points down
  bool has_target = false;
  /// The target. Without a target: the point of the path at the level `last`.
  Eigen::Vector3d end_mm = Eigen::Vector3d::Zero();
  std::size_t first = 0, last = 0;  ///< first and last level that the needle crosses
  double thickness_mm = 0;          ///< total thickness of the material on the path
  /// Largest distance between consecutive levels of the path. Only plan_needle_path() sets it.
  double max_gap_mm = 0;
  /// One value per level: 1 if the path goes through material there, otherwise 0.
  std::vector<std::uint8_t> has_material;
  double entry_shift_mm = 0;  ///< distance between `entry_mm` and the chosen entry
};

/// Returns the vertical path through the column with the thickest bone, with u and v rounded to
/// 0.01 mm; in NeedlePath::has_material, the whole cross-section of the tool counts. A column's bone
/// ends at a gap of more than kMaxBoneGap_mm, and does not begin below such a gap under other bone. A
/// column is at most `height_mm` high, and spans at most kMaxSceneSlices slices. Its consecutive
/// levels are at most `max_gap_mm` apart. `radius_mm`: the radius of the tool. `levels`: sorted, the
/// topmost first. If several columns have equally thick bone, the search prefers the column whose
/// bone would be thickest for a tool of three times the radius, because the bone around the tool is
/// widest there. If several columns are still equal, the search prefers the one nearest to the middle
/// of the material. None: the bone is nowhere as wide as the tool.
std::optional<NeedlePath> find_entry_column(const Asset& asset, const std::vector<Level>& levels,
                                            double radius_mm, double height_mm, double max_gap_mm);

/// Plans a path through chosen points. `levels`: sorted, the topmost first.
///  - Entry: the path enters the bone in which the chosen entry lies. If the chosen entry lies in
///    no bone, the path enters the first bone below that point. The bone's surface is somewhere
///    between the height of the bone's topmost level and half a slice spacing above it. If the
///    chosen entry lies between these two heights, NeedlePath::entry_mm is the chosen entry.
///    Otherwise entry_mm is the path's point at the topmost level of the bone.
///  - End without a target: the path follows the levels downwards from the first level, until more
///    than kMaxBoneGap_mm of it are without bone, the next level is more than `limits.gap_mm` below the previous one or more than
///    `limits.height_mm` below the first one, or until the path would have more than
///    `limits.slices` slices. The path ends at the lowest of these levels that has material on the
///    path.
///  - Thickness: a gap of more than `limits.gap_mm` between two levels counts as `limits.gap_mm`.
/// Errors: kRefused if the slices are shifted or turned against each other (for example because the
/// ring of the CT scanner was tilted), if the target is less than 1 mm below the entry or not below
/// the top of the bone, if the path goes through no bone, or if other bone lies on the path above
/// the entry. Complexity: linear in the number of triangles.
Result<NeedlePath> plan_needle_path(const Asset& asset, const std::vector<Level>& levels,
                                    const ChosenPoints& points, const PathLimits& limits = {});

/// A part of a path without bone, longer than kMaxBoneGap_mm, between two levels with bone on it.
struct BoneGap {
  std::size_t above = 0, below = 0;
  double mm = 0;  ///< its length along the path
};
/// Returns the gaps from the path's first level to its last one, from the top, and the gap that
/// follows the last bone on the path, if there is more bone below it.
std::vector<BoneGap> bone_gaps(const std::vector<Level>& levels, const NeedlePath& path);

/// Returns the point of a path at the height z_mm.
Eigen::Vector3d point_at(const NeedlePath& path, double z_mm);

/// Returns the angle between a path and the vertical, in degrees.
double tilt_deg(const NeedlePath& path);

// Follows the path of the scene's hand, as if the tool followed the hand exactly. The dry run
// (dry_run.h) shows how the tool moves if forces act on it.

/// If `fault` is raised because a pose exceeds a limit, returns a text with the pose's value and
/// the limit. Returns an empty text if the pose does not exceed the limit, or if `fault` has
/// another cause. Faults with a limit on the pose are kWorkspace, kToolTilt, and those of the
/// device's own checks.
std::string describe_pose_fault(Fault fault, const DeviceSpecification& device,
                                const SafetyLimits& limits, const Tool& tool,
                                const Pose& T_device_plate);

/// A point of a path at which the haptic loop would raise `fault`.
struct PathBreach {
  Fault fault = Fault::kNone;
  double t_s = 0;
  std::string what;  ///< text of describe_pose_fault(), or a similar text for kSpeed
};

struct PathReport {
  Eigen::Vector3d tip_min_m = Eigen::Vector3d::Zero(), tip_max_m = Eigen::Vector3d::Zero();
  /// box_min_m: smallest distance from the plate's origin to a side of the workspace; negative:
  /// outside. tilt_max_rad: largest angle between the z axes of the plate and of {B}.
  double box_min_m = 0, tilt_max_rad = 0;
  double speed_max_m_per_s = 0;  ///< speed of the plate's origin
  /// Distances of the path from the limits that the device itself checks. `is_reachable`: the
  /// device's geometry allows every point. `joint_rad` (with `joint`) and `inverse_condition`: the
  /// smallest values over the points that the geometry allows. The other members are not set.
  DeviceMargins device;
  std::optional<PathBreach> breach;  ///< the first one
};

/// Evaluates the path `rate_Hz` times a second from `from_s` to `to_s`, as far as the hand moves.
PathReport evaluate_path(const HandTrajectory& path, const DeviceSpecification& device,
                         const SafetyLimits& limits, const Tool& tool, double rate_Hz, double to_s,
                         double from_s = 0);

/// A point of the path at which the tip goes from above a sheet to below it.
struct SheetCrossing {
  double t_s = 0;
  Pose T_device_plate;
  Eigen::Vector3d tip_m = Eigen::Vector3d::Zero();
  double coverage = 0;  ///< fraction of the outline's area over material
};
/// Returns all crossings in ascending time, including those after the session's end.
std::vector<SheetCrossing> sheet_crossings(const HandTrajectory& path, const Tool& tool,
                                           const Sheet& sheet);

}  // namespace trocar::runtime
