// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/segment/slice_field.h"

#include <cstddef>
#include <utility>

namespace trocar::pipeline {
namespace {

template <typename AnyImage>
AnyImage cropped(AnyImage image, const Crop& c) {
  const int width = c.x1 - c.x0 + 1, height = c.y1 - c.y0 + 1;
  decltype(image.values) values;
  values.reserve(static_cast<std::size_t>(width) * height);
  for (int y = c.y0; y <= c.y1; ++y) {
    const auto row = image.values.begin() + static_cast<std::ptrdiff_t>(y) * image.width;
    values.insert(values.end(), row + c.x0, row + c.x1 + 1);
  }
  image.width = width;
  image.height = height;
  image.values = std::move(values);
  return image;
}

}  // namespace

Result<Image> read_cropped(const SliceStack& stack, int slice, const std::optional<Crop>& crop) {
  auto image = stack.read(slice);
  if (image && crop) return cropped(std::move(*image), *crop);
  return image;
}

Result<Pixels> read_cropped(const SliceStack& stack, int slice, const MaterialOptions& options) {
  auto pixels = read_pixels(stack, slice, options.segmentation);
  if (!pixels || !options.crop) return pixels;
  return std::visit([&](auto& image) { return Pixels(cropped(std::move(image), *options.crop)); },
                    *pixels);
}

SliceField slice_field(const SliceStack& stack, int slice, const MaterialOptions& options,
                       Pixels pixels) {
  SliceField out{segment(std::move(pixels), stack.pixel_unit(), options.segmentation), {}};
  const Crop crop = options.crop.value_or(Crop{});
  if (options.table != nullptr) options.table->remove(slice, crop.x0, crop.y0, out.field);
  if (options.solid == nullptr) return out;
  out.solid_mean = options.solid->apply(slice, crop.x0, crop.y0, out.field);
  return out;
}

}  // namespace trocar::pipeline
