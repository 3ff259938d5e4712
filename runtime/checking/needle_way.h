// SPDX-License-Identifier: Apache-2.0
// The straight way of the needle of a proposed scene through the slices: where the bone is thickest, or through points
// that a person has chosen.
// Tests: tests/runtime/checking/needle_way_test.cpp, tests/e2e/new_scene_test.py
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/base/result.h"
#include "runtime/checking/entry_column.h"

namespace trocar::runtime {

/// Points in the patient's frame (DICOM's LPS, mm). Without a target the needle goes straight down.
struct ChosenPoints {
  std::array<double, 3> entry_mm{};
  std::optional<std::array<double, 3>> target_mm;
};

/// Positions are (u, v, z) in mm, with z as in Level::z_mm.
struct NeedleWay {
  Eigen::Vector3d entry_mm = Eigen::Vector3d::Zero();     ///< where the needle meets the bone
  Eigen::Vector3d direction = -Eigen::Vector3d::UnitZ();  ///< of unit length, downwards
  bool has_target = false;
  Eigen::Vector3d end_mm =
      Eigen::Vector3d::Zero();         ///< the target, or the way's point at the last level
  std::size_t first = 0, last = 0;     ///< levels that the needle crosses, down to the target
  double thickness_mm = 0;             ///< total thickness of the material on the way
  double max_gap_mm = 0;               ///< largest distance of two consecutive levels of the way
  std::vector<std::uint8_t> is_clear;  ///< per level: 1 if the way meets material there
  double moved_mm = 0;                 ///< distance of `entry_mm` from the entry that was chosen
};

/// Returns the straight way down through a column, whose place is rounded to 0.01 mm.
NeedleWay way_through(const EntryColumn& column, const std::vector<Level>& levels);

/// Plans a way through points. `levels`: sorted, the topmost first. The entry is where the way meets the piece of bone that
/// contains the chosen entry, or else the first one below it. Without a target the way ends in the lowest material within
/// `height_mm`, before the first gap between levels that exceeds `max_gap_mm`. Errors: (refused) the target is not below the
/// entry, the way meets no bone, or other bone lies on it above the entry. Complexity: linear in the triangles.
Result<NeedleWay> plan_needle_way(const Asset& asset, const std::vector<Level>& levels,
                                  const ChosenPoints& points, double height_mm, double max_gap_mm);

/// Returns the point of a way at the height of z_mm.
Eigen::Vector3d point_at(const NeedleWay& way, double z_mm);

/// Returns the angle between a way and the straight way down, in degrees.
double tilt_deg(const NeedleWay& way);

}  // namespace trocar::runtime
