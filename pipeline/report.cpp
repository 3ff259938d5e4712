// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/report.h"

#include <sys/resource.h>

namespace trocar::pipeline {
namespace {

using nlohmann::json;

std::size_t vertex_count(const Pslg& pslg) {
  std::size_t n = 0;
  for (const Ring& ring : pslg.rings)
    n += ring.size();
  return n;
}

json points_json(const std::vector<LatticePoint>& points, const Lattice& lattice) {
  json out = json::array();
  for (const LatticePoint p : points)
    out.push_back({lattice.to_mm(p.x), lattice.to_mm(p.y)});
  return out;
}

json rings_json(const Pslg& pslg, const Lattice& lattice) {
  json out = json::array();
  for (const Ring& ring : pslg.rings)
    out.push_back(points_json(ring, lattice));
  return out;
}

json mesh_json(const SliceMesh& mesh, const Lattice& lattice) {
  return {{"vertices_mm", points_json(mesh.vertices, lattice)}, {"triangles", mesh.triangles}};
}

}  // namespace

json slice_measures(const MeshedSlice& slice) {
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

json slice_report(int index, double z_mm, const MeshedSlice& slice) {
  json out = slice_measures(slice);
  out["index"] = index;
  out["z_mm"] = z_mm;
  out["rings"] = slice.pslg.rings.size();
  out["holes"] = slice.holes;
  out["contour_vertices"] = vertex_count(slice.contours);
  out["pslg_vertices"] = vertex_count(slice.pslg);
  out["vertices"] = slice.refined.mesh.vertices.size();
  out["triangles"] = slice.refined.mesh.triangles.size();
  out["max_area_bound_mm2"] = slice.max_area_bound_mm2;
  const StageTimes& t = slice.times;
  out["ms"] = {
      {"read", t.read_ms},         {"segment", t.segment_ms},         {"contour", t.contour_ms},
      {"simplify", t.simplify_ms}, {"triangulate", t.triangulate_ms}, {"refine", t.refine_ms},
      {"check", t.check_ms}};
  return out;
}

json slice_stages(int index, const SlicePlane& plane, const MeshedSlice& slice,
                  const Lattice& lattice) {
  return {{"slice", index},
          {"spacing_mm", {plane.spacing_u_mm, plane.spacing_v_mm}},
          {"lattice_bits", lattice.bits},
          {"contours_mm", rings_json(slice.contours, lattice)},
          {"pslg_mm", rings_json(slice.pslg, lattice)},
          {"cdt", mesh_json(slice.cdt, lattice)},
          {"refined", mesh_json(slice.refined.mesh, lattice)}};
}

json to_json(const Warning& warning) {
  return {{"code", warning.code}, {"where", warning.where}, {"sentence", warning.sentence}};
}

std::uint64_t peak_rss_bytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
}

}  // namespace trocar::pipeline
