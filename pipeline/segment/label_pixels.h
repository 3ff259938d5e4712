// SPDX-License-Identifier: GPL-3.0-or-later
// Materials of the pixels of a label map, and label maps that are found by their values.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/segment/segmentation.h"

namespace trocar::pipeline {

// Assigns the pixels of a label map to materials, each of which is a set of labels. Also defines
// which pixels of a material are connected.

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

// Detects, from the values alone, a label map that is given as a CT, a CT that is given with
// --labels, and a CT whose values are HU + 1024.

/// Statistics of the values of some slices, for the rules below. A pair is two pixels side by side
/// or one above the other. Saturated levels and the background are uniform in any picture.
/// Therefore a pair is counted only if at least one of its values lies strictly between the lowest
/// and the highest value of the slice.
struct ValueTally {
  double low = 0, high = 0;
  std::int64_t pixels = 0;
  bool has_fractions = false;  ///< whether some value is not a whole number
  /// Whether some value is beyond 2^24 in an Image, where whole numbers have merged. `values` does
  /// not have such values.
  bool has_inexact = false;
  std::set<int> values;    ///< the different whole numbers, at most kMaxLabels + 1
  std::int64_t equal = 0;  ///< number of pairs of equal values
  std::int64_t steps = 0;  ///< number of pairs that differ, but by at most 1
  std::int64_t jumps = 0;  ///< number of pairs that differ by more than 1
  bool has_negative = false;
  /// Number of pixels with values from 964 to 1,124: soft tissue whose HU have 1,024 added.
  std::int64_t offset_soft_tissue = 0;
  std::int64_t rounded = 0;     ///< LabelImage::rounded, added up
  double largest_rounding = 0;  ///< largest LabelImage::largest_rounding

  void add(const ValueTally& other);
};

inline constexpr std::size_t kMaxLabels = 256;

/// Computes the statistics of a slice. Without `as_labels` the function stops at the first negative
/// value, because no rule below can apply then. (A CT with air has a negative value among its first
/// pixels.) The result then counts the pixels read so far and no pairs. O(pixels).
ValueTally tally_values(const Image& image, bool as_labels);
ValueTally tally_values(const LabelImage& image);
ValueTally tally_values(const Pixels& pixels, bool as_labels);

/// Checks the statistics by the three rules below. Returns a warning that names the values found
/// and what to try, or no value. `where` is the name of the input.
///
/// Rule 1, looks_like_labels, applies to a scan in HU whose material is not chosen by labels. All
/// of these conditions must hold:
///  - All values are whole numbers, none is negative, and at most 256 are different. (A CT has air
///    or fat, below 0. A crop inside the body may have neither, but its noise gives more than 256
///    different values.)
///  - At least two different values are not 0. Exception: a mask has only 0 and one other value.
///    This value suffices if it is at most 255 and the threshold is not half of the value. (If the
///    threshold is half of the value, the mesh is the same as with --labels.)
///  - No value is above 255, or two of the values other than 0 differ by 1, or a value is above
///    2^24. (Labels are small, numbered one after another, or huge. The HU of a phantom's materials
///    are none of these.)
///  - The values form uniform regions: at least 55 % of the pairs are equal. If there are more
///    than 16 values, at least 40 % of the unequal pairs differ by more than 1. (In a CT in a
///    window of 8 bits less than 10 % of the pairs are equal. Where the CT is smooth,
///    neighbours differ by 1.)
///
/// Rule 2, looks_like_ct, applies to any scan whose material is chosen by labels. Its condition:
/// less than a third of the pairs are equal, and the number of unequal pairs is at least 32 and at
/// least 1 % of all pixels. (In label maps of vertebrae at 1.5 mm, at least 66 % of the pairs are
/// equal. Single marked voxels give few unequal pairs.)
///
/// Rule 3, looks_offset, applies to a scan in HU whose material is chosen by a threshold. All of
/// these conditions must hold: no value is negative, more than 256 are different, and at least 15 %
/// of the pixels have values from 964 to 1,124. These are the HU of soft tissue with 1,024 added.
/// (In a CT about 1 % of the pixels are bone with such values.)
///
/// If the values are not HU, only rule 2 applies, because pictures with few grey levels are usual.
std::optional<Warning> value_warning(const ValueTally& tally, PixelUnit unit,
                                     const Segmentation& how, const std::string& where);

/// The warning labels_rounded, which counts the voxels whose stored values are not whole numbers
/// (LabelImage::rounded); no value if there is none.
std::optional<Warning> rounding_warning(const ValueTally& tally, const std::string& where);

}  // namespace trocar::pipeline
