// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/scan/slice_pixels.h"

#include <algorithm>
#include <cstdint>
#include <utility>

namespace trocar::pipeline {
namespace {

// The materials of a label map. If `solid` is not null, it has changed `field`, and the materials
// follow the field.
Result<LabelMaterials> materials_of_field(const LabelImage& labels, const Labels& wanted,
                                          const SolidBone* solid, const Field& field) {
  auto out = label_materials(labels, wanted);
  if (!out || solid == nullptr) return out;
  std::vector<MaterialNumber>& values = out->image.values;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (field.image.values[i] < field.iso) {
      values[i] = kNoMaterial;
    } else if (values[i] == kNoMaterial) {  // filled, so there is only one material
      if (out->first_labels.empty()) out->first_labels = {solid->filled_label()};
      values[i] = 1;
    }
  }
  return out;
}

// The mean of an image of the same size over the pixels of each material.
std::vector<std::optional<double>> means_of(const MaterialImage& image, const Image& values) {
  std::vector<std::pair<double, std::int64_t>> sums(image.labels.size() + 1);
  for (std::size_t i = 0; i < image.values.size(); ++i) {
    auto& [sum, count] = sums[image.values[i]];
    sum += static_cast<double>(values.values[i]);
    ++count;
  }
  std::vector<std::optional<double>> out;
  for (std::size_t m = 1; m < sums.size(); ++m) {
    const auto& [sum, count] = sums[m];
    out.push_back(count == 0 ? std::nullopt : std::optional(sum / static_cast<double>(count)));
  }
  return out;
}

// The areas of the pixels of Field::changed.
AreaChange changed_area(const Field& field, const SlicePlane& plane) {
  const double pixel_mm2 = plane.spacing_u_mm * plane.spacing_v_mm;
  std::size_t dropped = 0, filled = 0;
  for (std::size_t i = 0; i < field.changed.size(); ++i)
    if (field.changed[i] != 0) ++(field.image.values[i] >= field.iso ? filled : dropped);
  return {static_cast<double>(dropped) * pixel_mm2, static_cast<double>(filled) * pixel_mm2};
}

// Appends the materials of the slice to `out`; several of them also set pixels.several.
Result<void> list_materials(const SliceStack& stack, const MeshOptions& options,
                            SlicePixels& pixels, std::vector<MeshedMaterial>& out) {
  MeshedMaterial& only = out.emplace_back();
  if (const auto* labels = std::get_if<Labels>(&options.segmentation)) {
    if (!labels->labels.empty()) only.first_label = *labels->labels.begin();
    if (pixels.labels) {
      auto found = materials_of_field(*pixels.labels, *labels, options.solid, pixels.field);
      if (!found) return found.error();
      const std::vector<int>& first_labels = found->first_labels;
      if (first_labels.size() == 1) only.first_label = first_labels[0];
      if (first_labels.size() > 1) {
        if (options.contour == ContourKind::kPixel)
          return usage(
              "--contour pixel leaves gaps between materials: leave it out, or join the "
              "labels with +, as --labels 20+21");
        pixels.several = std::move(found->image);
        out.resize(first_labels.size());
        std::vector<std::optional<double>> means(out.size());
        if (pixels.ct) means = means_of(pixels.several, *pixels.ct);
        for (std::size_t m = 0; m < out.size(); ++m) {
          out[m].first_label = first_labels[m];
          out[m].mean_hu = means[m];
        }
        return {};
      }
    }
    if (pixels.ct) only.mean_hu = mean_of_material(pixels.field, *pixels.ct);
  } else if (stack.pixel_unit() == PixelUnit::kHounsfield &&
             std::holds_alternative<Threshold>(options.segmentation)) {
    only.mean_hu = options.solid != nullptr ? pixels.solid_mean : mean_of_material(pixels.field);
  }
  return {};
}

}  // namespace

Result<SliceImages> read_slice(const SliceStack& stack, int slice, const MeshOptions& options) {
  auto pixels = read_cropped(stack, slice, options);
  if (!pixels) return pixels.error();
  SliceImages out{std::move(*pixels), {}};
  if (options.hu == nullptr) return out;
  auto ct = read_cropped(*options.hu, slice, options.crop);
  if (!ct) return ct.error();
  out.ct = std::move(*ct);
  return out;
}

Result<SlicePixels> segment_slice(const SliceStack& stack, int slice, const MeshOptions& options,
                                  SliceImages images, MeshedSlice& out) {
  const auto* labels = std::get_if<Labels>(&options.segmentation);
  const bool is_hu = stack.pixel_unit() == PixelUnit::kHounsfield;
  if (labels != nullptr || is_hu) out.values = tally_values(images.pixels, labels != nullptr);

  SlicePixels pixels;
  pixels.ct = std::move(images.ct);
  pixels.needs_hu =
      is_hu && labels == nullptr && (options.hu_volume || options.hu_field || options.grade_hu > 0);
  const bool changes_values = options.solid != nullptr || options.table != nullptr ||
                              !std::holds_alternative<Threshold>(options.segmentation);
  if (pixels.needs_hu && changes_values) pixels.original = std::get<Image>(images.pixels);
  if (labels != nullptr && (labels->all || are_several(*labels)))
    pixels.labels = std::get<LabelImage>(images.pixels);
  SliceField segmented = slice_field(stack, slice, options, std::move(images.pixels));
  pixels.field = std::move(segmented.field);
  pixels.solid_mean = segmented.solid_mean;
  out.labels = std::move(pixels.field.labels);
  if (options.solid != nullptr) out.changes.solid = changed_area(pixels.field, stack.plane(slice));
  if (auto ok = list_materials(stack, options, pixels, out.materials); !ok) return ok.error();
  const std::vector<float>& values = pixels.field.image.values;
  out.all_material = std::all_of(values.begin(), values.end(),
                                 [iso = pixels.field.iso](float value) { return value >= iso; });
  return pixels;
}

}  // namespace trocar::pipeline
