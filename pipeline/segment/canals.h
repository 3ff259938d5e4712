// SPDX-License-Identifier: GPL-3.0-or-later
// Finds canals, such as the spinal canal. A canal is a tunnel through bone that leads along an axis
// from one opening to another, and is filled with soft tissue or air. (Marrow is also enclosed by
// bone, but bone closes its ends.)
//
// The search works in the planes perpendicular to the axis, in five steps.
//  1. Sections: a section is a connected set of pixels of one plane. Each of these pixels is
//     enclosed by bone (plane_flood.h), and a disc of radius kCanalDisc_mm around it contains no
//     bone. A section is soft if its mean is below kMaxCanal_HU and its area is 15 to 400 mm^2.
//     The mean has no lower bound, so a section of air is soft, too. (All values below -200 HU are
//     packed as the lowest step, so they count as -194 HU in the mean.)
//  2. Tubes: two soft sections of neighbouring planes belong to one tube if they overlap by at
//     least 35 % of the larger section.
//  3. Following: the search follows each tube from plane to plane beyond both of its ends, for up
//     to 15 mm, even where the section merges with other regions or the ring of bone is open. If
//     this leads to a section of another tube, the two tubes are joined. An end of a tube is open
//     if following it leads to the volume's border, or to a plane in which the part of the section
//     that bone does not enclose has at least 35 % of the tube's median area.
//  4. Choice: a tube is a canal if both ends are open. One open end suffices for a tube of at least
//     60 mm, because hardly any marrow is so long without bone across it.
//  5. Growth: in each plane a canal takes the pixels without bone within 5.5 mm of its section,
//     except those that are nearer to a section that belongs to no canal. These distances are
//     lengths of paths that avoid bone.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "pipeline/segment/voxel_planes.h"

namespace trocar::pipeline {

/// Radius of the disc that must fit into a canal. (A spinal canal is at least about 10 mm wide.)
inline constexpr double kCanalDisc_mm = 2.5;
/// Upper bound on the mean HU of a canal's section. Marrow without fat, intervertebral discs and
/// contrast medium have higher means.
inline constexpr double kMaxCanal_HU = 75;

/// Flags of a voxel. The caller of find_canals() sets the inputs, the function the results.
enum CanalFlag : std::uint8_t {
  kEnclosed = 4,    ///< input: enclosed within its plane
  kWide = 8,        ///< input: all material in its plane is farther away than kCanalDisc_mm
  kInCanal = 16,    ///< result: in a canal
  kInSection = 32,  ///< result: in a section of a canal (step 1 or 3), not only added by step 5
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
/// longest first. `material` is nonzero in bone. `hu` has packed_hu() of each voxel in the upper
/// six bits; the caller may use the lower two bits for flags. If the scan is not in HU, `hu` is
/// empty and the HU of sections are not checked. O(voxels + planes * sections).
std::vector<Canal> find_canals(const VoxelPlanes& planes, std::span<const std::uint8_t> material,
                               std::span<const std::uint8_t> hu, std::vector<std::uint8_t>& flags);

/// Packs a value into the upper six bits of a byte, in steps of 12 HU from -200 to 568 HU. Values
/// beyond these limits are clamped. The lower two bits are 0.
std::uint8_t packed_hu(float value);
/// Returns the middle of the step of 12 HU in which the packed value lies.
double unpacked_hu(std::uint8_t packed);
/// Returns true if the packed value lies in the highest step, which stands for all values of at
/// least 556 HU.
bool is_in_highest_step(std::uint8_t packed);

}  // namespace trocar::pipeline
