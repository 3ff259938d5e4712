// SPDX-License-Identifier: GPL-3.0-or-later
// Canals and cavities of bone.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "pipeline/segment/components.h"

namespace trocar::pipeline {

// Finds canals, such as the spinal canal. A canal is a tunnel through bone that leads along an axis
// from one opening to another, and is filled with soft tissue or air. (Marrow is also enclosed by
// bone, but bone closes its ends.)
//
// The search works in the planes perpendicular to the axis, in five steps.
//  1. Sections: a section is a connected set of pixels of one plane. Each of these pixels is
//     enclosed by bone (components.h), and a disc of radius kCanalDisc_mm around it contains no
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

// Finds cavities that bone surrounds in every plane across an axis, such as marrow in a shaft. The
// end of the scan may cut them.
//
// A cavity is a set of voxels connected by faces. In its plane each of them is enclosed, and not
// only in a crevice (Enclosure in components.h). The cavity is closed if no voxel next to it along
// the axis is open, that is, neither material nor enclosed. What lies beyond the first and the last
// plane of the scan is unknown and does not count.

struct Cavity {
  bool is_closed = true;
  bool is_cut = false;              ///< reaches the first or the last plane of the scan
  std::size_t first = 0, last = 0;  ///< planes
  std::size_t voxels = 0;
  std::size_t behind_gap = 0;  ///< voxels that are not kSurrounded
};

struct Cavities {
  VoxelRuns runs;
  std::vector<Cavity> cavities;  ///< by VoxelRuns::Run::component

  /// Calls visit(cavity, voxel) for every voxel of the cavities.
  template <typename Visit>
  void each(const Visit& visit) const {
    for (const VoxelRuns::Run& run : runs.runs)
      for (std::size_t i = run.begin; i < run.end; ++i)
        visit(run.component, i);
  }
};

/// Finds the cavities across the axis of `planes`. enclosure_of(voxel) returns the Enclosure of a
/// voxel in its plane, and is_bone(voxel) whether it is material. `has_first` and `has_last`:
/// whether the first and the last plane are those of the scan. O(voxels).
template <typename IsBone, typename EnclosureOf>
Cavities find_cavities(const VoxelPlanes& planes, bool has_first, bool has_last,
                       const IsBone& is_bone, const EnclosureOf& enclosure_of) {
  const VoxelGrid& grid = planes.grid;
  std::vector<std::uint8_t> inside(grid.size());
  for (std::size_t i = 0; i < inside.size(); ++i)
    inside[i] = enclosure_of(i) >= kBehindGap ? 1 : 0;
  Cavities out{find_runs({grid.count(0), grid.count(1), grid.count(2)}, inside, false), {}};
  out.cavities.resize(out.runs.components);
  const std::size_t stride = planes.stride(planes.across), last = planes.count() - 1;
  const auto is_open = [&](std::size_t i) {
    return !is_bone(i) && enclosure_of(i) == kNotEnclosed;
  };
  out.each([&](std::uint32_t component, std::size_t i) {
    Cavity& cavity = out.cavities[component];
    const std::size_t plane = i / stride % planes.count();
    cavity.first = cavity.voxels == 0 ? plane : std::min(cavity.first, plane);
    cavity.last = std::max(cavity.last, plane);
    ++cavity.voxels;
    cavity.behind_gap += enclosure_of(i) == kBehindGap ? 1 : 0;
    if (plane > 0 ? is_open(i - stride) : !has_first) cavity.is_closed = false;
    if (plane < last ? is_open(i + stride) : !has_last) cavity.is_closed = false;
    cavity.is_cut |= plane == 0 || plane == last;
  });
  return out;
}

}  // namespace trocar::pipeline
