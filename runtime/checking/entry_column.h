// SPDX-License-Identifier: Apache-2.0
// The column of an asset where its bone is thickest: the entry point of a proposed scene.
// Tests: tests/e2e/new_scene_test.py
#pragma once

#include <array>
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

/// The smallest rectangle around the material of all slices.
struct MaterialBox {
  std::array<double, 2> low_mm{}, high_mm{};
};
MaterialBox material_box(const Asset& asset, const std::vector<Level>& levels);

/// The point where the tool enters. It crosses the levels from `first` to `last`.
struct EntryColumn {
  std::array<double, 2> at_mm{};
  std::size_t first = 0, last = 0;
  double thickness_mm = 0;             ///< total thickness of the material there
  std::vector<std::uint8_t> is_clear;  ///< whether a level has material all around the tool
};

/// The thickest column within any `height_mm` of the levels, which are sorted from the topmost.
/// Consecutive levels are at most `max_gap_mm` apart. Of equally thick columns the one with the most
/// material around it is chosen, then the most central one. None: the bone is nowhere as wide as
/// the tool.
std::optional<EntryColumn> find_entry_column(const Asset& asset, const std::vector<Level>& levels,
                                             double radius_mm, double height_mm, double max_gap_mm);

}  // namespace trocar::runtime
