// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/mesh_slice.h"

#include <algorithm>
#include <chrono>
#include <memory>
#include <utility>

#include "formats/asset/asset.h"
#include "formats/geometry/mesh_validity.h"
#include "pipeline/contour/label_network.h"
#include "pipeline/graded_area.h"
#include "pipeline/mesh/refined_rings.h"
#include "pipeline/mesh/triangulation.h"

namespace trocar::pipeline {
namespace {

class Stopwatch {
 public:
  double lap_ms() {
    const auto now = std::chrono::steady_clock::now();
    const double ms = std::chrono::duration<double, std::milli>(now - start_).count();
    start_ = now;
    return ms;
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

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

// From `out.contours` to `out.refined`.
Result<void> mesh_contours(const Lattice& lattice, const SimplificationOptions& simplification,
                           const RefinementOptions& refinement, Stopwatch& watch,
                           MeshedSlice& out) {
  out.pslg = simplify(out.contours, lattice, simplification);
  out.times.simplify_ms = watch.lap_ms();
  if (auto ok = check_pslg(out.pslg); !ok)
    return bug("after simplification: " + ok.error().message);
  out.times.check_ms += watch.lap_ms();

  auto cdt = triangulate(out.pslg);
  if (!cdt) return cdt.error();
  out.times.triangulate_ms = watch.lap_ms();
  out.refined = refine(*cdt, lattice, refinement);
  out.cdt = std::move(cdt->mesh);
  // As in refined meshes, the corner opposite edge 0 comes first.
  for (Triangle& t : out.cdt.triangles)
    t = {t[2], t[0], t[1]};
  out.times.refine_ms = watch.lap_ms();

  // Where areas are kept, the points of refinement move the outline on purpose: they count.
  const bool keeps_area = simplification.method == SimplificationMethod::kArea;
  const Pslg compared = keeps_area ? refined_rings(out.refined, out.pslg) : out.pslg;
  out.simplification_error_mm = hausdorff_mm(out.contours, compared, lattice);
  if (keeps_area && simplification.tolerance_mm > 0 &&
      out.simplification_error_mm > simplification.tolerance_mm)
    return bug("after refinement: the outline is beyond the tolerance");
  out.times.check_ms += watch.lap_ms();
  return {};
}

}  // namespace

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

  const bool as_labels = std::holds_alternative<Labels>(options.segmentation);
  if (as_labels || stack.pixel_unit() == PixelUnit::kHounsfield)
    out.values = tally_values(*image, as_labels);

  const bool is_hu = stack.pixel_unit() == PixelUnit::kHounsfield && !as_labels;
  std::optional<Image> hu;  // segmentation changes the image
  if (ct) {
    hu = *ct;
  } else if (is_hu && (options.hu_field || options.grade_hu > 0)) {
    hu = *image;
  }

  const PixelGrid grid = grid_of(plane, options);
  auto [field, solid_mean] = segment_slice(stack, slice, options, std::move(*image));
  out.labels = std::move(field.labels);
  if (stack.pixel_unit() == PixelUnit::kHounsfield &&
      std::holds_alternative<Threshold>(options.segmentation)) {
    out.mean_hu = options.solid != nullptr ? solid_mean : mean_of_material(field);
  }
  if (ct) out.mean_hu = mean_of_material(field, *ct);
  out.all_material = std::all_of(field.image.values.begin(), field.image.values.end(),
                                 [iso = field.iso](float value) { return value >= iso; });
  out.times.segment_ms = watch.lap_ms();

  out.contours = contours_of(stack, slice, options, field);
  out.times.contour_ms = watch.lap_ms();

  RefinementOptions refinement = options.refinement;
  if (options.max_area_px2)
    refinement.max_area_mm2 = *options.max_area_px2 * plane.spacing_u_mm * plane.spacing_v_mm;
  refinement.keep_area = options.simplification.method == SimplificationMethod::kArea;
  refinement.farthest_steps =
      std::min(kFarthestFromOutline_steps,
               left_for_refinement_steps(options.lattice, options.simplification));
  out.max_area_bound_mm2 = refinement.max_area_mm2;
  if (hu && options.grade_hu > 0) {
    const auto graded = std::make_shared<GradedArea>(*hu, grid, options.grade_hu);
    refinement.area_mm2_at = [graded](LatticePoint p) { return graded->mm2_at(p); };
    refinement.least_area_mm2 = graded->least_mm2();
  }
  if (auto ok = mesh_contours(options.lattice, options.simplification, refinement, watch, out); !ok)
    return fail(ok.error());

  out.outline = boundary_rings(out.refined.mesh);
  if (auto ok = check_mesh_against_pslg(out.refined.mesh, out.outline); !ok) {
    return fail(bug("after refinement: " + ok.error().message));
  }
  if (!is_constrained_delaunay(out.refined.mesh))
    return fail(bug("after refinement: not constrained Delaunay"));
  out.quality = measure_quality(out.refined, options.lattice, refinement.min_angle_deg);
  out.area_mm2 = 0.5 * static_cast<double>(doubled_area(out.refined.mesh)) *
                 options.lattice.step_mm() * options.lattice.step_mm();
  out.holes = static_cast<int>(std::count_if(out.pslg.rings.begin(), out.pslg.rings.end(),
                                             [](const Ring& r) { return doubled_area(r) < 0; }));
  out.times.check_ms += watch.lap_ms();
  if (hu && options.hu_field) out.hu = fit_hu_field(out.refined.mesh, *hu, grid);
  out.times.hu_ms = watch.lap_ms();
  return out;
}

}  // namespace trocar::pipeline
