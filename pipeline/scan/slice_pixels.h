// SPDX-License-Identifier: GPL-3.0-or-later
// Segments the pixels of one slice and assigns them to materials.
#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "pipeline/scan/mesh_slice.h"
#include "pipeline/segment/label_pixels.h"

namespace trocar::pipeline {

struct SlicePixels {
  Field field;  ///< treats all materials as one
  /// The values before segmentation, if a later stage needs them and `field` no longer has them.
  std::optional<Image> original;
  std::optional<LabelImage> labels;  ///< the labels, if there may be several materials
  std::optional<Image> ct;           ///< the CT of a label map
  bool needs_hu = false;             ///< a later stage uses the slice's own values as HU
  std::optional<double> solid_mean;  ///< result of SolidBone::apply()
  /// The material of each pixel if the slice has several materials. If it has one, this is empty,
  /// because `field` suffices.
  MaterialImage several = {};

  /// The image of HU for the HU field and graded areas; null if there is none.
  const Image* hu() const {
    if (ct) return &*ct;
    if (!needs_hu) return nullptr;
    return original ? &*original : &field.image;
  }
  /// Moves the image of hu() out of this object and returns it; no value if there is none.
  std::optional<Image> take_hu() {
    if (ct) return std::move(ct);
    if (!needs_hu) return std::nullopt;
    return original ? std::move(original) : std::move(field.image);
  }
};

struct SliceImages {
  Pixels pixels;
  std::optional<Image> ct;
};

/// Reads the pixels of a slice, and the CT of a label map. Errors: those of read_pixels().
Result<SliceImages> read_slice(const SliceStack& stack, int slice, const MeshOptions& options);

/// Segments a slice. Sets these members of `out`: materials (at least one entry, with first_label
/// and mean_hu), labels, values, all_material and changes.solid. Errors: kRefused if there are too many materials;
/// kUsage if an option needs a single material and there are several.
Result<SlicePixels> segment_slice(const SliceStack& stack, int slice, const MeshOptions& options,
                                  SliceImages images, MeshedSlice& out);

}  // namespace trocar::pipeline
