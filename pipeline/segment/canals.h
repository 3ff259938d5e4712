// SPDX-License-Identifier: GPL-3.0-or-later
// Finds canals, such as the spinal canal. These are soft tunnels through bone that lead along
// an axis from one opening to another. Marrow is also enclosed by bone, but its ends are
// closed by bone.
//
// In every plane across the axis, sections are formed by the enclosed pixels (plane_flood.h) into
// which a disc of radius kCanalDisc_mm fits. Sections of neighbouring planes that overlap and are
// both soft form a tube. From either end of a tube, its last section is followed further through
// planes in which it merges with other regions or in which the ring of bone is open. A tube is a
// canal if both ends reach an opening, which is the volume's border or a plane that does not enclose
// the section. One opening is enough for a tube longer than a vertebra. A canal takes the free
// pixels near its sections, except those that are nearer to another section along paths between bone.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "pipeline/segment/voxel_planes.h"

namespace trocar::pipeline {

/// Radius of the disc that fits into a canal; the least width of a spinal canal is about 10 mm.
inline constexpr double kCanalDisc_mm = 2.5;
/// The mean HU of a canal's section is below this. Marrow without fat, intervertebral discs and
/// contrast medium lie above.
inline constexpr double kMaxCanal_HU = 75;

/// Flags of each voxel for find_canals().
enum CanalFlag : std::uint8_t {
  kEnclosed = 4,    ///< given: enclosed within its plane
  kWide = 8,        ///< given: farther than kCanalDisc_mm from material within its plane
  kInCanal = 16,    ///< result
  kInSection = 32,  ///< result: the middle of a canal, which the disc's centre can reach
};

/// A canal, given by the centroids of its sections in ascending planes.
struct Canal {
  struct Section {
    std::size_t plane = 0;
    double u_mm = 0, v_mm = 0;
  };
  std::vector<Section> sections;
  double length_mm = 0;
};

/// `material` is nonzero in bone. `hu` holds packed_hu() of each voxel; its lower two bits may have
/// any value. `hu` is empty if the scan is not in HU. Sets the result flags and returns the canals,
/// the longest first. O(voxels + planes * sections).
std::vector<Canal> find_canals(const VoxelPlanes& planes, std::span<const std::uint8_t> material,
                               std::span<const std::uint8_t> hu, std::vector<std::uint8_t>& flags);

/// A value in steps of 12 HU from -200 to 568 HU in the upper six bits of a byte; the lower
/// two bits are 0.
std::uint8_t packed_hu(float value);
/// The middle of a packed value's step.
double unpacked_hu(std::uint8_t packed);

}  // namespace trocar::pipeline
