// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/segment/segmentation.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>
#include <opencv2/imgproc.hpp>

namespace trocar::pipeline {
namespace {

// cv::equalizeHist on 8 bits. The levels of an image file are used as they are; a calibrated slice
// is first mapped from its own range to 0..255.
void equalize(Image& image, PixelUnit unit) {
  const auto [low, high] = std::minmax_element(image.values.begin(), image.values.end());
  const float offset = unit == PixelUnit::kGrey ? 0.0F : *low;
  const float scale = unit == PixelUnit::kGrey ? 1.0F : 255.0F / std::max(*high - *low, 1e-6F);
  cv::Mat levels(image.height, image.width, CV_8U);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      levels.at<std::uint8_t>(y, x) =
          cv::saturate_cast<std::uint8_t>((image.at(x, y) - offset) * scale);
    }
  }
  cv::equalizeHist(levels, levels);
  std::copy(levels.begin<std::uint8_t>(), levels.end<std::uint8_t>(), image.values.begin());
}

Field mask_of(const LabelImage& image, const Labels& wanted) {
  Field field{{image.width, image.height, {}, image.not_numbers}, 0.5F, true};
  field.image.values.reserve(image.values.size());
  std::int32_t last = 0;
  for (const std::int32_t label : image.values) {
    const bool in = wanted.all ? label != 0 : wanted.labels.contains(label);
    if (in && (field.labels.empty() || label != last)) field.labels.insert(last = label);
    field.image.values.push_back(in ? 1.0F : 0.0F);
  }
  return field;
}

}  // namespace

void put_on_side(Field& field, std::size_t pixel, bool wanted) {
  if (field.changed.empty()) field.changed.resize(field.image.values.size(), 0);
  field.changed[pixel] = 1;
  float& value = field.image.values[pixel];
  const float mirrored = 2 * field.iso - value;
  // A value equal to the iso-value, or to it after rounding, moves by the smallest step.
  const float nearest = std::nextafter(field.iso, -std::numeric_limits<float>::infinity());
  value = wanted ? std::max(mirrored, field.iso) : std::min(mirrored, nearest);
}

std::optional<double> mean_of_material(const Field& field, const Image& of) {
  // Vector units add the eight partial sums at once, and the order of summation is fixed.
  constexpr std::size_t kLanes = 8;
  std::array<double, kLanes> sum{};
  std::array<std::int32_t, kLanes> count{};
  const std::vector<float>&levels = field.image.values, &values = of.values;
  const float iso = field.iso;
  const auto add_lanes = [&](std::size_t i) {
    // Masks, because the compiler would make branches of a condition.
    for (std::size_t k = 0; k < kLanes; ++k) {
      const std::uint32_t mask = levels[i + k] >= iso ? ~std::uint32_t{0} : 0;
      sum[k] += static_cast<double>(
          std::bit_cast<float>(std::bit_cast<std::uint32_t>(values[i + k]) & mask));
      count[k] += static_cast<std::int32_t>(mask & 1);
    }
  };
  // In most blocks, all pixels are outside the material.
  constexpr std::size_t kBlock = 8 * kLanes;
  std::size_t i = 0;
  for (; i + kBlock <= values.size(); i += kBlock) {
    std::uint32_t any = 0;
    for (std::size_t k = 0; k < kBlock; ++k)
      any |= levels[i + k] >= iso ? 1U : 0U;
    for (std::size_t k = 0; any != 0 && k < kBlock; k += kLanes)
      add_lanes(i + k);
  }
  for (; i + kLanes <= values.size(); i += kLanes)
    add_lanes(i);
  for (; i < values.size(); ++i) {
    sum[0] += levels[i] >= iso ? static_cast<double>(values[i]) : 0.0;
    count[0] += levels[i] >= iso ? 1 : 0;
  }
  const std::int64_t pixels = std::accumulate(count.begin(), count.end(), std::int64_t{0});
  if (pixels == 0) return std::nullopt;
  return std::accumulate(sum.begin(), sum.end(), 0.0) / static_cast<double>(pixels);
}

Result<Pixels> read_pixels(const SliceStack& stack, int slice, const Segmentation& how) {
  if (std::holds_alternative<Labels>(how)) {
    auto labels = stack.read_labels(slice);
    if (!labels) return labels.error();
    return Pixels(std::move(*labels));
  }
  auto image = stack.read(slice);
  if (!image) return image.error();
  return Pixels(std::move(*image));
}

Field segment(Pixels pixels, PixelUnit unit, const Segmentation& how) {
  if (const auto* labels = std::get_if<Labels>(&how))
    return mask_of(std::get<LabelImage>(pixels), *labels);
  Field field{std::get<Image>(std::move(pixels)), 0};
  if (const auto* threshold = std::get_if<Threshold>(&how)) {
    field.iso = static_cast<float>(threshold->value);
  } else {
    equalize(field.image, unit);
    field.iso = static_cast<float>(std::get<Equalize>(how).level);
  }
  return field;
}

}  // namespace trocar::pipeline
