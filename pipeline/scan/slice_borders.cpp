// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/scan/slice_borders.h"

#include <algorithm>
#include <utility>

#include "pipeline/contour/simplification.h"
#include "pipeline/segment/label_pixels.h"

namespace trocar::pipeline {
namespace {

// Merges small components (merge_small_components()) and adds their areas to `change`.
void merge_small(MaterialImage& image, const PixelGrid& grid, double min_region_mm2,
                 AreaChange* change) {
  const std::vector<MaterialNumber> before = image.values;
  const double pixel_mm2 = grid.spacing_u_mm * grid.spacing_v_mm;
  merge_small_components(image, min_region_mm2 / pixel_mm2);
  if (change == nullptr) return;
  std::size_t dropped = 0, filled = 0;
  for (std::size_t i = 0; i < before.size(); ++i) {
    if (before[i] == image.values[i]) continue;
    dropped += before[i] != kNoMaterial ? 1 : 0;
    filled += image.values[i] != kNoMaterial ? 1 : 0;
  }
  change->dropped_mm2 += static_cast<double>(dropped) * pixel_mm2;
  change->filled_mm2 += static_cast<double>(filled) * pixel_mm2;
}

// The smooth outline of a mask.
Pslg smooth_outline(const Field& field, const PixelGrid& grid, double min_region_mm2,
                    AreaChange* change) {
  MaterialImage image{field.image.width, field.image.height, {}, {}};
  image.labels.resize(1);
  image.values.reserve(field.image.values.size());
  for (const float value : field.image.values)
    image.values.push_back(value >= field.iso ? 1 : kNoMaterial);
  merge_small(image, grid, min_region_mm2, change);
  return std::move(material_outlines(label_borders(image, grid)).front());
}

// Removes the materials without pixels from the image and from the list `out` of materials.
void leave_out_empty(MaterialImage& image, std::vector<MeshedMaterial>& out) {
  std::vector<MaterialNumber> number(out.size() + 1, kNoMaterial);
  for (const MaterialNumber m : image.values)
    number[m] = 1;
  number[kNoMaterial] = kNoMaterial;
  std::size_t left = 0;
  for (std::size_t m = 1; m < number.size(); ++m) {
    if (number[m] == 0) continue;
    if (left != m - 1) {
      out[left] = std::move(out[m - 1]);
      image.labels[left] = std::move(image.labels[m - 1]);
    }
    number[m] = static_cast<MaterialNumber>(++left);
  }
  out.resize(left);
  image.labels.resize(left);
  for (MaterialNumber& m : image.values)
    m = number[m];
}

}  // namespace

PixelGrid pixel_grid(const SlicePlane& plane, const MeshOptions& options) {
  const Crop crop = options.crop.value_or(Crop{});
  return {plane.spacing_u_mm, plane.spacing_v_mm, crop.x0, crop.y0, options.lattice};
}

Pslg contours_of(const SliceStack& stack, int slice, const MeshOptions& options, const Field& field,
                 AreaChange* change) {
  const PixelGrid grid = pixel_grid(stack.plane(slice), options);
  if (field.is_mask && options.contour == ContourKind::kSubpixel)
    return smooth_outline(field, grid, options.min_region_mm2, change);
  return drop_small_rings(contours(field, grid, options.contour), options.min_region_mm2,
                          options.lattice, change);
}

SliceBorders slice_contours(const SliceStack& stack, int slice, const MeshOptions& options,
                            SlicePixels& pixels, std::vector<MeshedMaterial>& materials,
                            AreaChange& change) {
  if (materials.size() == 1)
    return {{contours_of(stack, slice, options, pixels.field, &change)}, {}};
  const PixelGrid grid = pixel_grid(stack.plane(slice), options);
  merge_small(pixels.several, grid, options.min_region_mm2, &change);
  leave_out_empty(pixels.several, materials);
  LabelBorders borders = label_borders(pixels.several, grid);
  SliceBorders out{material_outlines(borders), {}};
  if (materials.size() > 1) {
    out.shared = std::move(borders);
  } else {
    materials.resize(1);
    out.outlines.resize(1);
  }
  return out;
}

SliceBorders simplified(const SliceBorders& contours, const Lattice& lattice,
                        const SimplificationOptions& options) {
  if (!contours.shared) return {{simplify(contours.outlines[0], lattice, options)}, {}};
  LabelBorders shared = simplify(*contours.shared, lattice, options);
  std::vector<Pslg> outlines = material_outlines(shared);
  return {std::move(outlines), std::move(shared)};
}

std::vector<double> distances_mm(const SliceBorders& contours, const SliceBorders& other,
                                 const Lattice& lattice) {
  if (!contours.shared) return {hausdorff_mm(contours.outlines[0], other.outlines[0], lattice)};
  const LabelBorders& full = *contours.shared;
  std::vector<double> out(full.materials, 0);
  for (std::size_t c = 0; c < full.chains.size(); ++c) {
    const BorderChain& chain = full.chains[c];
    const double mm = hausdorff_mm({{chain.points}}, {{other.shared->chains[c].points}}, lattice,
                                   {!chain.is_closed});
    for (const MaterialNumber m : {chain.left, chain.right}) {
      if (m != kNoMaterial) out[m - 1U] = std::max(out[m - 1U], mm);
    }
  }
  return out;
}

double moved_area_mm2(const SliceBorders& contours, const SliceBorders& other,
                      const Lattice& lattice, double beyond_mm) {
  if (!contours.shared)
    return moved_area_mm2(contours.outlines[0], other.outlines[0], lattice, beyond_mm);
  double sum = 0;
  for (std::size_t c = 0; c < contours.shared->chains.size(); ++c) {
    const BorderChain& chain = contours.shared->chains[c];
    sum += moved_area_mm2({{chain.points}}, {{other.shared->chains[c].points}}, lattice, beyond_mm,
                          {!chain.is_closed});
  }
  return sum;
}

}  // namespace trocar::pipeline
