// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/scan/mesh_slice.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <variant>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/geometry/mesh_validity.h"
#include "formats/geometry/shared_borders.h"
#include "pipeline/base/number_ranges.h"
#include "pipeline/base/stopwatch.h"
#include "pipeline/scan/graded_area.h"
#include "pipeline/scan/slice_borders.h"
#include "pipeline/scan/slice_pixels.h"
#include "pipeline/triangulation/refined_borders.h"
#include "pipeline/triangulation/refined_rings.h"
#include "pipeline/triangulation/regions.h"
#include "pipeline/triangulation/spatial_sort.h"

namespace trocar::pipeline {
namespace {

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
    slice.changes.moved_mm2 = moved_area_mm2(contours, outlines, lattice, half_pixel_mm);
  for (std::size_t k = 0; k < out.size(); ++k) {
    out[k].simplification_error_mm = errors_mm[k];
    if (keeps_area && simplification.tolerance_mm > 0 && errors_mm[k] > simplification.tolerance_mm)
      return failed("the outline is beyond the tolerance");
  }
  return {};
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

}  // namespace trocar::pipeline
