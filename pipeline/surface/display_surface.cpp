// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/surface/display_surface.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "formats/base/disjoint_sets.h"
#include "pipeline/base/stopwatch.h"
#include "pipeline/surface/decimation.h"
#include "pipeline/surface/isosurface.h"
#include "pipeline/verify/surface_proof.h"

namespace trocar::pipeline {
namespace {

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
    auto surface = decimated(decimation, wanted, options, out, watch);
    if (!surface) return surface.error();
    out.surface = std::move(*surface);
    out.distance = distance_from(out.surface, volume);
    out.left_out = distance_to(out.surface, volume, zero);
    out.check_ms += watch.lap_ms();
    if (options.at_most || wanted >= fine->triangles.size() || out.is_within_bound()) break;
  }
  out.parts = count_parts(out.surface);
  return out;
}

}  // namespace trocar::pipeline
