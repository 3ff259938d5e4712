// SPDX-License-Identifier: GPL-3.0-or-later
// Finds canals, such as the spinal canal. A canal is a soft tunnel through bone that leads along an
// axis from one opening to another. (Marrow is also enclosed by bone, but bone closes its ends.)
//
// The search works in the planes across the axis. A section is a connected set of enclosed pixels
// (plane_flood.h) of one plane on which the centre of a disc of radius kCanalDisc_mm can lie
// without touching bone. Soft sections of neighbouring planes that overlap form a tube. From each
// end of a tube, its last section is followed further, through planes in which the section merges
// with other regions or in which the ring of bone is open. Tubes that meet while they are followed
// are joined. An opening is the volume's border or a plane that does not enclose the section. A
// tube is a canal if both of its ends reach an opening. If the tube is longer than a vertebra, one
// end is enough. A canal takes the free pixels near its sections, except those that are nearer to
// another section along paths between bone.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "pipeline/segment/voxel_planes.h"

namespace trocar::pipeline {

/// Radius of the disc that must fit into a canal. (The least width of a spinal canal is about 10
/// mm.)
inline constexpr double kCanalDisc_mm = 2.5;
/// Upper bound on the mean HU of a canal's section. Marrow without fat, intervertebral discs and
/// contrast medium have higher means.
inline constexpr double kMaxCanal_HU = 75;

/// Flags of each voxel. The caller of find_canals() sets the inputs, and the function the results.
enum CanalFlag : std::uint8_t {
  kEnclosed = 4,    ///< input: enclosed within its plane
  kWide = 8,        ///< input: farther than kCanalDisc_mm from material within its plane
  kInCanal = 16,    ///< result: in a canal
  kInSection = 32,  ///< result: in a section, the middle of a canal
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

/// Finds the canals along the axis of `planes`, sets the result flags and returns the canals, the
/// longest first. `material` is nonzero in bone. `hu` holds packed_hu() of each voxel, whose lower
/// two bits may have any value. If the scan is not in HU, `hu` is empty and every section counts as
/// soft. O(voxels + planes * sections).
std::vector<Canal> find_canals(const VoxelPlanes& planes, std::span<const std::uint8_t> material,
                               std::span<const std::uint8_t> hu, std::vector<std::uint8_t>& flags);

/// Packs a value into the upper six bits of a byte, in steps of 12 HU from -200 to 568 HU. The
/// lower two bits are 0.
std::uint8_t packed_hu(float value);
/// The middle of the step in which a packed value lies.
double unpacked_hu(std::uint8_t packed);

}  // namespace trocar::pipeline
