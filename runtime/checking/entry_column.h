// SPDX-License-Identifier: Apache-2.0
// Finds the column of an asset where its bone is thickest, which is the entry point of a proposed scene.
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

/// The point where the tool enters. The tool crosses the levels from `first` to `last`.
struct EntryColumn {
  std::array<double, 2> at_mm{};
  std::size_t first = 0, last = 0;
  double thickness_mm = 0;  ///< total thickness of the material there
  std::vector<std::uint8_t>
      has_material;  ///< per level: 1 if there is material all around the tool
};

/// Returns the thickest column within a height of `height_mm`. `levels`: sorted, the topmost first.
/// Consecutive levels of the column are at most `max_gap_mm` apart. Among equally thick columns, the
/// one with the most material around it is chosen, then the most central one. None: the bone is
/// nowhere as wide as the tool.
std::optional<EntryColumn> find_entry_column(const Asset& asset, const std::vector<Level>& levels,
                                             double radius_mm, double height_mm, double max_gap_mm);

/// Returns the thickness that each level stands for, from half-way to one neighbour to half-way to
/// the other. At an end the outward distance is assumed to equal the inward distance. A single
/// slice counts as a millimetre. Distances count as at most `max_gap_mm`.
std::vector<double> level_thickness(const std::vector<Level>& levels, double max_gap_mm);

}  // namespace trocar::runtime
