// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/segment/slice_field.h"

#include <cstddef>
#include <utility>

namespace trocar::pipeline {
namespace {

Image cropped(Image image, const Crop& c) {
  Image out{c.x1 - c.x0 + 1, c.y1 - c.y0 + 1, {}, image.not_numbers};
  out.values.reserve(static_cast<std::size_t>(out.width) * out.height);
  for (int y = c.y0; y <= c.y1; ++y) {
    const auto row = image.values.begin() + static_cast<std::ptrdiff_t>(y) * image.width;
    out.values.insert(out.values.end(), row + c.x0, row + c.x1 + 1);
  }
  return out;
}

}  // namespace

Result<Image> read_cropped(const SliceStack& stack, int slice, const std::optional<Crop>& crop) {
  auto image = stack.read(slice);
  if (image && crop) return cropped(std::move(*image), *crop);
  return image;
}

SliceField slice_field(const SliceStack& stack, int slice, const MaterialOptions& options,
                       Image image) {
  SliceField out{segment(std::move(image), stack.pixel_unit(), options.segmentation), {}};
  const Crop crop = options.crop.value_or(Crop{});
  if (options.table != nullptr) options.table->remove(slice, crop.x0, crop.y0, out.field);
  if (options.solid == nullptr) return out;
  out.solid_mean = options.solid->apply(slice, crop.x0, crop.y0, out.field);
  return out;
}

}  // namespace trocar::pipeline
