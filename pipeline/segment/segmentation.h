// SPDX-License-Identifier: GPL-3.0-or-later
// Segmentation of a slice: a scalar field, and the iso-value that bounds the material.
#pragma once

#include <optional>
#include <set>
#include <variant>
#include <vector>

#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

struct Threshold {
  double value = 226;  ///< HU on calibrated input, grey level 0..255 on images
};
/// The paper's method: histogram equalisation (of the slice's whole range, mapped to 0..255), then
/// a threshold on the equalised levels.
struct Equalize {
  double level = 230;
};
/// A label map, whose material is these labels.
struct Labels {
  std::set<int> labels;
  bool all = false;  ///< every label but 0; `labels` is ignored
  /// Disjoint sets of labels. Each set is one material, and every other label is a
  /// material by itself.
  std::vector<std::set<int>> joined = {};
};
/// True if the labels are several materials. Always false with `all`, where the number depends on
/// the label map.
inline bool are_several(const Labels& labels) {
  return !labels.all && labels.labels.size() > 1 &&
         !(labels.joined.size() == 1 && labels.joined[0] == labels.labels);
}
using Segmentation = std::variant<Threshold, Equalize, Labels>;

/// Material is where field >= iso.
struct Field {
  Image image;
  float iso = 0;
  bool is_mask = false;       ///< whether the values are 0 and 1 only, which cannot be interpolated
  std::set<int> labels = {};  ///< the wanted labels that occur in the image
  /// 1 for each pixel whose value was moved across the iso-value (solid_bone.h); empty if there is
  /// none. The border between a changed pixel and another one follows the mask and not the values.
  std::vector<std::uint8_t> changed = {};
};

/// Moves the value of a pixel to the wanted side of the iso-value by mirroring it at the iso-value,
/// and marks it in Field::changed. The value must be on the other side before.
void put_on_side(Field& field, std::size_t pixel, bool wanted);

/// Mean of `values`, an image of the same size, over the pixels that are material; no value if
/// there is no such pixel. The order of summation is fixed, so the result has the same bits
/// everywhere.
std::optional<double> mean_of_material(const Field& field, const Image& values);
/// The mean of the field's own values.
inline std::optional<double> mean_of_material(const Field& field) {
  return mean_of_material(field, field.image);
}

/// Takes ownership of the image. O(pixels).
Field segment(Image image, PixelUnit unit, const Segmentation& how);

}  // namespace trocar::pipeline
