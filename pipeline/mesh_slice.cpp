// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/mesh_slice.h"

#include <algorithm>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/geometry/mesh_validity.h"
#include "formats/geometry/shared_borders.h"
#include "pipeline/contour/label_network.h"
#include "pipeline/graded_area.h"
#include "pipeline/mesh/place_order.h"
#include "pipeline/mesh/refined_network.h"
#include "pipeline/mesh/refined_rings.h"
#include "pipeline/mesh/regions.h"
#include "pipeline/mesh/triangulation.h"
#include "pipeline/stopwatch.h"

namespace trocar::pipeline {
namespace {

Image cropped(Image image, const Crop& c) {
  Image out{c.x1 - c.x0 + 1, c.y1 - c.y0 + 1, {}};
  out.values.reserve(static_cast<std::size_t>(out.width) * out.height);
  for (int y = c.y0; y <= c.y1; ++y) {
    const auto row = image.values.begin() + static_cast<std::ptrdiff_t>(y) * image.width;
    out.values.insert(out.values.end(), row + c.x0, row + c.x1 + 1);
  }
  return out;
}

PixelGrid grid_of(const SlicePlane& plane, const MeshOptions& options) {
  PixelGrid grid{plane.spacing_u_mm, plane.spacing_v_mm, 0, 0, options.lattice};
  if (options.crop) {
    grid.offset_x = options.crop->x0;
    grid.offset_y = options.crop->y0;
  }
  return grid;
}

}  // namespace

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
  const double extent =
      std::max(stack.width() * plane.spacing_u_mm, stack.height() * plane.spacing_v_mm);
  if (extent / lattice.step_mm() > static_cast<double>(kMaxAssetExtent)) {
    return refused(
        "an image of " + std::to_string(extent) +
        " mm has more lattice steps than an asset holds; use a coarser lattice (--lattice-bits)");
  }
  return {};
}

namespace {

// Of labels, as one material.
Pslg smooth_outline(const Field& field, const PixelGrid& grid, double min_region_mm2) {
  MaterialImage image{field.image.width, field.image.height, {}, {}};
  image.labels.resize(1);
  image.values.reserve(field.image.values.size());
  for (const float value : field.image.values)
    image.values.push_back(value >= field.iso ? 1 : kNoMaterial);
  merge_small_pieces(image, min_region_mm2 / (grid.spacing_u_mm * grid.spacing_v_mm));
  return std::move(material_outlines(label_network(image, grid)).front());
}

// As in refined meshes, the corner opposite edge 0 comes first.
SliceMesh stored_cdt(SliceMesh mesh) {
  for (Triangle& t : mesh.triangles)
    t = {t[2], t[0], t[1]};
  return mesh;
}

// From `out.contours` to `out.outline`.
Result<void> mesh_contours(const Lattice& lattice, const SimplificationOptions& simplification,
                           const RefinementOptions& refinement, Stopwatch& watch, StageTimes& times,
                           MeshedMaterial& out) {
  out.pslg = simplify(out.contours, lattice, simplification);
  times.simplify_ms = watch.lap_ms();
  if (auto ok = check_pslg(out.pslg); !ok)
    return bug("after simplification: " + ok.error().message);
  times.check_ms += watch.lap_ms();

  auto cdt = triangulate(out.pslg);
  if (!cdt) return cdt.error();
  times.triangulate_ms = watch.lap_ms();
  out.refined = refine(*cdt, lattice, refinement);
  order_by_place(out.refined);
  out.cdt = stored_cdt(std::move(cdt->mesh));
  times.refine_ms = watch.lap_ms();

  // Where areas are kept, the points of refinement move the outline on purpose: they count.
  const bool keeps_area = simplification.method == SimplificationMethod::kArea;
  const Pslg compared = keeps_area ? refined_rings(out.refined, out.pslg) : out.pslg;
  out.simplification_error_mm = hausdorff_mm(out.contours, compared, lattice);
  if (keeps_area && simplification.tolerance_mm > 0 &&
      out.simplification_error_mm > simplification.tolerance_mm)
    return bug("after refinement: the outline is beyond the tolerance");
  auto outline = ProvedOutline::of(boundary_rings(out.refined.mesh));
  if (!outline) return bug("after refinement: " + outline.error().message);
  if (auto ok = check_delaunay_mesh(out.refined.mesh, *outline); !ok)
    return bug("after refinement: " + ok.error().message);
  out.outline = std::move(*outline);
  times.check_ms += watch.lap_ms();
  return {};
}

// By material: the largest distance, either way, between its borders and those of the same index.
std::vector<double> distances_mm(const LabelNetwork& full, const LabelNetwork& other,
                                 const Lattice& lattice) {
  std::vector<double> out(full.materials, 0);
  for (std::size_t c = 0; c < full.chains.size(); ++c) {
    const BorderChain& chain = full.chains[c];
    const double mm =
        hausdorff_mm({{chain.points}}, {{other.chains[c].points}}, lattice, {!chain.is_closed});
    for (const MaterialNumber m : {chain.left, chain.right}) {
      if (m != kNoMaterial) out[m - 1U] = std::max(out[m - 1U], mm);
    }
  }
  return out;
}

// Several materials: from the network of their borders to their outlines, as mesh_contours().
Result<void> mesh_network(const LabelNetwork& network, const Lattice& lattice,
                          const SimplificationOptions& simplification,
                          const RefinementOptions& refinement, Stopwatch& watch, StageTimes& times,
                          std::vector<MeshedMaterial>& out) {
  const LabelNetwork simple = simplify(network, lattice, simplification);
  std::vector<Pslg> contours = material_outlines(network), outlines = material_outlines(simple);
  times.simplify_ms = watch.lap_ms();
  for (const Pslg& outline : outlines) {
    if (auto ok = check_pslg(outline); !ok)
      return bug("after simplification: " + ok.error().message);
  }
  if (auto ok = check_shared_borders(outlines, outlines); !ok)
    return bug("after simplification: " + ok.error().message);
  times.check_ms += watch.lap_ms();

  auto cdts = triangulate_regions(outlines);
  if (!cdts) return cdts.error();
  times.triangulate_ms = watch.lap_ms();
  std::vector<Refined> refined = refine_regions(*cdts, lattice, refinement);
  for (Refined& region : refined)
    order_by_place(region);
  times.refine_ms = watch.lap_ms();

  std::vector<Pslg> stored;
  for (std::size_t k = 0; k < outlines.size(); ++k) {
    stored.push_back(refined_rings(refined[k], outlines[k]));
    auto outline = ProvedOutline::of(stored[k]);
    if (!outline) return bug("after refinement: " + outline.error().message);
    if (auto ok = check_delaunay_mesh(refined[k].mesh, *outline); !ok)
      return bug("after refinement: " + ok.error().message);
    out[k].outline = std::move(*outline);
  }
  if (auto ok = check_shared_borders(outlines, stored); !ok)
    return bug("after refinement: " + ok.error().message);
  const bool keeps_area = simplification.method == SimplificationMethod::kArea;
  const std::vector<double> errors_mm = distances_mm(
      network, keeps_area ? refined_network(simple, outlines, stored) : simple, lattice);
  for (std::size_t k = 0; k < out.size(); ++k) {
    MeshedMaterial& material = out[k];
    material.simplification_error_mm = errors_mm[k];
    if (keeps_area && simplification.tolerance_mm > 0 && errors_mm[k] > simplification.tolerance_mm)
      return bug("after refinement: the outline is beyond the tolerance");
    material.contours = std::move(contours[k]);
    material.pslg = std::move(outlines[k]);
    material.cdt = stored_cdt(std::move((*cdts)[k].mesh));
    material.refined = std::move(refined[k]);
  }
  times.check_ms += watch.lap_ms();
  return {};
}

// Of a label map, with the fillings and omissions of SolidBone in `field`.
Result<FoundMaterials> materials_of_field(const Image& labels, const Labels& wanted, bool is_solid,
                                          const Field& field) {
  auto out = found_materials(labels, wanted);
  if (!out || !is_solid) return out;
  std::vector<MaterialNumber>& values = out->image.values;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (field.image.values[i] < field.iso) {
      values[i] = kNoMaterial;
    } else if (values[i] == kNoMaterial && out->first_labels.size() == 1) {
      values[i] = 1;
    } else if (values[i] == kNoMaterial) {
      return usage("--fill fills one material: join the labels with +, as --labels 20+21");
    }
  }
  return out;
}

// By material.
std::vector<std::optional<double>> means_of(const MaterialImage& image, const Image& of) {
  std::vector<std::pair<double, std::int64_t>> sums(image.labels.size() + 1);
  for (std::size_t i = 0; i < image.values.size(); ++i) {
    auto& [sum, count] = sums[image.values[i]];
    sum += static_cast<double>(of.values[i]);
    ++count;
  }
  std::vector<std::optional<double>> out;
  for (std::size_t m = 1; m < sums.size(); ++m) {
    const auto& [sum, count] = sums[m];
    out.push_back(count == 0 ? std::nullopt : std::optional(sum / static_cast<double>(count)));
  }
  return out;
}

// Leaves the materials that have pixels; `out` is by material.
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

double MeshedSlice::area_mm2() const {
  double sum = 0;
  for (const MeshedMaterial& material : materials)
    sum += material.area_mm2;
  return sum;
}

Result<Image> read_cropped(const SliceStack& stack, int slice, const std::optional<Crop>& crop) {
  auto image = stack.read(slice);
  if (image && crop) return cropped(std::move(*image), *crop);
  return image;
}

Segmented segment_slice(const SliceStack& stack, int slice, const MeshOptions& options,
                        Image image) {
  Segmented out{segment(std::move(image), stack.pixel_unit(), options.segmentation), {}};
  if (options.solid != nullptr) {
    const PixelGrid grid = grid_of(stack.plane(slice), options);
    out.solid_mean = options.solid->apply(slice, grid.offset_x, grid.offset_y, out.field);
  }
  return out;
}

Pslg contours_of(const SliceStack& stack, int slice, const MeshOptions& options,
                 const Field& field) {
  const PixelGrid grid = grid_of(stack.plane(slice), options);
  if (field.is_mask && options.contour == ContourKind::kSubpixel)
    return smooth_outline(field, grid, options.min_region_mm2);
  return drop_small_rings(contours(field, grid, options.contour), options.min_region_mm2,
                          options.lattice);
}

Result<MeshedSlice> mesh_slice(const SliceStack& stack, int slice, const MeshOptions& options) {
  const SlicePlane& plane = stack.plane(slice);
  const auto fail = [&](const Error& e) {
    return Error{e.code, stack.name(slice) + ": " + e.message};
  };
  if (auto ok = check_lattice(stack, slice, options.lattice); !ok) return ok.error();

  MeshedSlice out;
  Stopwatch watch;
  auto image = read_cropped(stack, slice, options.crop);
  if (!image) return image.error();
  std::optional<Image> ct;  // beside a label map
  if (options.hu != nullptr) {
    auto read = read_cropped(*options.hu, slice, options.crop);
    if (!read) return read.error();
    ct = std::move(*read);
  }
  out.times.read_ms = watch.lap_ms();

  const auto* as_labels = std::get_if<Labels>(&options.segmentation);
  if (as_labels != nullptr || stack.pixel_unit() == PixelUnit::kHounsfield)
    out.values = tally_values(*image, as_labels != nullptr);

  const bool is_hu = stack.pixel_unit() == PixelUnit::kHounsfield && as_labels == nullptr;
  const bool needs_hu = is_hu && (options.hu_field || options.grade_hu > 0);
  std::optional<Image> unchanged;  // where segmentation changes the image
  if (needs_hu &&
      (options.solid != nullptr || !std::holds_alternative<Threshold>(options.segmentation)))
    unchanged = *image;
  std::optional<Image> label_image;
  if (as_labels != nullptr && (as_labels->all || are_several(*as_labels))) label_image = *image;

  const PixelGrid grid = grid_of(plane, options);
  auto [field, solid_mean] = segment_slice(stack, slice, options, std::move(*image));
  const Image* hu = nullptr;
  if (ct) {
    hu = &*ct;
  } else if (needs_hu) {
    hu = unchanged ? &*unchanged : &field.image;
  }
  out.labels = std::move(field.labels);
  MaterialImage several;  // if there are
  MeshedMaterial& only = out.materials.emplace_back();
  if (as_labels != nullptr && !as_labels->labels.empty())
    only.first_label = *as_labels->labels.begin();
  if (label_image) {
    auto found = materials_of_field(*label_image, *as_labels, options.solid != nullptr, field);
    if (!found) return fail(found.error());
    if (found->first_labels.size() == 1) only.first_label = found->first_labels[0];
    if (found->first_labels.size() > 1) several = std::move(found->image);
    if (!several.values.empty()) {
      if (options.contour == ContourKind::kPixel)
        return fail(
            usage("--contour pixel leaves gaps between materials: leave it out, or join the "
                  "labels with +, as --labels 20+21"));
      out.materials.resize(found->first_labels.size());
      std::vector<std::optional<double>> means(out.materials.size());
      if (ct) means = means_of(several, *ct);
      for (std::size_t m = 0; m < out.materials.size(); ++m) {
        out.materials[m].first_label = found->first_labels[m];
        out.materials[m].mean_hu = means[m];
      }
    }
  }
  if (several.values.empty()) {
    if (stack.pixel_unit() == PixelUnit::kHounsfield &&
        std::holds_alternative<Threshold>(options.segmentation))
      only.mean_hu = options.solid != nullptr ? solid_mean : mean_of_material(field);
    if (ct) only.mean_hu = mean_of_material(field, *ct);
  }
  out.all_material = std::all_of(field.image.values.begin(), field.image.values.end(),
                                 [iso = field.iso](float value) { return value >= iso; });
  out.times.segment_ms = watch.lap_ms();

  std::optional<LabelNetwork> network;
  if (several.values.empty()) {
    out.materials[0].contours = contours_of(stack, slice, options, field);
  } else {
    merge_small_pieces(several, options.min_region_mm2 / (grid.spacing_u_mm * grid.spacing_v_mm));
    leave_out_empty(several, out.materials);
    network = label_network(several, grid);
    if (out.materials.size() < 2) {
      out.materials.resize(1);
      if (network->materials == 1)
        out.materials[0].contours = std::move(material_outlines(*network).front());
      network.reset();
    }
  }
  out.times.contour_ms = watch.lap_ms();

  RefinementOptions refinement = options.refinement;
  if (options.max_area_px2)
    refinement.max_area_mm2 = *options.max_area_px2 * plane.spacing_u_mm * plane.spacing_v_mm;
  refinement.keep_area = options.simplification.method == SimplificationMethod::kArea;
  refinement.farthest_steps =
      std::min(kFarthestFromOutline_steps,
               left_for_refinement_steps(options.lattice, options.simplification));
  out.max_area_bound_mm2 = refinement.max_area_mm2;
  if (hu != nullptr && options.grade_hu > 0) {
    const auto graded = std::make_shared<GradedArea>(*hu, grid, options.grade_hu);
    refinement.area_mm2_at = [graded](LatticePoint p) { return graded->mm2_at(p); };
    refinement.least_area_mm2 = graded->least_mm2();
  }
  const auto meshed = network ? mesh_network(*network, options.lattice, options.simplification,
                                             refinement, watch, out.times, out.materials)
                              : mesh_contours(options.lattice, options.simplification, refinement,
                                              watch, out.times, out.materials[0]);
  if (!meshed) return fail(meshed.error());

  for (MeshedMaterial& material : out.materials) {
    const SliceMesh& mesh = material.refined.mesh;
    material.quality = measure_quality(material.refined, options.lattice, refinement.min_angle_deg);
    material.area_mm2 = 0.5 * static_cast<double>(doubled_area(mesh)) * options.lattice.step_mm() *
                        options.lattice.step_mm();
    material.holes =
        static_cast<int>(std::count_if(material.pslg.rings.begin(), material.pslg.rings.end(),
                                       [](const Ring& r) { return doubled_area(r) < 0; }));
  }
  out.times.check_ms += watch.lap_ms();
  if (hu != nullptr && options.hu_field) {
    for (MeshedMaterial& material : out.materials)
      material.hu = fit_hu_field(material.refined.mesh, *hu, grid);
  }
  out.times.hu_ms = watch.lap_ms();
  return out;
}

}  // namespace trocar::pipeline
