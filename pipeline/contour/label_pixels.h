// SPDX-License-Identifier: GPL-3.0-or-later
// A label map's pixels as materials, each a set of labels, and which of them are connected.
#pragma once

#include <cstdint>
#include <set>
#include <span>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/contour/segmentation.h"

namespace trocar::pipeline {

using MaterialNumber = std::uint16_t;
inline constexpr MaterialNumber kNoMaterial = 0;
inline constexpr std::size_t kMostMaterials = 65'535;

/// Row-major, as Image: kNoMaterial, or one more than the index of the pixel's material.
struct MaterialImage {
  int width = 0, height = 0;
  std::vector<MaterialNumber> values;
  /// By material: its labels that occur in the image.
  std::vector<std::set<int>> labels;

  MaterialNumber at(int x, int y) const { return values[static_cast<std::size_t>(y) * width + x]; }
};

/// A pixel belongs to the first of the materials that has its label; a label is a whole number.
/// At most kMostMaterials. O(pixels).
MaterialImage material_image(const Image& labels, std::span<const Labels> materials);

/// The materials of a label map (Labels::joined) that occur in an image.
struct FoundMaterials {
  MaterialImage image;
  /// By material, ascending: the smallest of its labels, whether or not this one occurs. It names
  /// the material in every slice.
  std::vector<int> first_labels;
};
/// Refused if there are more than kMostMaterials. O(pixels + m log m) for m materials.
Result<FoundMaterials> found_materials(const Image& labels, const Labels& wanted);

/// Which diagonal of a cell of four pixels a, b, c, d, counter-clockwise, is connected, if all
/// neighbours differ.
enum class Diagonal : std::uint8_t {
  kNone,  ///< the materials meet in a point
  kAC,
  kBD,
};

/// A diagonal of one material is connected; of two such, that of the material named first. What is
/// no material is never connected, so that two materials on the other diagonal meet in a point.
inline Diagonal connected_diagonal(MaterialNumber a, MaterialNumber b, MaterialNumber c,
                                   MaterialNumber d) {
  const bool ac = a == c && a != kNoMaterial, bd = b == d && b != kNoMaterial;
  if (ac && (!bd || a < b)) return Diagonal::kAC;
  return bd ? Diagonal::kBD : Diagonal::kNone;
}

/// Gives each piece (connected pixels of one material) of less than `min_pixels` in area, the
/// smallest first, to what it has the longest border with: another material, or none. A hole
/// (connected pixels of no material that do not reach the image's border) counts as a piece, so
/// that it is filled. Every pixel belongs to one piece before and after: no gap or overlap arises.
/// Of equal borders the material named first wins, and none is last. The area is that within the
/// half-way outline (half a pixel for a single one), without holes; that of merged pieces is the
/// sum of theirs. O(pixels + n log n) for n pieces.
void merge_small_pieces(MaterialImage& image, double min_pixels);

}  // namespace trocar::pipeline
