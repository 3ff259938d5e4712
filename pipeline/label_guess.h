// SPDX-License-Identifier: GPL-3.0-or-later
// Recognises by its values a label map that is given as a CT, a CT that is given with --labels, and
// a CT whose values are HU + 1024.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>

#include "pipeline/contour/segmentation.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// What the rules below need to know of some slices. A pair is two pixels side by side or one above
/// the other; pairs of which neither value lies between the lowest and the highest of its slice are
/// left out: saturated levels and the background are even in any picture.
struct ValueTally {
  double low = 0, high = 0;
  std::int64_t pixels = 0;
  bool has_fractions = false;  ///< a value that is not a whole number
  std::set<int> values;        ///< the different whole ones; one more than kMostLabels: many
  std::int64_t equal = 0;      ///< pairs of equal values
  std::int64_t steps = 0;      ///< pairs whose values differ by at most 1
  std::int64_t jumps = 0;      ///< pairs whose values differ by more
  bool has_negative = false;
  std::int64_t offset_soft_tissue = 0;  ///< pixels of 964 to 1,124

  void add(const ValueTally& other);
};

inline constexpr std::size_t kMostLabels = 256;

/// O(pixels). Without `as_labels` it stops where no rule below can hold any more, which in a CT
/// with air is at the first pixels; the figures are then of the part that was read.
ValueTally tally_values(const Image& image, bool as_labels);

/// Rule 1, looks_like_labels, of a scan in HU whose material is not chosen by labels. All of:
/// - All values are whole numbers, none is negative, and at most 256 are different. (A CT has air
///   or fat, below 0; a crop inside the body has noise.)
/// - At least two of them are not 0; or one, of at most 255, and the threshold is not half of it.
///   (A binary image is the same meshed either way at half of its level.)
/// - None is above 255, or two labels differ by 1: labels are small or numbered one after another,
///   which the HU of a phantom's materials are not.
/// - The values form even regions: of the pairs at least 55 % are equal; and, if there are more
///   than 16 values, at least 40 % of the other pairs differ by more than 1. (A CT in a window of
///   8 bits has less than 10 % of equal pairs; where it is smoothed, its values change by 1.)
///
/// Rule 2, looks_like_ct, of any scan whose material is chosen by labels. One of:
/// - Some values are not whole numbers.
/// - Less than a third of the pairs are equal, and the unequal ones are at least 32 and 1 % of all
///   pixels. (Label maps of vertebrae at 1.5 mm have 66 % and more; single marked voxels are few.)
///
/// Rule 3, looks_offset, of a scan in HU whose material is chosen by a threshold: no value is
/// negative, more than 256 are different, and at least 15 % of the pixels are 964 to 1,124, which
/// is soft tissue with 1,024 added. (In a CT some 1 % are bone as dense as that.)
///
/// Images (grey levels) are under rule 2 only: their threshold is never the default, and pictures
/// of few levels are usual. Returns the code and a sentence that names what was found and what to
/// try, or nothing. `where` is the input's name.
std::optional<Warning> value_doubt(const ValueTally& tally, PixelUnit unit, const Segmentation& how,
                                   const std::string& where);

}  // namespace trocar::pipeline
