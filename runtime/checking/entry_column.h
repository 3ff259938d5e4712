// SPDX-License-Identifier: Apache-2.0
// Finds the column of an asset where its bone is thickest. A column is a vertical line through the
// slices. A proposed scene (new_scene.h) has its entry point in this column.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "formats/asset/asset.h"

namespace trocar::runtime {

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

/// A column. The tool crosses the levels from `first` to `last`.
struct EntryColumn {
  std::array<double, 2> at_mm{};  ///< u, v
  std::size_t first = 0, last = 0;
  double thickness_mm = 0;  ///< thickness of the material from `first` to `last`
  /// One value for each element of the vector `levels` that find_entry_column() was given: 1 if the
  /// whole cross-section of the tool lies over material, otherwise 0.
  std::vector<std::uint8_t> has_material;
};

/// Returns the column with the thickest bone. A column's bone ends at a gap of more than
/// kMaxBoneGap_mm, and does not begin below such a gap under other bone. A column is at most `height_mm` high, and spans at
/// most kMaxSceneSlices slices. Its consecutive levels are at most `max_gap_mm` apart. `radius_mm`:
/// the radius of the tool. `levels`: sorted, the topmost first. If several columns have equally
/// thick bone, the search prefers the column whose bone would be thickest for a tool of three times
/// the radius, because the bone around the tool is widest there. If several columns are still
/// equal, the search prefers the one nearest to the middle of the material. None: the bone is
/// nowhere as wide as the tool.
std::optional<EntryColumn> find_entry_column(const Asset& asset, const std::vector<Level>& levels,
                                             double radius_mm, double height_mm, double max_gap_mm);

/// Returns the thickness that each level stands for: from half-way to the slice above to half-way
/// to the slice below, with or without material. For slices without material that lie between two
/// levels, their mean spacing counts. The topmost and the lowest level are assumed to have a second neighbour at
/// the same distance as their only neighbour. A single slice counts as 1 mm thick. A distance of
/// more than `max_gap_mm` counts as `max_gap_mm`.
std::vector<double> level_thickness(const std::vector<Level>& levels, double max_gap_mm);

}  // namespace trocar::runtime
