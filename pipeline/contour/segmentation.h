// SPDX-License-Identifier: GPL-3.0-or-later
// What is material: a scalar field and the value that bounds it.
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
/// A label map: material is these labels.
struct Labels {
  std::set<int> labels;
  bool all = false;  ///< every label but 0, whatever `labels` is
  /// Disjoint sets of labels that are one material each. Every other label is a material by itself.
  std::vector<std::set<int>> joined = {};
};
/// Are these several materials? With `all` that depends on the label map: no.
inline bool are_several(const Labels& labels) {
  return !labels.all && labels.labels.size() > 1 &&
         !(labels.joined.size() == 1 && labels.joined[0] == labels.labels);
}
using Segmentation = std::variant<Threshold, Equalize, Labels>;

/// Material is where field >= iso.
struct Field {
  Image image;
  float iso = 0;
  bool is_mask = false;       ///< 0 and 1 only: nothing to interpolate
  std::set<int> labels = {};  ///< the wanted labels that occur in the image
};

/// Mean of `values`, an image of the same size, over the pixels that are material; none if there is
/// no such pixel. The order of summation is fixed, so the result has the same bits everywhere.
std::optional<double> mean_of_material(const Field& field, const Image& values);
/// Of the field's own values.
inline std::optional<double> mean_of_material(const Field& field) {
  return mean_of_material(field, field.image);
}

/// Takes ownership of the image. O(pixels).
Field segment(Image image, PixelUnit unit, const Segmentation& how);

}  // namespace trocar::pipeline
