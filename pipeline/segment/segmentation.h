// SPDX-License-Identifier: GPL-3.0-or-later
// Segmentation of a slice: a scalar field, and the iso-value that bounds the material.
#pragma once

#include <optional>
#include <set>
#include <variant>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

struct Threshold {
  double value = 226;  ///< HU of calibrated input, or a grey level from 0 to 255 of images
};
/// The paper's method: histogram equalisation and then a threshold on the equalised levels. Values
/// that are not grey levels are first mapped from the slice's own range to 0..255.
struct Equalize {
  double level = 230;
};
/// The material consists of the pixels that have these labels in a label map.
struct Labels {
  std::set<int> labels;
  bool all = false;  ///< every label except 0 is wanted; `labels` is ignored
  /// Disjoint sets of labels. Each set is one material, and every other wanted label is a
  /// material by itself.
  std::vector<std::set<int>> joined = {};
};
/// Is it certain, without reading the label map, that the labels form several materials? With `all`
/// it is not, and the result is false.
inline bool are_several(const Labels& labels) {
  return !labels.all && labels.labels.size() > 1 &&
         !(labels.joined.size() == 1 && labels.joined[0] == labels.labels);
}
using Segmentation = std::variant<Threshold, Equalize, Labels>;

/// The pixels of a slice, as its segmentation needs them: labels for Labels, values otherwise.
using Pixels = std::variant<Image, LabelImage>;
/// Reads a slice as `how` needs it. Errors: those of SliceStack::read() and read_labels().
Result<Pixels> read_pixels(const SliceStack& stack, int slice, const Segmentation& how);

/// The scalar field of a slice. A pixel is material if its value is at least `iso`.
struct Field {
  Image image;
  float iso = 0;
  bool is_mask = false;       ///< whether the values are 0 and 1 only, which cannot be interpolated
  std::set<int> labels = {};  ///< the wanted labels that occur in the image
  /// 1 for each pixel whose value SolidBone or ScannerTable moved across the iso-value, otherwise
  /// 0; empty if there is no such pixel. Between a changed pixel and an unchanged one, the values
  /// do not say where the border lies (see contour.h).
  std::vector<std::uint8_t> changed = {};
};

/// Makes a pixel material (`wanted`) or background: mirrors its value at the iso-value and marks
/// the pixel in Field::changed. Precondition: the value is on the other side of the iso-value.
void put_on_side(Field& field, std::size_t pixel, bool wanted);

/// The mean of `values` over the pixels that are material in `field`; no value if there is no such
/// pixel. Precondition: both images have the same size. The order of summation is fixed, so the
/// result has the same bits everywhere.
std::optional<double> mean_of_material(const Field& field, const Image& values);
/// The mean of the field's own values over its material.
inline std::optional<double> mean_of_material(const Field& field) {
  return mean_of_material(field, field.image);
}

/// Computes the field of an image, of which it takes ownership. Precondition: `pixels` are of the
/// kind that read_pixels() gives for `how`. O(pixels).
Field segment(Pixels pixels, PixelUnit unit, const Segmentation& how);

}  // namespace trocar::pipeline
