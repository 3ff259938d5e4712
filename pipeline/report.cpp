// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/report.h"

#include <sys/resource.h>

#include <algorithm>
#include <cstdio>
#include <set>

#include "pipeline/number_ranges.h"

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

void append(json list, json& out) {
  for (json& one : list)
    out.push_back(std::move(one));
}

void append_mesh(const SliceMesh& mesh, const Lattice& lattice, json& out) {
  const auto first = static_cast<std::uint32_t>(out["vertices_mm"].size());
  append(points_json(mesh.vertices, lattice), out["vertices_mm"]);
  for (const Triangle& t : mesh.triangles)
    out["triangles"].push_back({t[0] + first, t[1] + first, t[2] + first});
}

// One sentence, and where it applies.
struct Said {
  std::string sentence;
  std::set<int> slices;
  std::vector<std::string> places;
  double low = 0, high = 0;  // what # stands for
};

// All that is said under one code.
struct Kind {
  std::string code;
  std::vector<Said> said;
};

Said& said_of(std::vector<Kind>& kinds, const std::string& code, const std::string& sentence) {
  auto kind = std::find_if(kinds.begin(), kinds.end(),
                           [&code](const Kind& other) { return other.code == code; });
  if (kind == kinds.end()) kind = kinds.insert(kind, {code, {}});
  auto said = std::find_if(kind->said.begin(), kind->said.end(),
                           [&sentence](const Said& other) { return other.sentence == sentence; });
  if (said == kind->said.end()) said = kind->said.insert(said, {sentence, {}, {}});
  return *said;
}

// The first three, and the number of the others.
std::string first_of(const std::vector<std::string>& texts, const char* separator) {
  constexpr std::size_t kMost = 3;
  std::string out;
  for (std::size_t i = 0; i < std::min(texts.size(), kMost); ++i)
    out.append(i == 0 ? "" : separator).append(texts[i]);
  if (texts.size() > kMost) out += " and " + std::to_string(texts.size() - kMost) + " more";
  return out;
}

std::string where(const std::set<int>& slices, const std::vector<std::string>& places) {
  return slices.empty() ? first_of(places, ", ") : named_ranges("slice", slices);
}

std::string sentence(const Said& said) {
  const std::size_t at = said.slices.empty() ? std::string::npos : said.sentence.find('#');
  if (at == std::string::npos) return said.sentence;
  char value[64];
  if (said.low == said.high) {
    std::snprintf(value, sizeof value, "%.6g", said.low);
  } else {
    std::snprintf(value, sizeof value, "%.6g to %.6g", said.low, said.high);
  }
  return said.sentence.substr(0, at) + value + said.sentence.substr(at + 1);
}

json entry(const Kind& kind) {
  Said all;
  std::vector<std::string> sentences;
  for (const Said& said : kind.said) {
    all.slices.insert(said.slices.begin(), said.slices.end());
    all.places.insert(all.places.end(), said.places.begin(), said.places.end());
    sentences.push_back(sentence(said));
    if (kind.said.size() > 1) sentences.back() += " (" + where(said.slices, said.places) + ")";
  }
  json out = {{"code", kind.code},
              {"where", where(all.slices, all.places)},
              {"sentence", first_of(sentences, "; ")}};
  if (!all.slices.empty()) out["slices"] = all.slices;
  if (!all.places.empty()) out["places"] = all.places;
  return out;
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

json stage_times(const StageTimes& t) {
  return {{"read", t.read_ms},
          {"segment", t.segment_ms},
          {"contour", t.contour_ms},
          {"simplify", t.simplify_ms},
          {"triangulate", t.triangulate_ms},
          {"refine", t.refine_ms},
          {"check", t.check_ms},
          {"hu", t.hu_ms}};
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
    append(rings_json(material.contours, lattice), out["contours_mm"]);
    append(rings_json(material.pslg, lattice), out["pslg_mm"]);
    append_mesh(material.cdt, lattice, out["cdt"]);
    append_mesh(material.refined.mesh, lattice, out["refined"]);
  }
  return out;
}

json warnings_json(const std::vector<Warning>& of_scan,
                   const std::vector<SliceWarning>& of_slices) {
  std::vector<Kind> kinds;
  for (const Warning& w : of_scan)
    said_of(kinds, w.code, w.sentence).places.push_back(w.where);
  for (const SliceWarning& w : of_slices) {
    Said& said = said_of(kinds, w.code, w.sentence);
    said.low = said.slices.empty() ? w.value : std::min(said.low, w.value);
    said.high = said.slices.empty() ? w.value : std::max(said.high, w.value);
    said.slices.insert(w.slice);
  }
  json out = json::array();
  for (const Kind& kind : kinds)
    out.push_back(entry(kind));
  for (const Warning& w : of_scan) {
    if (w.shared.empty()) continue;
    for (json& warning : out)
      if (warning["code"] == w.code) warning["shared"] = w.shared;
  }
  return out;
}

std::uint64_t peak_rss_bytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
}

}  // namespace trocar::pipeline
