// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/batch.h"

#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/info.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <iterator>
#include <map>
#include <mutex>
#include <new>
#include <numeric>
#include <set>
#include <string>
#include <utility>

#include "formats/base/json_text.h"
#include "pipeline/asset_surfaces.h"
#include "pipeline/contour/label_pixels.h"
#include "pipeline/for_each_piece.h"
#include "pipeline/no_material.h"
#include "pipeline/report.h"
#include "pipeline/run_stages.h"

namespace trocar::pipeline {
namespace {

using nlohmann::json;

// Skin and muscle have 20 to 80 HU.
constexpr double kSkinHu = 100;

// An entry of the asset and of the report.
struct FinishedMaterial {
  int first_label = 0;  // MeshedMaterial's
  EncodedSlice slice;
  std::vector<std::uint8_t> report;  // as CBOR, a tenth of the JSON tree's size
};

struct FinishedSlice {
  std::vector<FinishedMaterial> materials;
  json stages;
  std::vector<SliceWarning> warnings;
  std::set<int> labels;
  ValueTally values;
  double area_mm2 = 0;
  json ms;  // by stage
};

// The set of labels that the label is joined with; null: none.
const std::set<int>* joined_with(const Labels& wanted, int label) {
  const auto found =
      std::find_if(wanted.joined.begin(), wanted.joined.end(),
                   [label](const std::set<int>& one) { return one.contains(label); });
  return found == wanted.joined.end() ? nullptr : &*found;
}

// Of a joined material: its labels' names, as far as they fit.
std::string material_name(const LabelNames& names, const Labels& wanted, int first_label) {
  const std::set<int>* const joined = joined_with(wanted, first_label);
  if (joined == nullptr) return names.name_of(first_label);
  std::string out;
  std::size_t left = joined->size();
  for (const int label : *joined) {
    constexpr std::size_t kForMore = 16;  // " + 65535 more"
    const std::string name = (out.empty() ? "" : " + ") + names.name_of(label);
    if (!out.empty() && out.size() + name.size() + (left > 1 ? kForMore : 0) > kMaxNameBytes)
      return out + " + " + std::to_string(left) + " more";
    out += name;
    --left;
  }
  return out;
}

void warn(FinishedSlice& out, int index, const MeshedSlice& meshed, const BatchOptions& options) {
  // Bounds and outcome are those of all materials of a slice.
  const Refined& refined = meshed.materials[0].refined;
  if (refined.mesh.triangles.empty()) {
    out.warnings.push_back({"empty_slice", index, "no material"});
  }
  if (meshed.all_material) {
    out.warnings.push_back({"all_material", index, "every pixel is material: nothing is outside"});
  }
  if (refined.max_area_mm2 > meshed.max_area_bound_mm2) {
    out.warnings.push_back({"area_not_reached", index,
                            "the wanted area needs too many vertices here; refined to # mm^2 "
                            "instead",
                            refined.max_area_mm2});
  }
  switch (refined.outcome) {
    case RefinementOutcome::kRefined:
      break;
    case RefinementOutcome::kLatticeTooCoarse:
      out.warnings.push_back({"lattice_too_coarse", index,
                              "# triangles a few lattice steps wide were left as they are",
                              static_cast<double>(refined.bad_at_lattice_step)});
      break;
    case RefinementOutcome::kAngleNotReached:
      out.warnings.push_back({"angle_not_reached", index,
                              "the wanted angle needs too many vertices here; refined to # degrees "
                              "instead",
                              static_cast<double>(refined.angle_deg)});
      return;
    case RefinementOutcome::kVertexBudget:
      out.warnings.push_back({"vertex_budget", index,
                              "refinement stopped at its vertex budget; the mesh is valid, but not "
                              "all angles and areas are within bounds"});
      return;
  }
  for (const MeshedMaterial& material : meshed.materials) {
    if (material.quality.below_unexplained == 0) continue;
    std::string which;
    if (meshed.materials.size() > 1) {
      which = " of " + json_text(json(material_name(options.names,
                                                    std::get<Labels>(options.mesh.segmentation),
                                                    material.first_label)));
    }
    out.warnings.push_back({"angle_not_reached", index,
                            "# triangles" + which +
                                " are below the wanted angle although the input has no such small "
                                "angle there",
                            static_cast<double>(material.quality.below_unexplained)});
  }
}

// Of all slices that were meshed.
struct Total {
  ValueTally values;
  double area_mm2 = 0;
};

// The stack's own, and what is known after meshing.
std::vector<Warning> warnings_of_scan(const SliceStack& stack, const MeshOptions& options,
                                      const Total& total) {
  std::vector<Warning> out = stack.warnings;
  const std::string input = input_name(stack);
  if (stack.voxel_conflict) {
    out.push_back(voxel_volume_warning(
        *stack.voxel_conflict, material_volumes(*stack.voxel_conflict, total.area_mm2), input));
  }
  const auto* threshold = std::get_if<Threshold>(&options.segmentation);
  if (threshold != nullptr && stack.pixel_unit() == PixelUnit::kHounsfield &&
      threshold->value < kSkinHu) {
    out.push_back({"face", "--threshold",
                   "below 100 HU the skin is material: a face can be recognised in the asset"});
  }
  if (auto doubt = value_doubt(total.values, stack.pixel_unit(), options.segmentation, input))
    out.push_back(std::move(*doubt));
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

std::set<int> wanted_labels(const Segmentation& how) {
  const auto* labels = std::get_if<Labels>(&how);
  return labels == nullptr || labels->all ? std::set<int>() : labels->labels;
}

// How far beyond the edge of the image's outermost pixels, where contours end, a vertex may be put.
double farthest_beyond_mm(const MeshOptions& options) {
  const double step_mm = options.lattice.step_mm();  // for what is rounded to the lattice
  return std::max(options.simplification.tolerance_mm, kFarthestFromOutline_steps * step_mm) +
         step_mm;
}

// The quantisation grid of all slices, which holds every vertex: the image, or its crop, with a
// margin.
Result<DracoGrid> common_grid(const SliceStack& stack, int first, int last,
                              const MeshOptions& options) {
  const Crop whole{0, stack.width() - 1, 0, stack.height() - 1};
  const Crop& c = options.crop ? *options.crop : whole;
  const double beyond = farthest_beyond_mm(options);
  std::array<double, 4> box{};  // mm
  for (int k = first; k <= last; ++k) {
    const SlicePlane& plane = stack.plane(k);
    const double u = plane.spacing_u_mm, v = plane.spacing_v_mm;
    const double margin_u = 0.5 * u + std::max(0.5 * u, beyond),
                 margin_v = 0.5 * v + std::max(0.5 * v, beyond);
    const std::array<double, 4> here{c.x0 * u - margin_u, c.y0 * v - margin_v, c.x1 * u + margin_u,
                                     c.y1 * v + margin_v};
    for (std::size_t i = 0; i < 4; ++i)
      box[i] =
          k == first ? here[i] : (i < 2 ? std::min(box[i], here[i]) : std::max(box[i], here[i]));
  }
  LatticeBox lattice_box;
  const auto snapped = [&](double mm) {
    const double farthest = options.lattice.to_mm(kMaxCoordinate);
    return options.lattice.snap_mm(std::clamp(mm, -farthest, farthest));
  };
  lattice_box.low = {snapped(box[0]), snapped(box[1])};
  lattice_box.high = {snapped(box[2]), snapped(box[3])};
  return asset_grid(options.lattice, lattice_box);
}

Result<FinishedSlice> mesh_one(const SliceStack& stack, int index, const BatchOptions& options,
                               const Result<DracoGrid>& grid) {
  auto meshed = mesh_slice(stack, index, options.mesh);
  if (!meshed) return meshed.error();
  Stopwatch watch;
  if (!grid) return Error{grid.error().code, stack.name(index) + ": " + grid.error().message};
  const SlicePlane& plane = stack.plane(index);
  FinishedSlice out;
  if (options.dump_slice == index)
    out.stages = slice_stages(index, plane, *meshed, options.mesh.lattice);
  warn(out, index, *meshed, options);
  out.labels = std::move(meshed->labels);
  out.values = std::move(meshed->values);
  out.area_mm2 = meshed->area_mm2();

  std::vector<json> reports;
  for (const MeshedMaterial& material : meshed->materials)
    reports.push_back(slice_report(index, plane.z_mm, material, meshed->max_area_bound_mm2));
  for (MeshedMaterial& material : meshed->materials) {
    std::vector<float> hu;
    if (material.hu) hu = std::move(material.hu->values);
    auto encoded = encode_slice({index,
                                 plane.z_mm,
                                 plane.T_lps_plane,
                                 {},
                                 std::move(material.refined.mesh),
                                 json_text(slice_measures(material)),
                                 0,
                                 std::move(hu)},
                                material.outline, *grid);
    if (!encoded) return encoded.error();
    out.materials.push_back({material.first_label, std::move(*encoded), {}});
  }
  out.ms = stage_times(meshed->times);
  out.ms["encode"] = watch.lap_ms();
  reports[0]["ms"] = out.ms;
  for (std::size_t k = 0; k < reports.size(); ++k)
    out.materials[k].report = json::to_cbor(reports[k]);
  return out;
}

// By stage, of all threads together; `piece_ms` begins with the digests of `files` files.
std::map<std::string, double> thread_times(
    const std::vector<double>& piece_ms, std::size_t files, double unpack_ms,
    const std::vector<std::optional<Result<FinishedSlice>>>& slices) {
  std::map<std::string, double> out;
  for (std::size_t i = 0; i < files; ++i)
    out["digest"] += piece_ms[i];
  for (const auto& slice : slices) {
    for (const auto& [stage, ms] : (**slice).ms.items())
      out[stage] += ms.get<double>();
  }
  out["read"] -= unpack_ms;
  out["unpack"] = unpack_ms;
  return out;
}

// Of each material of the asset: what it is in the scan.
std::vector<Segmentation> materials_in_scan(const std::map<int, int>& first_labels,
                                            const Segmentation& segmentation) {
  const auto* const wanted = std::get_if<Labels>(&segmentation);
  if (wanted == nullptr) return {segmentation};
  std::vector<Segmentation> out;
  for (const auto& [first_label, place] : first_labels) {
    const std::set<int>* const joined = joined_with(*wanted, first_label);
    out.emplace_back(Labels{joined == nullptr ? std::set{first_label} : *joined});
  }
  return out;
}

}  // namespace

Result<void> check_ranges(const SliceStack& stack, const BatchOptions& options) {
  if (options.slices) {
    const auto [a, b] = *options.slices;
    if (a < 0 || b < a || b >= stack.size()) {
      return usage("--slices " + std::to_string(a) + ":" + std::to_string(b) +
                   (b < a ? " ends before it begins; there are 0:" : " is outside 0:") +
                   std::to_string(stack.size() - 1));
    }
  }
  if (options.mesh.grade_hu > 0 && (stack.pixel_unit() != PixelUnit::kHounsfield ||
                                    std::holds_alternative<Labels>(options.mesh.segmentation)))
    return usage("--grade needs a scan in HU: images, label maps and other modalities have none");
  if (options.colours && options.mesh.hu == nullptr &&
      (stack.pixel_unit() != PixelUnit::kHounsfield ||
       std::holds_alternative<Labels>(options.mesh.segmentation)))
    return usage("--colour needs HU: a scan in HU, or the CT of a label map (--hu)");
  if (options.mesh.crop) {
    const Crop& c = *options.mesh.crop;
    if (c.x0 < 0 || c.y0 < 0 || c.x1 <= c.x0 || c.y1 <= c.y0 || c.x1 >= stack.width() ||
        c.y1 >= stack.height()) {
      const bool is_narrow = c.x1 <= c.x0 || c.y1 <= c.y0;
      return usage(
          "--crop " + std::to_string(c.x0) + ":" + std::to_string(c.x1) + "," +
          std::to_string(c.y0) + ":" + std::to_string(c.y1) +
          (is_narrow ? " must be two pixels wide and high at least, within 0:" : " is outside 0:") +
          std::to_string(stack.width() - 1) + ",0:" + std::to_string(stack.height() - 1));
    }
  }
  return {};
}

Result<BatchResult> mesh_stack(const SliceStack& stack, const BatchOptions& given,
                               const json& parameters) {
  if (auto ok = check_ranges(stack, given); !ok) return ok.error();
  BatchOptions options = given;
  RunStages stages(options.start);
  options.names.add_defaults(stack.label_names);
  const int first = options.slices ? options.slices->first : 0;
  const int last = options.slices ? options.slices->second : stack.size() - 1;
  const int threads =
      options.threads > 0 ? options.threads : oneapi::tbb::info::default_concurrency();
  const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism,
                                          static_cast<std::size_t>(threads));

  std::optional<SolidBone> solid;
  if (options.solid.any()) {
    stages.lap("open");
    auto made = SolidBone::make(stack, options.mesh.segmentation, options.axis, options.solid);
    if (!made) return made.error();
    solid = std::move(*made);
    options.mesh.solid = &*solid;
    stages.lap("solid");
  }
  Result<DracoGrid> grid = common_grid(stack, first, last, options.mesh);
  if (grid) grid->colours = options.colours;

  // The digests of the input's files are computed in parallel with the slices. Without a key none
  // is stored: it would identify the scan.
  std::vector<std::filesystem::path> input_files;
  if (!options.input_key.empty()) input_files = stack.files;
  if (const SliceStack* hu = options.mesh.hu; hu != nullptr && !options.input_key.empty())
    input_files.insert(input_files.end(), hu->files.begin(), hu->files.end());
  const int files = static_cast<int>(input_files.size());
  std::vector<Result<std::string>> digests(input_files.size(), std::string());
  std::vector<std::optional<Result<FinishedSlice>>> done(
      static_cast<std::size_t>(last - first + 1));
  std::vector<double> piece_ms(input_files.size() + done.size());
  std::mutex mutex;
  int finished = 0;
  const auto do_piece = [&](int piece) {
    if (options.stop != nullptr && options.stop->load()) return;
    if (piece < files) {
      digests[static_cast<std::size_t>(piece)] =
          digest_file(input_files[static_cast<std::size_t>(piece)]);
      return;
    }
    const int k = piece - files;
    try {
      done[static_cast<std::size_t>(k)] = mesh_one(stack, first + k, options, grid);
    } catch (const std::bad_alloc&) {
      done[static_cast<std::size_t>(k)] = refused(stack.name(first + k) + ": not enough memory");
    }
    if (options.progress) {
      const std::lock_guard lock(mutex);
      options.progress(++finished, last - first + 1);
    }
  };
  const auto one_piece = [&](int piece) {
    Stopwatch watch;
    do_piece(piece);
    piece_ms[static_cast<std::size_t>(piece)] = watch.lap_ms();
  };
  const auto waited_ms = [&] {
    return stack.waited_ms() + (options.mesh.hu != nullptr ? options.mesh.hu->waited_ms() : 0);
  };
  const double waited_before_ms = waited_ms();
  stages.lap("open");
  for_each_piece(files + last - first + 1, one_piece);

  if (options.stop != nullptr && options.stop->load()) {
    return unwritable("interrupted; nothing was written");
  }
  for (const auto& result : done) {
    if (!*result) return result->error();
  }
  stages.lap_shared(
      threads, std::accumulate(piece_ms.begin(), piece_ms.end(), 0.0),
      thread_times(piece_ms, input_files.size(), waited_ms() - waited_before_ms, done));
  for (const SliceStack* const read : {&stack, options.mesh.hu}) {
    if (read == nullptr) continue;
    if (const auto whole = read->finish(); !whole) return whole.error();
  }
  stages.lap("unpack");
  BatchResult out;
  json used = parameters;  // with the labels found, if all are wanted
  if (stack.pixel_unit() == PixelUnit::kUncalibrated) {
    used["modality"] = stack.modality;
    used["values_are_hu"] = false;
  }
  std::set<int> found;
  std::vector<SliceWarning> of_slices;
  std::vector<FinishedMaterial> finished_materials;
  Total total;
  std::set<int> absent = wanted_labels(options.mesh.segmentation);
  for (auto& result : done) {
    FinishedSlice one = std::move(**result);
    std::move(one.materials.begin(), one.materials.end(), std::back_inserter(finished_materials));
    of_slices.insert(of_slices.end(), one.warnings.begin(), one.warnings.end());
    total.values.add(one.values);
    total.area_mm2 += one.area_mm2;
    for (const int label : one.labels)
      absent.erase(label);
    found.merge(one.labels);
    if (!one.stages.is_null()) out.stages = std::move(one.stages);
  }
  done = {};
  json warnings = warnings_json(warnings_of_scan(stack, options.mesh, total), of_slices);
  if (stack.voxel_conflict) add_volumes(*stack.voxel_conflict, total.area_mm2, warnings);
  if (!absent.empty()) {
    warnings.push_back({{"code", "label_absent"},
                        {"where", options.names.list(absent)},
                        {"sentence", "not in the slices that were meshed"},
                        {"labels", absent}});
  }
  const auto* labels = std::get_if<Labels>(&options.mesh.segmentation);
  if (labels != nullptr && labels->all) used["labels"] = found;
  Asset asset{options.mesh.lattice, {}, "trocar-mesh " TROCAR_VERSION, json_text(used)};
  asset.lines = options.lines;
  asset.colours = options.colours;
  std::vector<std::string> file_digests;
  for (const auto& digest : digests) {
    if (!digest) return digest.error();
    file_digests.push_back(*digest);
  }
  if (!options.input_key.empty())
    out.input_key_digest = asset.input_key_digest = digest_input(file_digests, options.input_key);

  std::map<int, int> places;  // in asset.materials, by first label
  for (const FinishedMaterial& one : finished_materials) {
    if (one.slice.triangles > 0) places.emplace(one.first_label, 0);
  }
  if (places.empty()) return no_material(stack, first, last, options.mesh, options.names);
  if (labels != nullptr) {
    asset.materials.clear();
    for (auto& [first_label, place] : places) {
      place = static_cast<int>(asset.materials.size());
      AssetMaterial& material = asset.materials.emplace_back();
      material.name = material_name(options.names, *labels, first_label);
      if (joined_with(*labels, first_label) == nullptr) material.label = first_label;
    }
    std::set<int> dropped;
    for (const int label : found) {
      const std::set<int>* const joined = joined_with(*labels, label);
      if (!places.contains(joined == nullptr ? label : *joined->begin())) dropped.insert(label);
    }
    if (!dropped.empty()) {
      warnings.push_back({{"code", "label_dropped"},
                          {"where", options.names.list(dropped)},
                          {"sentence", "all of its pieces are smaller than --min-region"},
                          {"labels", dropped}});
    }
    if (asset.materials.size() > kMostMaterials)
      return refused(input_name(stack) + ": more than " + std::to_string(kMostMaterials) +
                     " labels; join some to one material, as --labels 1-20+21");
  }
  std::vector<EncodedSlice> encoded;
  for (FinishedMaterial& one : finished_materials) {
    if (one.slice.triangles > 0) one.slice.material = places[one.first_label];
    encoded.push_back(std::move(one.slice));
  }

  json surface;
  stages.lap("collect");
  if (options.surface) {
    auto added =
        add_surfaces(stack, first, last, options,
                     materials_in_scan(places, options.mesh.segmentation), asset, warnings);
    if (!added) return added.error();
    surface = std::move(*added);
    stages.lap("surface");
  }

  AssetSizes sizes;
  auto glb = assemble_asset(asset, std::move(encoded), &sizes);
  if (!glb) return glb.error();
  out.glb = std::move(*glb);
  stages.lap("assemble");

  json slices = json::array();
  for (FinishedMaterial& one : finished_materials) {
    slices.push_back(json::from_cbor(std::exchange(one.report, {})));
    if (asset.materials.size() > 1 && places.contains(one.first_label) &&
        slices.back()["triangles"] > 0) {
      slices.back()["material"] =
          asset.materials[static_cast<std::size_t>(places[one.first_label])].name;
    }
  }
  stages.lap("collect");
  const auto per_triangle = [&sizes](std::size_t bytes) {
    return sizes.triangles == 0 ? 0.0
                                : static_cast<double>(bytes) / static_cast<double>(sizes.triangles);
  };
  out.report = {{"schema", "trocar.report/1"},
                {"program", "trocar-mesh " TROCAR_VERSION},
                {"parameters", std::move(used)},
                {"slices", std::move(slices)},
                {"asset",
                 {{"bytes", out.glb.size()},
                  {"triangles", sizes.triangles},
                  {"bytes_per_triangle", per_triangle(out.glb.size())},
                  {"triangle_bytes", sizes.triangle_bytes},
                  {"triangle_bytes_per_triangle", per_triangle(sizes.triangle_bytes)},
                  {"outline_bytes", sizes.outline_bytes},
                  {"json_bytes", sizes.json_bytes},
                  {"index_bytes", sizes.index_bytes}}},
                {"assemble_ms", stages.ms().at("assemble")},
                {"stages_ms", stages.ms()},
                {"total_ms", Stopwatch(options.start).lap_ms()},
                {"threads", threads},
                {"peak_rss_bytes", peak_rss_bytes()},
                {"warnings", std::move(warnings)}};
  if (labels != nullptr) {
    json& named = out.report["labels"] = json::array();
    for (const int label : found)
      named.push_back({{"label", label}, {"name", options.names.name_of(label)}});
  }
  if (solid)
    out.report["solid"] = {{"filled_mm3", solid->filled_mm3()},
                           {"dropped_mm3", solid->dropped_mm3()}};
  if (options.surface) {
    out.report["surface"] = std::move(surface);
    out.report["asset"]["surface_bytes"] = sizes.surface_bytes;
  }
  return out;
}

}  // namespace trocar::pipeline
