// SPDX-License-Identifier: Apache-2.0
// The straight path of a proposed scene's needle through the slices: at the position where the bone
// is thickest, or through points that a person has chosen.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/base/result.h"
#include "runtime/checking/entry_column.h"

namespace trocar::runtime {

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

/// Returns the vertical path through a column, with u and v rounded to 0.01 mm.
NeedlePath path_through(const EntryColumn& column, const std::vector<Level>& levels);

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

}  // namespace trocar::runtime
