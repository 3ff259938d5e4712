// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/scan/report.h"

#include <sys/resource.h>

#include <algorithm>

namespace trocar::pipeline {
namespace {

using nlohmann::json;

std::size_t vertex_count(const Pslg& pslg) {
  std::size_t n = 0;
  for (const Ring& ring : pslg.rings)
    n += ring.size();
  return n;
}

void append_points(const std::vector<LatticePoint>& points, const Lattice& lattice, json& out) {
  for (const LatticePoint p : points)
    out.push_back({lattice.to_mm(p.x), lattice.to_mm(p.y)});
}

void append_rings(const Pslg& pslg, const Lattice& lattice, json& out) {
  for (const Ring& ring : pslg.rings)
    append_points(ring, lattice, out.emplace_back(json::array()));
}

void append_mesh(const SliceMesh& mesh, const Lattice& lattice, json& out) {
  const auto first = static_cast<std::uint32_t>(out["vertices_mm"].size());
  append_points(mesh.vertices, lattice, out["vertices_mm"]);
  for (const Triangle& t : mesh.triangles)
    out["triangles"].push_back({t[0] + first, t[1] + first, t[2] + first});
}

}  // namespace

json slice_measures(const MeshedMaterial& slice) {
  json out = {
      {"simplification_error_mm", slice.simplification_error_mm},
      {"min_angle_deg", slice.quality.min_angle_deg},
      {"triangles_below_min_angle", slice.quality.below_min_angle},
      {"triangles_below_min_angle_at_small_input_angle", slice.quality.below_at_small_input_angle},
      {"triangles_below_min_angle_unexplained", slice.quality.below_unexplained},
      {"negative_stiffness_edges", slice.quality.negative_stiffness_edges},
      {"max_area_mm2", slice.quality.max_area_mm2},
      {"area_mm2", slice.area_mm2}};
  if (slice.mean_hu) out["mean_hu"] = *slice.mean_hu;
  return out;
}

json changes_report(const SliceChanges& changes) {
  json out = {{"dropped_mm2", changes.small.dropped_mm2},
              {"filled_mm2", changes.small.filled_mm2},
              {"moved_mm2", changes.moved_mm2}};
  if (changes.solid) {
    out["solid_dropped_mm2"] = changes.solid->dropped_mm2;
    out["solid_filled_mm2"] = changes.solid->filled_mm2;
  }
  return out;
}

json slice_report(int index, double z_mm, const MeshedMaterial& slice, double max_area_bound_mm2) {
  json out = slice_measures(slice);
  out["index"] = index;
  out["z_mm"] = z_mm;
  out["rings"] = slice.pslg.rings.size();
  out["holes"] = slice.holes;
  out["contour_vertices"] = vertex_count(slice.contours);
  out["pslg_vertices"] = vertex_count(slice.pslg);
  out["vertices"] = slice.refined.mesh.vertices.size();
  out["triangles"] = slice.refined.mesh.triangles.size();
  out["max_area_bound_mm2"] = max_area_bound_mm2;
  if (slice.hu) {
    out["hu_pixels"] = slice.hu->pixels;
    out["hu_bias"] = slice.hu->bias_hu;
    out["hu_rms"] = slice.hu->rms_hu;
  }
  return out;
}

json slice_stages(int index, const SlicePlane& plane, const MeshedSlice& slice,
                  const Lattice& lattice) {
  const json no_mesh = {{"vertices_mm", json::array()}, {"triangles", json::array()}};
  json out = {{"slice", index},
              {"spacing_mm", {plane.spacing_u_mm, plane.spacing_v_mm}},
              {"lattice_bits", lattice.bits},
              {"contours_mm", json::array()},
              {"pslg_mm", json::array()},
              {"cdt", no_mesh},
              {"refined", no_mesh}};
  for (const MeshedMaterial& material : slice.materials) {
    append_rings(material.contours, lattice, out["contours_mm"]);
    append_rings(material.pslg, lattice, out["pslg_mm"]);
    append_mesh(material.cdt, lattice, out["cdt"]);
    append_mesh(material.refined.mesh, lattice, out["refined"]);
  }
  return out;
}

json asset_report(const AssetSizes& sizes, std::size_t bytes) {
  const auto per_triangle = [&sizes](std::size_t n) {
    return sizes.triangles == 0 ? 0.0
                                : static_cast<double>(n) / static_cast<double>(sizes.triangles);
  };
  return {{"bytes", bytes},
          {"triangles", sizes.triangles},
          {"bytes_per_triangle", per_triangle(bytes)},
          {"triangle_bytes", sizes.triangle_bytes},
          {"triangle_bytes_per_triangle", per_triangle(sizes.triangle_bytes)},
          {"outline_bytes", sizes.outline_bytes},
          {"json_bytes", sizes.json_bytes},
          {"index_bytes", sizes.index_bytes},
          {"hu_bytes", sizes.hu_bytes}};
}

std::uint64_t peak_rss_bytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
}

}  // namespace trocar::pipeline
