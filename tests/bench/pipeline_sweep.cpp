// SPDX-License-Identifier: GPL-3.0-or-later
// pipeline_sweep < PLAN.json > ROWS.json: speed and error of the pipeline. The plan (made by
// scripts/lib/report/sections/pipeline.py) names scans, points of the parameter space and peers;
// the result has a row for each scan and point. Exit codes as for the programs.
//
// PLAN: {"repetitions": 5,
//        "scans": [{"name", "slices": [..], "noise_hu"} (phantom)
//                  | {"name", "path", "first", "stride"}],
//        "points": [{"id", "contour", "tolerance_mm", "min_angle_deg", "max_area_mm2",
//                    "lattice_bits"}],
//        "simplifiers": {"tolerances_px": [..]}, "discs": {"radii_px": [..], "blur_sigma_px": [..],
//        "offsets"}, "path": {"png", "dicom", "spacing_mm", "grey_threshold"}}   (the last three
//        are optional)
#include <algorithm>
#include <iostream>

#include "formats/asset/asset.h"
#include "pipeline/scan/mesh_slice.h"
#include "tests/bench/peers.h"
#include "tests/bench/sweep_main.h"

namespace {

using namespace trocar;
using namespace trocar::pipeline;
using namespace trocar::pipeline::bench;
using nlohmann::json;

Result<MeshOptions> mesh_options(const json& point, double min_region_mm2) {
  MeshOptions out;
  const auto contour = point.at("contour").get<std::string>();
  if (contour != "subpixel" && contour != "pixel")
    return usage("contour: subpixel or pixel, not " + contour);
  out.contour = contour == "pixel" ? ContourKind::kPixel : ContourKind::kSubpixel;
  out.segmentation = Threshold{kIso_HU};
  out.simplification.tolerance_mm = point.at("tolerance_mm");
  const auto simplify = point.value("simplify", std::string("area"));
  if (simplify != "area" && simplify != "dp") return usage("simplify: area or dp, not " + simplify);
  if (simplify == "dp") out.simplification.method = SimplificationMethod::kDouglasPeucker;
  out.refinement.min_angle_deg = point.at("min_angle_deg");
  out.refinement.max_area_mm2 = point.at("max_area_mm2");
  out.lattice.bits = point.at("lattice_bits");
  out.min_region_mm2 = min_region_mm2;
  if (out.lattice.bits < kMinLatticeBits || out.lattice.bits > kMaxLatticeBits)
    return usage("lattice_bits out of range");
  return out;
}

constexpr const char* kStages[] = {"segment", "contour", "simplify", "triangulate",
                                   "refine",  "check",   "hu"};

// Returns, for each stage, the mean over the slices of the median over the repetitions. All
// slices are encoded in one call, which is long enough to be interrupted: its time is CPU time.
json stage_times(const std::vector<std::vector<StageTimes>>& by_slice, double encode_ms_per_slice) {
  json out;
  double total = encode_ms_per_slice;
  for (const std::string stage : kStages) {
    double sum = 0;
    for (const auto& repetitions : by_slice) {
      std::vector<double> times;
      times.reserve(repetitions.size());
      for (const StageTimes& t : repetitions)
        times.push_back(t.at(stage));
      std::nth_element(times.begin(), times.begin() + times.size() / 2, times.end());
      sum += times[times.size() / 2];
    }
    const double mean = sum / static_cast<double>(by_slice.size());
    out[stage + "_ms_per_slice"] = mean;
    total += mean;
  }
  out["encode_ms_per_slice"] = encode_ms_per_slice;
  out["total_ms_per_slice"] = total;
  return out;
}

// Sizes of the meshes, summed over the slices.
struct Counts {
  std::size_t rings = 0, contour_vertices = 0, pslg_vertices = 0, vertices = 0;
  std::uint32_t below = 0, below_at_small = 0, below_unexplained = 0;
  double min_angle_deg = 180, simplification_error_mm = 0;
  bool out_of_vertices = false;

  void add(const MeshedMaterial& m) {
    rings += m.contours.rings.size();
    for (const Ring& ring : m.contours.rings)
      contour_vertices += ring.size();
    for (const Ring& ring : m.pslg.rings)
      pslg_vertices += ring.size();
    vertices += m.refined.mesh.vertices.size();
    below += m.quality.below_min_angle;
    below_at_small += m.quality.below_at_small_input_angle;
    below_unexplained += m.quality.below_unexplained;
    if (!m.refined.mesh.triangles.empty())
      min_angle_deg = std::min(min_angle_deg, m.quality.min_angle_deg);
    simplification_error_mm = std::max(simplification_error_mm, m.simplification_error_mm);
    out_of_vertices = out_of_vertices || m.refined.outcome == RefinementOutcome::kVertexBudget;
  }

  void put(json& row) const {
    row["rings"] = rings;
    row["contour_vertices"] = contour_vertices;
    row["pslg_vertices"] = pslg_vertices;
    row["vertices"] = vertices;
    row["smallest_angle_deg"] = min_angle_deg;
    row["triangles_below_min_angle"] = below;
    row["triangles_below_min_angle_at_small_input_angle"] = below_at_small;
    row["triangles_below_min_angle_unexplained"] = below_unexplained;
    row["simplification_error_mm"] = simplification_error_mm;
    row["out_of_vertices"] = out_of_vertices;
  }
};

void put_errors(const ErrorSamples& samples, json& row) {
  const ErrorSummary e = summarise(samples);
  row["hausdorff_mm"] = e.hausdorff_mm;
  row["outline_to_truth_max_mm"] = samples.outline_to_truth_max_mm;
  row["truth_to_outline_max_mm"] = samples.truth_to_outline_max_mm;
  row["mean_distance_mm"] = e.mean_mm;
  row["p99_distance_mm"] = e.p99_mm;
  row["area_error_percent"] = 100 * e.area_error;
  row["worst_slice_area_error_percent"] = 100 * samples.worst_area_error;
  row["unmatched_slices"] = samples.unmatched;
}

// One scan at one point. If the point does not suit the scan (pixels too fine for the lattice), the
// row has the reason in "refused".
Result<json> sweep_row(const SweepScan& scan, const std::string& name, const json& point,
                       int repetitions) {
  const auto options = mesh_options(point, scan.min_region_mm2);
  if (!options) return options.error();
  json row = point;
  row["point"] = point.at("id");
  row["id"] = name + "/" + point.at("id").get<std::string>();
  row["scan"] = name;
  row["slices"] = scan.stack.size();
  row["pixel_mm"] = scan.pixel_mm;
  row["min_region_mm2"] = scan.min_region_mm2;

  Asset asset;
  asset.lattice = options->lattice;
  asset.generator = "pipeline_sweep";
  std::vector<std::vector<StageTimes>> times(scan.truths.size());
  ErrorSamples errors;
  Counts counts;
  for (int k = 0; k < scan.stack.size(); ++k) {
    for (int i = 0; i < repetitions; ++i) {
      auto meshed = mesh_slice(scan.stack, k, *options);
      if (!meshed && meshed.error().code == ExitCode::kRefused) {
        row["refused"] = meshed.error().message;
        return row;
      }
      if (!meshed) return meshed.error();
      times[static_cast<std::size_t>(k)].push_back(meshed->times);
      if (i + 1 < repetitions) continue;
      MeshedMaterial& only = meshed->materials[0];
      // Sampled eight times a pixel.
      add_errors(as_section(only.outline.pslg(), options->lattice), scan.truths[k],
                 scan.pixel_mm / 8, errors);
      counts.add(only);
      const SlicePlane& plane = scan.stack.plane(k);
      asset.slices.push_back({k, plane.z_mm, plane.T_lps_plane, only.outline.pslg(),
                              std::move(only.refined.mesh), "{}", 0,
                              only.hu ? std::move(only.hu->values) : std::vector<float>()});
    }
  }
  Result<std::vector<std::uint8_t>> glb = bug("not encoded");
  AssetSizes sizes;
  const double encode_ms = median_cpu_ms(repetitions, [&] { glb = encode_asset(asset, &sizes); });
  if (!glb) return glb.error();

  put_errors(errors, row);
  counts.put(row);
  row["triangles"] = sizes.triangles;
  row["asset_bytes"] = glb->size();
  row["triangle_bytes"] = sizes.triangle_bytes;
  row["outline_bytes"] = sizes.outline_bytes;
  row["json_bytes"] = sizes.json_bytes;
  row["bytes_per_triangle"] =
      static_cast<double>(glb->size()) / std::max(1.0, static_cast<double>(sizes.triangles));
  row.update(stage_times(times, encode_ms / scan.stack.size()));
  return row;
}

Result<json> run(const json& plan) {
  const int repetitions = plan.at("repetitions");
  if (repetitions < 1) return usage("repetitions must be >= 1");
  json out = {
      {"repetitions", repetitions}, {"rows", json::array()}, {"simplifiers", json::array()}};
  PhantomTruths truths;
  for (const json& wanted : plan.at("scans")) {
    const auto name = wanted.at("name").get<std::string>();
    std::cerr << "pipeline_sweep: " << name << '\n';
    auto scan =
        wanted.contains("path")
            ? file_scan(wanted["path"].get<std::string>(), wanted.at("first"), wanted.at("stride"))
            : phantom_scan(wanted.at("slices"), wanted.at("noise_hu"), truths);
    if (!scan) return scan.error();
    for (const json& point : plan.at("points")) {
      auto row = sweep_row(*scan, name, point, repetitions);
      if (!row) return row.error();
      out["rows"].push_back(std::move(*row));
    }
    if (!plan.contains("simplifiers")) continue;
    for (json& row : simplifier_rows(*scan, plan["simplifiers"].at("tolerances_px"), repetitions)) {
      row["scan"] = name;
      row["id"] = name + "/" + row["id"].get<std::string>();
      out["simplifiers"].push_back(std::move(row));
    }
  }
  if (plan.contains("discs")) {
    out["discs"] = json::array();
    for (const double sigma_px : plan["discs"].at("blur_sigma_px"))
      for (json& row :
           disc_rows(plan["discs"].at("radii_px"), sigma_px, plan["discs"].at("offsets")))
        out["discs"].push_back(std::move(row));
  }

  if (plan.contains("path")) {
    const json& p = plan["path"];
    auto row = path_row(p.at("png").get<std::string>(), p.at("dicom").get<std::string>(),
                        p.at("spacing_mm"), p.at("grey_threshold"), repetitions);
    if (!row) return row.error();
    out["path"] = std::move(*row);
  }
  return out;
}

}  // namespace

int main() {
  return trocar::test::sweep_main("pipeline_sweep", run);
}
