// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/label_values.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "pipeline/base/number_ranges.h"

namespace trocar::pipeline {
namespace {

// In floats, whole numbers above it merge.
constexpr double kMaxOfFloats = 1 << 24;

std::string value_text(double value) {
  constexpr double kExact = 9007199254740992;  // 2^53
  if (std::rint(value) == value && std::abs(value) <= kExact)
    return std::to_string(static_cast<std::int64_t>(value));
  return text_of(value, 15);
}

template <typename T>
Result<LabelImage> labels_of(std::span<const T> values, int width, int height,
                             const std::string& name, double max, std::optional<T> background) {
  LabelImage out{width, height, {}};
  out.values.resize(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto value = static_cast<double>(values[i]), whole = std::rint(value);
    const double rounding = std::abs(value - whole);
    if (std::isnan(value) || values[i] == background) {
      out.not_numbers += std::isnan(value) ? 1 : 0;
    } else if (rounding <= kMaxLabelRounding && whole >= 0 && whole <= max) {
      out.values[i] = static_cast<std::int32_t>(whole);
      if (rounding == 0) continue;
      ++out.rounded;
      out.largest_rounding = std::max(out.largest_rounding, rounding);
    } else {
      const auto across = static_cast<std::size_t>(width);
      return refused(name + ": voxel " + std::to_string(i % across) + ", " +
                     std::to_string(i / across) + " is " + value_text(value) +
                     ", which is no label, a whole number from 0 to " + value_text(max) +
                     "; if this is no label map, try it without --labels");
    }
  }
  return out;
}

}  // namespace

Result<LabelImage> to_labels(std::span<const double> values, int width, int height,
                             const std::string& name) {
  return labels_of(values, width, height, name, kMaxLabel, std::optional<double>());
}

Result<LabelImage> to_labels(const Image& image, const std::string& name,
                             std::optional<float> background) {
  auto out =
      labels_of(std::span(image.values), image.width, image.height, name, kMaxOfFloats, background);
  if (out) out->not_numbers += image.not_numbers;
  return out;
}

}  // namespace trocar::pipeline
