// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/surface/display_surface.h"

#include <cstdio>

#include "formats/base/disjoint_sets.h"
#include "formats/base/json.h"
#include "pipeline/read/parallel_for.h"
#include "pipeline/surface/cgal_verification.h"
#include "pipeline/surface/isosurface.h"

namespace trocar::pipeline {
namespace {

using nlohmann::json;

double mean_side_mm(const SurfaceVolume& volume) {
  const auto [u, v, w] = volume.voxel_mm();
  return std::cbrt(u * v * w);
}

// The voxels to average along each axis so that the isosurface has about `fraction` of its
// triangles; at least two voxels are left along each axis.
std::array<int, 3> coarsening(const SurfaceVolume& volume, double fraction) {
  const double side_mm = mean_side_mm(volume) / std::sqrt(fraction);
  const auto sides = volume.voxel_mm();
  std::array<int, 3> out{};
  for (std::size_t k = 0; k < 3; ++k)
    out.at(k) = std::clamp(static_cast<int>(std::lround(side_mm / sides.at(k))), 1,
                           std::max(1, (volume.size.at(k) - 2) / 2));
  return out;
}

// Decimates to this many triangles, or to more if the surface would intersect itself: collapses
// near an intersection are undone.
Result<TriangleSurface> decimated(Decimation& decimation, std::size_t triangles,
                                  const SurfaceOptions& options, DisplaySurface& out,
                                  Stopwatch& watch) {
  for (std::size_t undone = 1;; undone *= 2) {
    auto surface = decimation.decimated(triangles);
    out.decimate_ms += watch.lap_ms();
    // A decimation that is stopped ends early, with more triangles.
    if (options.stop != nullptr && options.stop->load())
      return unwritable("interrupted; nothing was written");
    const auto bad = self_intersecting_triangles(surface);
    if (!bad) return bug(bad.error().message);
    if (bad->empty()) {
      if (auto ok = check_triangle_surface(surface); !ok) return bug(ok.error().message);
      out.check_ms += watch.lap_ms();
      return surface;
    }
    out.check_ms += watch.lap_ms();
    if (!decimation.undo(*bad, undone)) return refused("--surface: the surface intersects itself");
  }
}

std::size_t count_parts(const TriangleSurface& surface) {
  DisjointSets sets(surface.vertices.size());
  std::size_t parts = sets.size();
  for (const auto& t : surface.triangles) {
    for (std::size_t k = 0; k < 2; ++k)
      if (sets.join(t[k], t[k + 1])) --parts;
  }
  return parts;
}

json percentiles(const SurfaceDistance& d) {
  return {{"p50", d.p50_mm}, {"p99", d.p99_mm}, {"max", d.max_mm}};
}

void warn_of_surface(const DisplaySurface& made, const SurfaceOptions& wanted, json& warnings) {
  if (wanted.at_most &&
      made.surface.triangles.size() > static_cast<std::size_t>(wanted.triangles)) {
    warnings.push_back({{"code", "surface_triangles"},
                        {"where", "--surface"},
                        {"sentence", std::to_string(made.surface.triangles.size()) +
                                         " triangles: with fewer it would intersect itself"}});
  }
  const bool is_far = made.distance.p99_mm > made.bound_mm;
  if (!is_far && made.left_out.p99_mm <= made.bound_mm) return;
  const char* const advice = wanted.at_most ? "; give more --surface-triangles" : "";
  char sentence[250];
  std::snprintf(sentence, sizeof sentence,
                "1 %% of the %s is farther than %.2f mm from the %s (wanted: %.2f mm)%s",
                is_far ? "surface" : "material's bound",
                is_far ? made.distance.p99_mm : made.left_out.p99_mm,
                is_far ? "material's bound" : "surface", made.bound_mm, advice);
  warnings.push_back(
      {{"code", "surface_distance"}, {"where", "--surface"}, {"sentence", sentence}});
}

// Adds the surface of one material to the asset and its warnings to `warnings`. Returns its entry
// of the report.
Result<json> add_surface(const SliceStack& stack, int first, int last,
                         const MaterialOptions& options, const SurfaceOptions& wanted, int material,
                         Asset& asset, json& warnings) {
  Stopwatch watch;
  auto volume = read_surface_volume(stack, first, last, options, asset.materials.size() > 1);
  if (!volume) return volume.error();
  json out = {{"material", material},
              {"dropped",
               {{"specks", volume->dropped.specks},
                {"holes", volume->dropped.holes},
                {"largest_mm3", volume->dropped.largest_mm3}}}};
  if (volume->empty()) {
    const std::string& name = asset.materials[static_cast<std::size_t>(material)].name;
    if (asset.materials.size() == 1)
      return refused(input_name(stack) +
                     ": no component of the material is large enough for --surface");
    warnings.push_back({{"code", "surface_absent"},
                        {"where", name},
                        {"sentence", "no component is large enough for --surface"}});
    return out;
  }
  const double read_ms = watch.lap_ms();
  auto made = make_display_surface(*volume, wanted);
  if (!made) return made.error().after(input_name(stack) + ": ");
  warn_of_surface(*made, wanted, warnings);
  out.update({{"triangles", made->surface.triangles.size()},
              {"vertices", made->surface.vertices.size()},
              {"parts", made->parts},
              {"mesher_triangles", made->mesher_triangles},
              {"averaged_voxels", made->coarsened},
              {"bound_mm", made->bound_mm},
              {"distance_mm", percentiles(made->distance)},
              {"left_out_mm", percentiles(made->left_out)},
              {"ms",
               {{"read", read_ms},
                {"mesh", made->mesher_ms},
                {"decimate", made->decimate_ms},
                {"check", made->check_ms}}}});
  asset.surfaces.push_back({material, std::move(made->surface), made->distance.p99_mm});
  return out;
}

}  // namespace

Result<DisplaySurface> make_display_surface(const SurfaceVolume& volume,
                                            const SurfaceOptions& options) {
  constexpr double kMaxReduction = 32;
  DisplaySurface out;
  Stopwatch watch;
  out.bound_mm = mean_side_mm(volume) / 2;
  auto fine = isosurface(volume);
  if (!fine) return fine.error();
  auto wanted = static_cast<std::size_t>(options.triangles);
  const double fraction =
      kMaxReduction * static_cast<double>(wanted) / static_cast<double>(fine->triangles.size());
  if (options.at_most && fraction < 1) {
    const std::array<int, 3> factor = coarsening(volume, fraction);
    SurfaceVolume averaged = coarser(volume, factor);
    drop_small_components(averaged, kMinSurfaceVoxels, 0);
    auto coarse = isosurface(averaged);
    if (!coarse) return coarse.error();
    if (!coarse->triangles.empty()) {
      out.coarsened = factor;
      fine = std::move(coarse);
    }
  }
  out.mesher_triangles = fine->triangles.size();
  out.mesher_ms = watch.lap_ms();

  Decimation decimation(*fine, options.stop);
  const auto zero = points_on_zero(volume);
  for (;; wanted *= 2) {
    if (const auto ok = decimated(decimation, wanted, options, out, watch).into(out.surface); !ok)
      return ok.error();
    out.distance = distance_from(out.surface, volume);
    out.left_out = distance_to(out.surface, volume, zero);
    out.check_ms += watch.lap_ms();
    if (options.at_most || wanted >= fine->triangles.size() || out.is_within_bound()) break;
  }
  out.parts = count_parts(out.surface);
  return out;
}

Result<json> add_surfaces(const SliceStack& stack, int first, int last,
                          const MaterialOptions& options, const SurfaceOptions& wanted,
                          const std::vector<Segmentation>& materials, Asset& asset,
                          json& warnings) {
  json out = json::array();
  MaterialOptions one_material = options;
  for (std::size_t k = 0; k < materials.size(); ++k) {
    one_material.segmentation = materials[k];
    auto one =
        add_surface(stack, first, last, one_material, wanted, static_cast<int>(k), asset, warnings);
    if (!one) return one.error();
    out.push_back(std::move(*one));
  }
  return out;
}

}  // namespace trocar::pipeline
