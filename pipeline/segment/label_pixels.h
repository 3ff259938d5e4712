// SPDX-License-Identifier: GPL-3.0-or-later
// Assigns the pixels of a label map to materials, each of which is a set of labels. Also defines
// which pixels of a material are connected.
#pragma once

#include <cstdint>
#include <set>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/segment/segmentation.h"

namespace trocar::pipeline {

using MaterialNumber = std::uint16_t;
inline constexpr MaterialNumber kNoMaterial = 0;
inline constexpr std::size_t kMaxMaterials = 65'535;

/// The material of each pixel. `values` is row-major, as in Image. A value is kNoMaterial, or one
/// more than the index of the pixel's material in `labels`.
struct MaterialImage {
  int width = 0, height = 0;
  std::vector<MaterialNumber> values;
  /// One set for each material, with its labels that occur in the image.
  std::vector<std::set<int>> labels;

  MaterialNumber at(int x, int y) const { return values[static_cast<std::size_t>(y) * width + x]; }
};

/// The materials of a label map (Labels::joined) that occur in an image.
struct LabelMaterials {
  MaterialImage image;
  /// The smallest label of each material, even if this label does not occur in the image. It
  /// identifies the material in every slice. The list is in ascending order.
  std::vector<int> first_labels;
};
/// Assigns each pixel to its material of `wanted`. Errors: kRefused if more than kMaxMaterials
/// materials occur. O(pixels + m log m) for m materials.
Result<LabelMaterials> label_materials(const LabelImage& labels, const Labels& wanted);

/// The diagonal along which a cell of four pixels a, b, c, d (counter-clockwise) is connected. This
/// concerns only cells in which any two pixels that share an edge have different materials.
enum class Diagonal : std::uint8_t {
  kNone,  ///< no diagonal is connected
  kAC,
  kBD,
};

/// A diagonal is connected if both of its pixels have the same material. If this holds for both
/// diagonals, only the diagonal of the material with the lower number is connected. A diagonal of
/// background is never connected. If background is on one diagonal and two different materials are
/// on the other, these materials touch in a point.
inline Diagonal connected_diagonal(MaterialNumber a, MaterialNumber b, MaterialNumber c,
                                   MaterialNumber d) {
  const bool ac = a == c && a != kNoMaterial, bd = b == d && b != kNoMaterial;
  if (ac && (!bd || a < b)) return Diagonal::kAC;
  return bd ? Diagonal::kBD : Diagonal::kNone;
}

/// Merges small components into their neighbours. A component consists of connected pixels of one
/// material. If its area is less than `min_pixels`, it becomes a part of the neighbour with which
/// it has the longest border: another material or the background. If two borders are equally long,
/// the material with the lowest number is chosen, and background last. The smallest component is
/// merged first. A hole (connected background that does not extend to the image's border) is
/// treated as a component, so small holes are filled. Every pixel belongs to one component before
/// and after the merging, so no gap or overlap arises. The area of a component is the area within
/// its outline, without holes. This outline runs half-way between pixels and cuts off corners, so a
/// single pixel has an area of half a pixel. The area of a merged component is the sum of the areas
/// of its components. O(pixels + n log n) for n components.
void merge_small_components(MaterialImage& image, double min_pixels);

}  // namespace trocar::pipeline
