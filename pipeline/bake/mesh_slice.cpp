// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/bake/mesh_slice.h"

#include <memory>
#include <numbers>

#include "formats/asset/asset.h"
#include "formats/mesh/refinement_outline.h"
#include "formats/mesh/regions.h"
#include "formats/mesh/shared_borders.h"
#include "pipeline/read/number_ranges.h"
#include "pipeline/read/parallel_for.h"

namespace trocar::pipeline {
namespace {

struct SliceBorders {
  std::vector<Pslg> outlines;  // outline of each material
  // If there are several materials: all of their borders, also those with the background.
  // `outlines` are then the result of material_outlines() for these borders.
  std::optional<LabelBorders> shared;
};

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

constexpr double kGrowth = 0.5;  // growth of the edge length per distance
constexpr double kAreaOfEdge2 = std::numbers::sqrt3 / 4;

// Rotates the corners: the corner opposite edge 0 comes first, as in refined meshes.
SliceMesh stored_cdt(SliceMesh mesh) {
  for (Triangle& t : mesh.triangles)
    t = {t[2], t[0], t[1]};
  return mesh;
}

Result<void> check_simplified(const std::vector<Pslg>& outlines) {
  for (const Pslg& outline : outlines) {
    if (auto ok = check_pslg(outline); !ok)
      return bug("after simplification: " + ok.error().message);
  }
  if (outlines.size() == 1) return {};
  if (auto ok = check_shared_borders(outlines, outlines); !ok)
    return bug("after simplification: " + ok.error().message);
  return {};
}

// Returns for each material the largest two-sided Hausdorff distance, in mm, between one of its
// borders in `contours` and the border of the same index in `other`.
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

// The moved_area_mm2() of all borders.
double moved_mm2(const SliceBorders& contours, const SliceBorders& other, const Lattice& lattice,
                 double beyond_mm) {
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

// Returns the borders with the points at which refinement split their edges. Preconditions:
// `outlines` are material_outlines(borders), the materials' outlines before refinement; `stored`
// are the same outlines with the vertices that refinement inserted on their edges; `outlines` and
// `stored` have the same rings in the same order, and each ring has the same first vertex in both.
// (If the first vertices differ, check_shared_borders() of formats/mesh/shared_borders.h
// fails.) O(n log n).
LabelBorders refined_borders(const LabelBorders& borders, std::span<const Pslg> outlines,
                             std::span<const Pslg> stored) {
  // An outline's edge, and the edges that it became.
  struct Divided {
    std::pair<LatticePoint, LatticePoint> ends;
    const Ring* ring;
    std::size_t first, edges;
    LatticePoint point(std::size_t i) const { return (*ring)[(first + i) % ring->size()]; }
  };
  std::vector<Divided> divided;
  for (std::size_t k = 0; k < outlines.size(); ++k) {
    for (std::size_t r = 0; r < outlines[k].rings.size(); ++r) {
      const Ring &ring = outlines[k].rings[r], &fine = stored[k].rings[r];
      std::size_t at = 0;
      for (std::size_t i = 0; i < ring.size(); ++i) {
        const LatticePoint to = ring[(i + 1) % ring.size()];
        const std::size_t first = at++;
        while (at < fine.size() && (i + 1 == ring.size() || fine[at] != to))
          ++at;
        divided.push_back({{ring[i], to}, &fine, first, at - first});
      }
    }
  }
  std::sort(divided.begin(), divided.end(),
            [](const Divided& a, const Divided& b) { return a.ends < b.ends; });
  LabelBorders out = borders;
  for (BorderChain& chain : out.chains) {
    const std::vector<LatticePoint> coarse = std::exchange(chain.points, {});
    const std::size_t edges = coarse.size() - (chain.is_closed ? 0 : 1);
    // The outline of the material on the left has the edge; if there is none, the outline of the
    // material on the right has its reverse.
    const bool is_forward = chain.left != kNoMaterial;
    for (std::size_t i = 0; i < edges; ++i) {
      std::pair ends{coarse[i], coarse[(i + 1) % coarse.size()]};
      if (!is_forward) std::swap(ends.first, ends.second);
      const auto found =
          std::lower_bound(divided.begin(), divided.end(), ends,
                           [](const Divided& a, const auto& b) { return a.ends < b; });
      for (std::size_t j = 0; j < found->edges; ++j)
        chain.points.push_back(found->point(is_forward ? j : found->edges - j));
    }
    if (!chain.is_closed) chain.points.push_back(coarse.back());
  }
  return out;
}

// Sets MeshedMaterial::outline and simplification_error_mm of every material and
// SliceChanges::moved_mm2, and proves the refined meshes.
Result<void> check_refined(const SliceBorders& contours, const SliceBorders& simple,
                           const std::vector<Refined>& refined, const Lattice& lattice,
                           const SimplificationOptions& simplification, double half_pixel_mm,
                           MeshedSlice& slice) {
  std::vector<MeshedMaterial>& out = slice.materials;
  const auto failed = [](const std::string& why) { return bug("after refinement: " + why); };
  const bool keeps_area = simplification.method == SimplificationMethod::kArea;
  const bool are_shared = simple.shared.has_value();
  std::vector<Pslg> stored;
  for (std::size_t k = 0; (keeps_area || are_shared) && k < refined.size(); ++k)
    stored.push_back(refined_rings(refined[k], simple.outlines[k]));
  for (std::size_t k = 0; k < refined.size(); ++k) {
    auto outline = ProvedOutline::of(are_shared ? stored[k] : boundary_rings(refined[k].mesh));
    if (!outline) return failed(outline.error().message);
    if (auto ok = check_delaunay_mesh(refined[k].mesh, *outline); !ok)
      return failed(ok.error().message);
    out[k].outline = std::move(*outline);
  }
  SliceBorders with_steiner_points;
  if (are_shared) {
    if (auto ok = check_shared_borders(simple.outlines, stored); !ok)
      return failed(ok.error().message);
    if (keeps_area)
      with_steiner_points.shared = refined_borders(*simple.shared, simple.outlines, stored);
  }
  with_steiner_points.outlines = std::move(stored);
  // If areas are kept, the points of refinement move the outline on purpose and therefore count.
  const SliceBorders& outlines = keeps_area ? with_steiner_points : simple;
  const std::vector<double> errors_mm = distances_mm(contours, outlines, lattice);
  if (*std::max_element(errors_mm.begin(), errors_mm.end()) > half_pixel_mm)
    slice.changes.moved_mm2 = moved_mm2(contours, outlines, lattice, half_pixel_mm);
  for (std::size_t k = 0; k < out.size(); ++k) {
    out[k].simplification_error_mm = errors_mm[k];
    if (keeps_area && simplification.tolerance_mm > 0 && errors_mm[k] > simplification.tolerance_mm)
      return failed("the outline is beyond the tolerance");
  }
  return {};
}

SliceBorders simplified(const SliceBorders& contours, const Lattice& lattice,
                        const SimplificationOptions& options) {
  if (!contours.shared) return {{simplify(contours.outlines[0], lattice, options)}, {}};
  LabelBorders shared = simplify(*contours.shared, lattice, options);
  std::vector<Pslg> outlines = material_outlines(shared);
  return {std::move(outlines), std::move(shared)};
}

// Makes the proved meshes of the materials from their contours.
Result<void> mesh_materials(SliceBorders contours, const Lattice& lattice,
                            const SimplificationOptions& simplification,
                            const RefinementOptions& refinement, double half_pixel_mm,
                            Stopwatch& watch, MeshedSlice& slice) {
  std::vector<MeshedMaterial>& out = slice.materials;
  StageTimes& times = slice.times;
  SliceBorders simple = simplified(contours, lattice, simplification);
  times["simplify"] = watch.lap_ms();
  if (auto ok = check_simplified(simple.outlines); !ok) return ok;
  times["check"] += watch.lap_ms();

  auto cdts = triangulate_regions(simple.outlines);
  if (!cdts) return cdts.error();
  times["triangulate"] = watch.lap_ms();
  std::vector<Refined> refined = refine_regions(*cdts, lattice, refinement);
  for (Refined& region : refined)
    sort_by_position(region);
  times["refine"] = watch.lap_ms();

  if (auto ok =
          check_refined(contours, simple, refined, lattice, simplification, half_pixel_mm, slice);
      !ok)
    return ok;
  for (std::size_t k = 0; k < out.size(); ++k) {
    out[k].contours = std::move(contours.outlines[k]);
    out[k].pslg = std::move(simple.outlines[k]);
    out[k].cdt = stored_cdt(std::move((*cdts)[k].mesh));
    out[k].refined = std::move(refined[k]);
  }
  times["check"] += watch.lap_ms();
  return {};
}

// The grid of the slice's cropped pixels.
PixelGrid pixel_grid(const SlicePlane& plane, const MeshOptions& options) {
  const Crop crop = options.crop.value_or(Crop{});
  return {plane.spacing_u_mm, plane.spacing_v_mm, crop.x0, crop.y0, options.lattice};
}

// The bounds of refinement in this slice; `hu` may be null.
RefinementOptions refinement_of_slice(const SlicePlane& plane, const MeshOptions& options,
                                      const Image* hu) {
  RefinementOptions out = options.refinement;
  if (options.max_area_px2)
    out.max_area_mm2 = *options.max_area_px2 * plane.spacing_u_mm * plane.spacing_v_mm;
  out.keep_area = options.simplification.method == SimplificationMethod::kArea;
  out.max_distance_steps =
      std::min(kMaxDistanceFromOutline_steps,
               left_for_refinement_steps(options.lattice, options.simplification));
  if (hu != nullptr && options.grade_hu > 0) {
    const auto graded =
        std::make_shared<GradedArea>(*hu, pixel_grid(plane, options), options.grade_hu);
    out.area_mm2_at = [graded](LatticePoint p) { return graded->mm2_at(p); };
    out.min_area_mm2 = graded->min_mm2();
  }
  return out;
}

void measure(const Lattice& lattice, double min_angle_deg, MeshedMaterial& out) {
  out.quality = measure_quality(out.refined, lattice, min_angle_deg);
  out.area_mm2 = 0.5 * static_cast<double>(doubled_area(out.refined.mesh)) * lattice.step_mm() *
                 lattice.step_mm();
  out.holes = static_cast<int>(std::count_if(out.pslg.rings.begin(), out.pslg.rings.end(),
                                             [](const Ring& r) { return doubled_area(r) < 0; }));
}

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

// Traces the contours of all materials of a slice. If there are several materials, the function
// first merges small components of pixels.several into their neighbours. A material that vanishes
// because of this is removed from `materials`, which keeps at least one entry. Adds the areas of
// the components to `change`; one that becomes another material counts as dropped and filled.
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

}  // namespace

Result<SliceImages> read_slice(const SliceStack& stack, int slice, const MeshOptions& options) {
  auto pixels = read_cropped(stack, slice, options);
  if (!pixels) return pixels.error();
  SliceImages out{std::move(*pixels), {}};
  if (options.hu == nullptr) return out;
  if (const auto ok = read_cropped(*options.hu, slice, options.crop).into(out.ct); !ok)
    return ok.error();
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

GradedArea::GradedArea(const Image& hu, const PixelGrid& grid, double hu_per_edge)
    : grid_(grid),
      width_(hu.width),
      height_(hu.height),
      min_mm2_(kMinArea_px2 * grid.spacing_u_mm * grid.spacing_v_mm),
      edge_mm_(hu.values.size()) {
  const double u = grid.spacing_u_mm, v = grid.spacing_v_mm;
  const auto value = [&hu](int x, int y) {
    return static_cast<double>(
        hu.at(std::clamp(x, 0, hu.width - 1), std::clamp(y, 0, hu.height - 1)));
  };
  const auto edge = [&](int x, int y) -> float& {
    return edge_mm_[static_cast<std::size_t>(y) * width_ + x];
  };
  const double min_edge = std::sqrt(min_mm2_ / kAreaOfEdge2);
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      double du = 0, dv = 0;
      for (const int k : {-1, 0, 1}) {
        const double weight = k == 0 ? 2 : 1;
        du += weight * (value(x + 1, y + k) - value(x - 1, y + k));
        dv += weight * (value(x + k, y + 1) - value(x + k, y - 1));
      }
      const double hu_per_mm = std::hypot(du / u, dv / v) / 8;
      edge(x, y) =
          static_cast<float>(std::clamp(hu_per_edge / std::max(hu_per_mm, 1e-9), min_edge, 1e6));
    }
  }
  // In two sweeps over the image, each pixel's edge length is limited according to four of its
  // neighbours.
  const auto limit = [&](int x, int y, int dx, int dy) {
    if (x + dx < 0 || x + dx >= width_ || y + dy < 0 || y + dy >= height_) return;
    const auto max_edge =
        static_cast<float>(edge(x + dx, y + dy) + kGrowth * std::hypot(dx * u, dy * v));
    edge(x, y) = std::min(edge(x, y), max_edge);
  };
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x)
      limit(x, y, -1, 0), limit(x, y, 0, -1), limit(x, y, -1, -1), limit(x, y, 1, -1);
    for (int x = width_ - 1; x >= 0; --x)
      limit(x, y, 1, 0);
  }
  for (int y = height_ - 1; y >= 0; --y) {
    for (int x = width_ - 1; x >= 0; --x)
      limit(x, y, 1, 0), limit(x, y, 0, 1), limit(x, y, 1, 1), limit(x, y, -1, 1);
    for (int x = 0; x < width_; ++x)
      limit(x, y, -1, 0);
  }
}

double GradedArea::mm2_at(LatticePoint p) const {
  const auto index = [&](std::int32_t c, double spacing_mm, int offset, int count) {
    const double i = std::rint(grid_.lattice.to_mm(c) / spacing_mm) - offset;
    return static_cast<std::size_t>(std::clamp(i, 0.0, count - 1.0));
  };
  const double edge = edge_mm_[index(p.y, grid_.spacing_v_mm, grid_.offset_y, height_) * width_ +
                               index(p.x, grid_.spacing_u_mm, grid_.offset_x, width_)];
  return std::max(min_mm2_, kAreaOfEdge2 * edge * edge);
}

Result<void> check_lattice(const SliceStack& stack, int slice, const Lattice& lattice) {
  const SlicePlane& plane = stack.plane(slice);
  const auto refused = [&](const std::string& reason) {
    return trocar::refused(stack.name(slice) + ": " + reason);
  };
  const double smallest = std::min(plane.spacing_u_mm, plane.spacing_v_mm);
  if (smallest < kMinStepsPerPixel * lattice.step_mm()) {
    return refused("pixels of " + std::to_string(smallest) + " mm are narrower than " +
                   std::to_string(kMinStepsPerPixel) +
                   " lattice steps; use a finer lattice (--lattice-bits)");
  }
  // Outlines reach half a pixel beyond the outermost centres, and the encoder's box as far again.
  const double extent =
      std::max((stack.width() + 1) * plane.spacing_u_mm, (stack.height() + 1) * plane.spacing_v_mm);
  const double steps = extent / lattice.step_mm(), most = static_cast<double>(kMaxAssetSpan);
  if (steps > most) {
    const double bits = std::floor(std::log2(most / extent));
    return refused("a slice of " + text_of(extent, 5) + " mm is " + text_of(std::ceil(steps), 9) +
                   " lattice steps wide, and an asset holds " + text_of(most) + "; " +
                   (bits >= kMinLatticeBits
                        ? "--lattice-bits " + text_of(bits) + " is the finest lattice that holds it"
                        : "check the pixel size"));
  }
  return {};
}

double MeshedSlice::area_mm2() const {
  double sum = 0;
  for (const MeshedMaterial& material : materials)
    sum += material.area_mm2;
  return sum;
}

Result<MeshedSlice> mesh_slice(const SliceStack& stack, int slice, const MeshOptions& options) {
  const SlicePlane& plane = stack.plane(slice);
  const auto fail = [&](const Error& e) { return e.after(stack.name(slice) + ": "); };
  if (auto ok = check_lattice(stack, slice, options.lattice); !ok) return ok.error();

  MeshedSlice out;
  Stopwatch watch;
  auto images = read_slice(stack, slice, options);
  if (!images) return images.error();
  out.times["read"] = watch.lap_ms();
  out.not_numbers =
      std::visit([](const auto& image) { return image.not_numbers; }, images->pixels) +
      (images->ct ? images->ct->not_numbers : 0);
  auto pixels = segment_slice(stack, slice, options, std::move(*images), out);
  if (!pixels) return fail(pixels.error());
  out.times["segment"] = watch.lap_ms();
  SliceBorders contours =
      slice_contours(stack, slice, options, *pixels, out.materials, out.changes.small);
  out.times["contour"] = watch.lap_ms();

  const Image* const hu = pixels->hu();
  const RefinementOptions refinement = refinement_of_slice(plane, options, hu);
  out.max_area_bound_mm2 = refinement.max_area_mm2;
  const double half_pixel_mm = 0.5 * std::min(plane.spacing_u_mm, plane.spacing_v_mm);
  const auto meshed = mesh_materials(std::move(contours), options.lattice, options.simplification,
                                     refinement, half_pixel_mm, watch, out);
  if (!meshed) return fail(meshed.error());
  for (MeshedMaterial& material : out.materials)
    measure(options.lattice, refinement.min_angle_deg, material);
  out.times["check"] += watch.lap_ms();
  if (hu != nullptr && options.hu_field) {
    for (MeshedMaterial& material : out.materials)
      material.hu = fit_hu_field(material.refined.mesh, *hu, pixel_grid(plane, options));
  }
  if (options.hu_volume) out.hu = pixels->take_hu();
  out.times["hu"] = watch.lap_ms();
  return out;
}

Pslg contours_of(const SliceStack& stack, int slice, const MeshOptions& options, const Field& field,
                 AreaChange* change) {
  const PixelGrid grid = pixel_grid(stack.plane(slice), options);
  if (field.is_mask && options.contour == ContourKind::kSubpixel)
    return smooth_outline(field, grid, options.min_region_mm2, change);
  return drop_small_rings(contours(field, grid, options.contour), options.min_region_mm2,
                          options.lattice, change);
}

}  // namespace trocar::pipeline
