// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/mesh_slice.h"

#include <algorithm>
#include <chrono>
#include <memory>
#include <utility>

#include "formats/asset/asset.h"
#include "formats/geometry/mesh_validity.h"
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

Result<void> check_lattice(const SliceStack& stack, const SlicePlane& plane,
                           const Lattice& lattice) {
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

// From `out.contours` to `out.refined`, with the outline simplified to the given tolerance.
Result<void> mesh_contours_to(const Lattice& lattice, const SimplificationOptions& simplification,
                              const RefinementOptions& refinement, Stopwatch& watch,
                              MeshedSlice& out) {
  out.pslg = simplify(out.contours, lattice, simplification);
  out.times.simplify_ms += watch.lap_ms();
  if (auto ok = check_pslg(out.pslg); !ok)
    return bug("after simplification: " + ok.error().message);
  out.times.check_ms += watch.lap_ms();

  auto cdt = triangulate(out.pslg);
  if (!cdt) return cdt.error();
  out.times.triangulate_ms += watch.lap_ms();
  out.refined = refine(*cdt, lattice, refinement);
  out.cdt = std::move(cdt->mesh);
  // As in refined meshes, the corner opposite edge 0 comes first.
  for (Triangle& t : out.cdt.triangles)
    t = {t[2], t[0], t[1]};
  out.times.refine_ms += watch.lap_ms();

  // Where areas are kept, the points of refinement move the outline on purpose: they count.
  const bool keeps_area = simplification.method == SimplificationMethod::kArea;
  const Pslg compared = keeps_area ? refined_rings(out.refined, out.pslg) : out.pslg;
  out.simplification_error_mm = hausdorff_mm(out.contours, compared, lattice);
  out.times.check_ms += watch.lap_ms();
  return {};
}

// The same. Where areas are kept, the tolerance applies to the stored outline: if refinement's
// points, rounded to the lattice, exceed it, then the same with as much less as they may add.
Result<void> mesh_contours(const Lattice& lattice, const SimplificationOptions& wanted,
                           const RefinementOptions& refinement, Stopwatch& watch,
                           MeshedSlice& out) {
  const double most_mm = kFarthestFromOutline_steps * lattice.step_mm();
  const bool has_margin =
      wanted.method == SimplificationMethod::kArea && wanted.tolerance_mm > 2 * most_mm;
  if (!has_margin) return mesh_contours_to(lattice, wanted, refinement, watch, out);
  for (const double margin_mm : {0.0, most_mm}) {
    SimplificationOptions closer = wanted;
    closer.tolerance_mm -= margin_mm;
    auto ok = mesh_contours_to(lattice, closer, refinement, watch, out);
    if (!ok || out.simplification_error_mm <= wanted.tolerance_mm) return ok;
  }
  return bug("after refinement: the outline is beyond the tolerance");
}

}  // namespace

Result<Image> read_cropped(const SliceStack& stack, int slice, const std::optional<Crop>& crop) {
  auto image = stack.read(slice);
  if (image && crop) return cropped(std::move(*image), *crop);
  return image;
}

Result<MeshedSlice> mesh_slice(const SliceStack& stack, int slice, const MeshOptions& options) {
  const SlicePlane& plane = stack.plane(slice);
  const auto fail = [&](const Error& e) {
    return Error{e.code, stack.name(slice) + ": " + e.message};
  };
  if (auto ok = check_lattice(stack, plane, options.lattice); !ok) return fail(ok.error());

  MeshedSlice out;
  Stopwatch watch;
  auto image = read_cropped(stack, slice, options.crop);
  if (!image) return image.error();
  out.times.read_ms = watch.lap_ms();

  const bool as_labels = std::holds_alternative<Labels>(options.segmentation);
  if (as_labels || stack.pixel_unit() == PixelUnit::kHounsfield)
    out.values = tally_values(*image, as_labels);

  const bool is_hu = stack.pixel_unit() == PixelUnit::kHounsfield && !as_labels;
  std::optional<Image> hu;  // segmentation changes the image
  if (is_hu && (options.hu_field || options.grade_hu > 0)) hu = *image;

  PixelGrid grid{plane.spacing_u_mm, plane.spacing_v_mm, 0, 0, options.lattice};
  if (options.crop) {
    grid.offset_x = options.crop->x0;
    grid.offset_y = options.crop->y0;
  }
  Field field = segment(std::move(*image), stack.pixel_unit(), options.segmentation);
  out.labels = std::move(field.labels);
  std::optional<double> solid_mean;
  if (options.solid != nullptr)
    solid_mean = options.solid->apply(slice, grid.offset_x, grid.offset_y, field);
  if (stack.pixel_unit() == PixelUnit::kHounsfield &&
      std::holds_alternative<Threshold>(options.segmentation)) {
    out.mean_hu = options.solid != nullptr ? solid_mean : mean_of_material(field);
  }
  out.all_material = std::all_of(field.image.values.begin(), field.image.values.end(),
                                 [iso = field.iso](float value) { return value >= iso; });
  out.times.segment_ms = watch.lap_ms();

  out.contours = drop_small_rings(contours(field, grid, options.contour), options.min_region_mm2,
                                  options.lattice);
  out.times.contour_ms = watch.lap_ms();

  RefinementOptions refinement = options.refinement;
  if (options.max_area_px2)
    refinement.max_area_mm2 = *options.max_area_px2 * plane.spacing_u_mm * plane.spacing_v_mm;
  refinement.keep_area = options.simplification.method == SimplificationMethod::kArea;
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
