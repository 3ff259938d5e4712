// SPDX-License-Identifier: GPL-3.0-or-later
// Makes labels of the values that a label map stores.
#pragma once

#include <optional>
#include <span>
#include <string>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// A value that is no whole number is rounded if it is at most this far from one. Programs that
/// scale or resample label maps store such values (3.0000457).
inline constexpr double kMaxLabelRounding = 1e-3;

/// The labels of `values`, the row-major pixels of an image. NaN is background. `name` is the
/// slice's name in error messages. Errors: kRefused if a value is negative, above kMaxLabel, or
/// farther than kMaxLabelRounding from a whole number; the message names the first such voxel and
/// its value.
Result<LabelImage> to_labels(std::span<const double> values, int width, int height,
                             const std::string& name);

/// The same for an image of floats. Values equal to `background` are background, too. Errors: also
/// kRefused for a value above 2^24, beyond which whole numbers have merged in floats.
Result<LabelImage> to_labels(const Image& image, const std::string& name,
                             std::optional<float> background = {});

}  // namespace trocar::pipeline
