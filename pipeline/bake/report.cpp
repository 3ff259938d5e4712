// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/bake/report.h"

#include <sys/resource.h>
#include <cstdio>

#include "formats/base/json.h"
#include "pipeline/read/number_ranges.h"

namespace trocar::pipeline {
namespace {

using nlohmann::json;

// Defaults follow pixels whose narrower side is below this width.
constexpr double kSmallPixel_mm = 0.3;

// Skin and muscle have 20 to 80 HU.
constexpr double kSkin_HU = 100;

// A sentence, and the slices or texts to which it applies.
struct Statement {
  std::string sentence;
  std::set<int> slices;
  std::vector<std::string> places;
  double low = 0, high = 0;  // range of the values that # stands for
};

std::string sentence(const Statement& statement) {
  const std::size_t at =
      statement.slices.empty() ? std::string::npos : statement.sentence.find('#');
  if (at == std::string::npos) return statement.sentence;
  char value[64];
  if (statement.low == statement.high)
    std::snprintf(value, sizeof value, "%.6g", statement.low);
  else
    std::snprintf(value, sizeof value, "%.6g to %.6g", statement.low, statement.high);
  return statement.sentence.substr(0, at) + value + statement.sentence.substr(at + 1);
}

// All statements with one code.
struct CodeGroup {
  std::string code;
  std::vector<Statement> statements;
};

Statement& statement_of(std::vector<CodeGroup>& kinds, const std::string& code,
                        const std::string& sentence) {
  auto kind = std::find_if(kinds.begin(), kinds.end(),
                           [&code](const CodeGroup& other) { return other.code == code; });
  if (kind == kinds.end()) kind = kinds.insert(kind, {code, {}});
  auto statement =
      std::find_if(kind->statements.begin(), kind->statements.end(),
                   [&sentence](const Statement& other) { return other.sentence == sentence; });
  if (statement == kind->statements.end())
    statement = kind->statements.insert(statement, {sentence, {}, {}});
  return *statement;
}

// The first three texts and the number of the others.
std::string first_of(const std::vector<std::string>& texts, const char* separator) {
  constexpr std::size_t kMax = 3;
  std::string out;
  for (std::size_t i = 0; i < std::min(texts.size(), kMax); ++i)
    out.append(i == 0 ? "" : separator).append(texts[i]);
  if (texts.size() > kMax) out += " and " + std::to_string(texts.size() - kMax) + " more";
  return out;
}

std::string where(const std::set<int>& slices, const std::vector<std::string>& places) {
  return slices.empty() ? first_of(places, ", ") : named_ranges("slice", slices);
}

json entry(const CodeGroup& kind) {
  Statement all;
  std::vector<std::string> sentences;
  for (const Statement& statement : kind.statements) {
    all.slices.insert(statement.slices.begin(), statement.slices.end());
    all.places.insert(all.places.end(), statement.places.begin(), statement.places.end());
    sentences.push_back(sentence(statement));
    if (kind.statements.size() > 1)
      sentences.back() += " (" + where(statement.slices, statement.places) + ")";
  }
  json out = {{"code", kind.code},
              {"where", where(all.slices, all.places)},
              {"sentence", first_of(sentences, "; ")}};
  if (!all.slices.empty()) out["slices"] = all.slices;
  if (!all.places.empty()) out["places"] = all.places;
  return out;
}

void add_volumes(const VoxelConflict& conflict, double area_mm2, json& warnings) {
  const MaterialVolumes material = material_volumes(conflict, area_mm2);
  for (json& warning : warnings) {
    if (warning["code"] != kVoxelVolume) continue;
    warning["voxel_mm3"] = {{"sform", conflict.sform_mm3}, {"pixdim", conflict.pixdim_mm3}};
    warning["material_mm3"] = {{"sform", material.sform_mm3}, {"pixdim", material.pixdim_mm3}};
  }
}

constexpr double kSame = 1 - 1e-3;  // headers round the width of pixels
constexpr double kTolerance_px = 0.4, kMinRegion_px2 = 4, kSteps = 64;

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

std::vector<SliceWarning> slice_warnings(int index, const MeshedSlice& meshed,
                                         const Segmentation& segmentation,
                                         const LabelNames& names) {
  std::vector<SliceWarning> out;
  // All materials of a slice have the same bounds and the same outcome.
  const Refined& refined = meshed.materials[0].refined;
  if (refined.mesh.triangles.empty()) out.push_back({"empty_slice", index, "without material"});
  if (meshed.not_numbers > 0) {
    out.push_back({"not_numbers", index,
                   "# voxels are not numbers (NaN); they are taken as air, "
                   "or in a label map as background",
                   static_cast<double>(meshed.not_numbers)});
  }
  if (meshed.all_material)
    out.push_back({"all_material", index, "every pixel is material: nothing is outside"});
  if (refined.max_area_mm2 > meshed.max_area_bound_mm2) {
    out.push_back({"area_not_reached", index,
                   "the wanted area needs too many vertices here; refined to # mm^2 "
                   "instead",
                   refined.max_area_mm2});
  }
  switch (refined.outcome) {
    case RefinementOutcome::kRefined:
      break;
    case RefinementOutcome::kLatticeTooCoarse:
      out.push_back({"lattice_too_coarse", index,
                     "# triangles a few lattice steps wide were left as they are; a higher "
                     "--lattice-bits resolves them",
                     static_cast<double>(refined.bad_at_lattice_step)});
      break;
    case RefinementOutcome::kAngleNotReached:
      out.push_back({"angle_not_reached", index,
                     "the wanted angle needs too many vertices here; refined to # degrees "
                     "instead (a lower --min-angle takes fewer)",
                     static_cast<double>(refined.angle_deg)});
      return out;
    case RefinementOutcome::kVertexBudget:
      out.push_back({"vertex_budget", index,
                     "refinement stopped at its vertex budget; the mesh is valid, but not "
                     "all angles and areas are within bounds"});
      return out;
  }
  for (const MeshedMaterial& material : meshed.materials) {
    if (material.quality.below_unexplained == 0) continue;
    std::string which;
    if (meshed.materials.size() > 1) {
      which = " of " + json_text(json(material_name(names, std::get<Labels>(segmentation),
                                                    material.first_label)));
    }
    out.push_back({"angle_not_reached", index,
                   "# triangles" + which +
                       " are below the wanted angle although the input has no such small "
                       "angle there; a lower --min-angle or a higher --lattice-bits helps",
                   static_cast<double>(material.quality.below_unexplained)});
  }
  return out;
}

std::vector<SliceWarning> change_warnings(const std::vector<ChangedSlice>& slices,
                                          double min_region_mm2, double tolerance_mm) {
  constexpr double kMost = 0.01;
  std::vector<SliceWarning> out;
  const auto warn = [&](const char* code, const std::string& what, const std::string& advice,
                        const auto& change_mm2) {
    // Of the larger area, before or after: all of the material can have been dropped.
    const auto whole_mm2 = [](const ChangedSlice& one) {
      const AreaChange& small = one.changes.small;
      return std::max(one.area_mm2, one.area_mm2 + small.dropped_mm2 - small.filled_mm2);
    };
    double changed_mm2 = 0, all_mm2 = 0;
    for (const ChangedSlice& one : slices) {
      changed_mm2 += change_mm2(one.changes);
      all_mm2 += whole_mm2(one);
    }
    if (!(changed_mm2 > kMost * all_mm2)) return;
    const std::string sentence = what + ": " + text_of(changed_mm2, 4) + " mm^2 in all, " +
                                 text_of(100 * changed_mm2 / all_mm2, 3) +
                                 " % of the material's area, and # % of a slice's; " + advice;
    for (const ChangedSlice& one : slices) {
      const double mm2 = change_mm2(one.changes), whole = whole_mm2(one);
      if (mm2 > kMost * whole)
        out.push_back({code, one.slice, sentence, std::rint(1000 * mm2 / whole) / 10});
    }
  };
  const std::string below = " smaller than --min-region " + text_of(min_region_mm2, 4) + " mm^2";
  warn("regions_dropped", "islands of material" + below + " were dropped",
       "a smaller --min-region keeps them",
       [](const SliceChanges& c) { return c.small.dropped_mm2; });
  warn("holes_filled", "holes" + below + " were filled", "a smaller --min-region keeps them open",
       [](const SliceChanges& c) { return c.small.filled_mm2; });
  warn("outline_moved",
       "with --tolerance " + text_of(tolerance_mm, 4) +
           " mm, outlines lie more than half a pixel from their contours",
       "a smaller --tolerance follows them", [](const SliceChanges& c) { return c.moved_mm2; });
  return out;
}

json warnings_json(const std::vector<Warning>& of_scan,
                   const std::vector<SliceWarning>& of_slices) {
  std::vector<CodeGroup> kinds;
  for (const Warning& w : of_scan)
    statement_of(kinds, w.code, w.sentence).places.push_back(w.where);
  for (const SliceWarning& w : of_slices) {
    Statement& statement = statement_of(kinds, w.code, w.sentence);
    statement.low = statement.slices.empty() ? w.value : std::min(statement.low, w.value);
    statement.high = statement.slices.empty() ? w.value : std::max(statement.high, w.value);
    statement.slices.insert(w.slice);
  }
  json out = json::array();
  for (const CodeGroup& kind : kinds)
    out.push_back(entry(kind));
  for (const Warning& w : of_scan) {
    if (w.shared.empty()) continue;
    for (json& warning : out)
      if (warning["code"] == w.code) warning["shared"] = w.shared;
  }
  return out;
}

std::vector<Warning> grouped(const std::vector<Warning>& warnings) {
  std::vector<Warning> out;
  for (const json& w : warnings_json(warnings, {}))
    out.push_back({w["code"], w["where"], w["sentence"], w.value("shared", "")});
  return out;
}

json run_warnings(const SliceStack& stack, const Segmentation& segmentation,
                  const ValueTally& values, double area_mm2,
                  const std::vector<SliceWarning>& of_slices) {
  std::vector<Warning> out = stack.warnings;
  const std::string input = input_name(stack);
  if (stack.voxel_conflict) {
    out.push_back(voxel_volume_warning(*stack.voxel_conflict,
                                       material_volumes(*stack.voxel_conflict, area_mm2), input));
  }
  const auto* threshold = std::get_if<Threshold>(&segmentation);
  if (threshold != nullptr && stack.pixel_unit() == PixelUnit::kHounsfield &&
      threshold->value < kSkin_HU) {
    out.push_back({"face", "--threshold",
                   "below 100 HU the skin is material: a face can be recognised in the asset"});
  }
  if (auto doubt = value_warning(values, stack.pixel_unit(), segmentation, input))
    out.push_back(std::move(*doubt));
  if (auto rounded = rounding_warning(values, input)) out.push_back(std::move(*rounded));
  json entries = warnings_json(out, of_slices);
  if (stack.voxel_conflict) add_volumes(*stack.voxel_conflict, area_mm2, entries);
  return entries;
}

void follow_small_pixels(const SliceStack& stack, StackOptions& options) {
  double narrow_mm = std::numeric_limits<double>::infinity(), pixel_mm2 = narrow_mm, wide_mm = 0;
  for (int k = 0; k < stack.size(); ++k) {
    const SlicePlane& plane = stack.plane(k);
    const double u = plane.spacing_u_mm, v = plane.spacing_v_mm;
    narrow_mm = std::min({narrow_mm, u, v});
    pixel_mm2 = std::min(pixel_mm2, u * v);
    wide_mm = std::max({wide_mm, (stack.width() + 2) * u, (stack.height() + 2) * v});
  }
  if (!(narrow_mm < kSmallPixel_mm * kSame)) return;
  const DefaultOptions& is_default = options.defaults;
  MeshOptions& mesh = options.mesh;
  if (is_default.tolerance) {
    double& mm = mesh.simplification.tolerance_mm;
    mm = std::min(mm, kTolerance_px * narrow_mm);
  }
  if (is_default.min_region)
    mesh.min_region_mm2 = std::min(mesh.min_region_mm2, kMinRegion_px2 * pixel_mm2);
  if (is_default.lattice_bits) {
    const auto fits = [wide_mm](Lattice lattice) { return wide_mm < lattice.to_mm(kMaxAssetSpan); };
    Lattice& lattice = mesh.lattice;
    while (lattice.bits < kMaxLatticeBits && narrow_mm < kSteps * lattice.step_mm() &&
           fits({lattice.bits + 1}))
      ++lattice.bits;
  }
  const double scale = narrow_mm / kSmallPixel_mm;
  if (is_default.close) options.solid.close_mm *= scale;
  if (is_default.min_volume) options.solid.min_volume_mm3 *= scale * scale * scale;
}

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
