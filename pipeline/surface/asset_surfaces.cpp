// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/surface/asset_surfaces.h"

#include <cstdio>
#include <string>
#include <utility>

#include "formats/base/json_text.h"
#include "pipeline/base/stopwatch.h"
#include "pipeline/surface/surface_volume.h"

namespace trocar::pipeline {
namespace {

using nlohmann::json;

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
