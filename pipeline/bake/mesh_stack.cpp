// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/bake/mesh_stack.h"

#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/info.h>
#include <iterator>
#include <mutex>
#include <new>
#include <numeric>

#include "formats/asset/deidentification.h"
#include "formats/base/json.h"
#include "pipeline/bake/hu_planes.h"
#include "pipeline/bake/report.h"
#include "pipeline/read/file_names.h"
#include "pipeline/read/number_ranges.h"

namespace trocar::pipeline {
namespace {

using nlohmann::json;

// The materials of an asset. Key: MeshedMaterial::first_label; value: index in Asset::materials.
using MaterialIndices = std::map<int, int>;

class RunStages {
 public:
  explicit RunStages(Stopwatch::TimePoint start) : watch_(start) {}

  // Ends a lap and adds its duration to the stage. The first lap begins at `start`, every other
  // one when the lap before ends.
  void lap(const char* stage) { ms_[stage] += watch_.lap_ms(); }

  // Ends a lap in which several threads worked on several stages. `thread_ms` has the time of each
  // stage, summed over all threads; this sum, divided by the number of threads, is added to the
  // stage. `busy_ms` is the time in which threads were busy, summed over all threads. The duration
  // of the lap minus busy_ms / threads is added to the stage `idle`. Busy time that belongs to no
  // stage is not listed, so the stages can add up to less than the time of the run.
  void lap_shared(int threads, double busy_ms, const std::map<std::string, double>& thread_ms) {
    for (const auto& [stage, ms] : thread_ms)
      ms_[stage] += ms / threads;
    ms_["idle"] += std::max(0.0, watch_.lap_ms() - busy_ms / threads);
  }

  const std::map<std::string, double>& ms() const { return ms_; }

 private:
  Stopwatch watch_;
  std::map<std::string, double> ms_;
};

// The input of all stages.
struct Run {
  const SliceStack& stack;
  StackOptions options;
  int first, last;
  int threads;
  RunStages stages;
  HuSampling sampling = {};

  // The label map, if the material is chosen by labels; else null.
  const Labels* labels() const { return std::get_if<Labels>(&options.mesh.segmentation); }
  // The size of slices as they are read.
  int width() const {
    return options.mesh.crop ? options.mesh.crop->x1 - options.mesh.crop->x0 + 1 : stack.width();
  }
  int height() const {
    return options.mesh.crop ? options.mesh.crop->y1 - options.mesh.crop->y0 + 1 : stack.height();
  }
  bool is_stopped() const { return options.stop != nullptr && options.stop->load(); }
  double waited_ms() const {
    return stack.waited_ms() + (options.mesh.hu != nullptr ? options.mesh.hu->waited_ms() : 0);
  }
};

// An entry of the asset and of the report.
struct EncodedMaterial {
  int first_label = 0;  // of MeshedMaterial
  EncodedSlice slice;
  std::vector<std::uint8_t> report;  // as CBOR, a tenth of the JSON tree's size
};

struct FinishedSlice {
  std::vector<EncodedMaterial> materials;
  EncodedHu hu;  // no bytes: none
  json stages;
  std::vector<SliceWarning> warnings;
  std::set<int> labels;
  ValueTally values;
  ChangedSlice changed;
  StageTimes ms;
};

// The results of the parallel stage.
struct Finished {
  std::vector<Result<std::string>> digests;  // by input file
  std::vector<std::optional<Result<FinishedSlice>>> slices;
};

// All slices together.
struct Collected {
  std::vector<EncodedMaterial> materials;
  std::vector<EncodedHuPlane> hu;
  std::int64_t hu_samples = 0;
  std::vector<SliceWarning> warnings;
  std::set<int> labels;
  ValueTally values;
  double area_mm2 = 0;
  std::vector<ChangedSlice> changed;
  json stages;  // of StackOptions::dump_slice
};

Error after_hu(const Error& error, const std::string& name) {
  return {error.code, name + ": " + error.message + " (--no-hu leaves HU out)"};
}

Result<FinishedSlice> mesh_and_encode(const Run& run, int index, const Result<DracoGrid>& grid) {
  const SliceStack& stack = run.stack;
  const StackOptions& options = run.options;
  auto meshed = mesh_slice(stack, index, options.mesh);
  if (!meshed) return meshed.error();
  Stopwatch watch;
  if (!grid) return grid.error().after(stack.name(index) + ": ");
  const SlicePlane& plane = stack.plane(index);
  FinishedSlice out;
  if (options.dump_slice == index)
    out.stages = slice_stages(index, plane, *meshed, options.mesh.lattice);
  out.warnings = slice_warnings(index, *meshed, options.mesh.segmentation, options.names);
  out.labels = std::move(meshed->labels);
  out.values = std::move(meshed->values);
  out.changed = {index, meshed->area_mm2(), meshed->changes};

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
  out.ms = std::move(meshed->times);
  out.ms["encode"] = watch.lap_ms();
  if (meshed->hu) {
    std::vector<const Pslg*> outlines;
    for (const EncodedMaterial& material : out.materials)
      outlines.push_back(&material.slice.pslg);
    auto hu = encode_hu(index, *meshed->hu, run.sampling, options.mesh.lattice, outlines);
    if (!hu) return after_hu(hu.error(), stack.name(index));
    out.hu = std::move(*hu);
  }
  out.ms["hu"] += watch.lap_ms();
  reports[0].update(changes_report(out.changed.changes));
  reports[0]["ms"] = out.ms;
  for (std::size_t k = 0; k < reports.size(); ++k)
    out.materials[k].report = json::to_cbor(reports[k]);
  return out;
}

// The files whose digests identify the input. Without a key there are none: an unkeyed digest would
// identify the scan.
std::vector<std::filesystem::path> files_to_digest(const Run& run) {
  if (run.options.input_key.empty()) return {};
  std::vector<std::filesystem::path> out = run.stack.files;
  if (const SliceStack* hu = run.options.mesh.hu; hu != nullptr)
    out.insert(out.end(), hu->files.begin(), hu->files.end());
  return out;
}

// The time of each stage, of all threads together. `task_ms` begins with the digests.
std::map<std::string, double> thread_times(const std::vector<double>& task_ms, double unpack_ms,
                                           const Finished& finished) {
  std::map<std::string, double> out;
  for (std::size_t i = 0; i < finished.digests.size(); ++i)
    out["digest"] += task_ms[i];
  for (const auto& slice : finished.slices) {
    for (const auto& [stage, ms] : (**slice).ms)
      out[stage] += ms;
  }
  out["read"] -= unpack_ms;
  out["unpack"] = unpack_ms;
  return out;
}

// Solid bone, if the options want it.
Result<std::optional<SolidBone>> make_solid(Run& run) {
  const StackOptions& options = run.options;
  if (!options.solid.any()) return std::optional<SolidBone>();
  run.stages.lap("open");
  auto made = SolidBone::make(run.stack, options.mesh.segmentation, options.axis, options.solid,
                              options.mesh.table);
  if (!made) return made.error();
  run.stages.lap("solid");
  return std::optional(std::move(*made));
}

// Digests the files and meshes the slices in parallel: a task for each file, then one for each
// slice. Errors: (unwritable) stopped; the lowest slice's; those of a volume that is unpacked
// meanwhile.
Result<Finished> digest_and_mesh(Run& run, const Result<DracoGrid>& grid) {
  const std::vector<std::filesystem::path> files = files_to_digest(run);
  const std::size_t slices = static_cast<std::size_t>(run.last - run.first) + 1;
  Finished out{std::vector<Result<std::string>>(files.size(), std::string()),
               std::vector<std::optional<Result<FinishedSlice>>>(slices)};
  std::vector<double> task_ms(files.size() + slices);
  std::mutex mutex;
  int finished = 0;
  const auto mesh = [&](std::size_t k) {
    const int index = run.first + static_cast<int>(k);
    try {
      out.slices[k] = mesh_and_encode(run, index, grid);
    } catch (const std::bad_alloc&) {
      out.slices[k] = refused_for_now(run.stack.name(index) + ": not enough memory");
    }
    if (run.options.progress) {
      const std::lock_guard lock(mutex);
      run.options.progress(++finished, static_cast<int>(slices));
    }
  };
  const double waited_before_ms = run.waited_ms();
  run.stages.lap("open");
  parallel_for(static_cast<int>(task_ms.size()), [&](int i) {
    const auto task = static_cast<std::size_t>(i);
    Stopwatch watch;
    if (run.is_stopped()) return;
    if (task < files.size())
      out.digests[task] = digest_file(files[task]);
    else
      mesh(task - files.size());
    task_ms[task] = watch.lap_ms();
  });
  if (run.is_stopped()) return unwritable("interrupted; nothing was written");
  for (const auto& result : out.slices) {
    if (!*result) return result->error();
  }
  run.stages.lap_shared(run.threads, std::accumulate(task_ms.begin(), task_ms.end(), 0.0),
                        thread_times(task_ms, run.waited_ms() - waited_before_ms, out));
  for (const SliceStack* const read : {&run.stack, run.options.mesh.hu}) {
    if (read == nullptr) continue;
    if (const auto whole = read->finish(); !whole) return whole.error();
  }
  run.stages.lap("unpack");
  return out;
}

Collected collect(std::vector<std::optional<Result<FinishedSlice>>> slices) {
  Collected out;
  for (auto& result : slices) {
    FinishedSlice one = std::move(**result);
    out.hu_samples += one.hu.samples;
    if (!one.hu.bytes.empty()) out.hu.push_back(std::move(one.hu));
    std::move(one.materials.begin(), one.materials.end(), std::back_inserter(out.materials));
    out.warnings.insert(out.warnings.end(), one.warnings.begin(), one.warnings.end());
    out.values.add(one.values);
    out.area_mm2 += one.changed.area_mm2;
    out.changed.push_back(one.changed);
    out.labels.merge(one.labels);
    if (!one.stages.is_null()) out.stages = std::move(one.stages);
  }
  return out;
}

// Encodes the HU of the slices once more, with a coarser sampling.
Result<void> encode_hu_again(const Run& run, Collected& all) {
  const SliceStack& ct = run.options.mesh.hu != nullptr ? *run.options.mesh.hu : run.stack;
  std::map<int, std::vector<const Pslg*>> outlines;  // by slice
  for (const EncodedMaterial& material : all.materials)
    outlines[material.slice.index].push_back(&material.slice.pslg);
  std::vector<std::int64_t> samples(all.hu.size());
  auto done = try_in_parallel(static_cast<int>(samples.size()), [&](int i) -> Result<void> {
    EncodedHuPlane& plane = all.hu[static_cast<std::size_t>(i)];
    const int index = plane.index;
    const auto image = read_cropped(ct, index, run.options.mesh.crop);
    if (!image) return image.error();
    auto hu = encode_hu(index, *image, run.sampling, run.options.mesh.lattice, outlines.at(index));
    if (!hu) return after_hu(hu.error(), ct.name(index));
    samples[static_cast<std::size_t>(i)] = hu->samples;
    plane = std::move(*hu);
    return {};
  });
  all.hu_samples = std::accumulate(samples.begin(), samples.end(), std::int64_t{0});
  return done;
}

// Slices with little material in large boxes can have more samples of HU than a reader admits for a
// file of their size. Their HU then get a coarser sampling.
Result<void> limit_hu(Run& run, Collected& all, json& warnings) {
  const auto is_within = [&all] {
    std::uint64_t bytes = 0;  // the file has more
    for (const EncodedMaterial& material : all.materials)
      bytes += material.slice.draco.size();
    for (const EncodedHuPlane& plane : all.hu)
      bytes += plane.bytes.size();
    return static_cast<std::uint64_t>(all.hu_samples) <= max_hu_samples(bytes);
  };
  const auto pitch_mm = [&run] { return run.sampling.grid.pitch_mm.maxCoeff(); };
  const double wanted_mm = pitch_mm();
  for (int coarser = 2; !is_within(); coarser *= 2) {
    const int columns = run.sampling.grid.columns, rows = run.sampling.grid.rows;
    run.sampling = hu_sampling(run.stack.plane(run.first), run.width(), run.height(),
                               run.options.mesh, coarser);
    if (run.sampling.grid.columns == columns && run.sampling.grid.rows == rows)
      return refused(input_name(run.stack) +
                     ": more HU than an asset of its size may have; --no-hu leaves them out");
    if (auto ok = encode_hu_again(run, all); !ok) return ok;
  }
  if (pitch_mm() > wanted_mm) {
    warnings.push_back({{"code", "hu_coarser"},
                        {"where", "HU"},
                        {"sentence", "stored every " + text_of(pitch_mm(), 3) + " mm instead of " +
                                         text_of(wanted_mm, 3) +
                                         " mm: the material is so sparse that an asset cannot hold "
                                         "more; --crop to the material allows for finer HU"}});
  }
  return {};
}

// The volumes of HU: that of the slices, and the context if it is wanted.
Result<std::vector<EncodedHuVolume>> hu_volumes(const Run& run,
                                                std::vector<EncodedHuPlane> planes) {
  std::vector<EncodedHuVolume> out;
  if (!planes.empty()) out.push_back({run.sampling.grid, std::move(planes)});
  if (!run.options.context_mm) return out;
  const SliceStack& ct = run.options.mesh.hu != nullptr ? *run.options.mesh.hu : run.stack;
  const double pitch_mm = *run.options.context_mm > 0
                              ? *run.options.context_mm
                              : default_context_mm(ct.plane(run.first), run.width(), run.height());
  auto context = encode_context(ct, run.first, run.last, pitch_mm, run.options.mesh);
  if (!context) return context.error();
  out.push_back(std::move(*context));
  return out;
}

// The parameters that the asset stores: also what was found out about the scan.
json used_parameters(const Run& run, const json& parameters, const Collected& all) {
  json out = parameters;
  if (run.stack.pixel_unit() == PixelUnit::kUncalibrated) {
    out["modality"] = shared_modality(run.stack.modality);
    out["values_are_hu"] = false;
  }
  if (const Labels* labels = run.labels(); labels != nullptr && labels->all)
    out["labels"] = all.labels;
  return out;
}

// The materials with triangles in any slice.
MaterialIndices material_indices(const std::vector<EncodedMaterial>& materials) {
  MaterialIndices out;
  for (const EncodedMaterial& one : materials) {
    if (one.slice.triangles > 0) out.emplace(one.first_label, 0);
  }
  int next = 0;
  for (auto& [first_label, index] : out)
    index = next++;
  return out;
}

// The slices with the indices of their materials.
std::vector<EncodedSlice> take_slices(std::vector<EncodedMaterial>& materials,
                                      const MaterialIndices& indices) {
  std::vector<EncodedSlice> out;
  for (EncodedMaterial& one : materials) {
    if (one.slice.triangles > 0) one.slice.material = indices.at(one.first_label);
    out.push_back(std::move(one.slice));
  }
  return out;
}

// The set of joined labels that contains the label; null if the label is not joined.
const std::set<int>* joined_with(const Labels& wanted, int label) {
  const auto found =
      std::find_if(wanted.joined.begin(), wanted.joined.end(),
                   [label](const std::set<int>& one) { return one.contains(label); });
  return found == wanted.joined.end() ? nullptr : &*found;
}

// Returns the `labels` that belong to a material that is missing from `indices`.
std::set<int> labels_without_material(const std::set<int>& labels, const Labels& wanted,
                                      const MaterialIndices& indices) {
  std::set<int> out;
  for (const int label : labels) {
    const std::set<int>* const joined = joined_with(wanted, label);
    if (!indices.contains(joined == nullptr ? label : *joined->begin())) out.insert(label);
  }
  return out;
}

void warn_of_labels(const Run& run, const Collected& all, const MaterialIndices& indices,
                    json& warnings) {
  const Labels& wanted = *run.labels();
  const auto warn = [&](const char* code, const std::set<int>& labels, const char* sentence) {
    if (labels.empty()) return;
    warnings.push_back({{"code", code},
                        {"where", run.options.names.list(labels)},
                        {"sentence", sentence},
                        {"labels", labels}});
  };
  std::set<int> absent = wanted.all ? std::set<int>() : wanted.labels;
  for (const int label : all.labels)
    absent.erase(label);
  warn("label_absent", absent, "not in the slices that were meshed");
  warn("label_dropped", labels_without_material(all.labels, wanted, indices),
       "all of its components are smaller than --min-region");
}

void add_warnings(const std::vector<Warning>& added, json& warnings) {
  for (json& warning : warnings_json(added, {}))
    warnings.push_back(std::move(warning));
}

json slices_report(std::vector<EncodedMaterial>& materials, const Asset& asset,
                   const MaterialIndices& indices) {
  json out = json::array();
  for (EncodedMaterial& one : materials) {
    json& slice = out.emplace_back(json::from_cbor(std::exchange(one.report, {})));
    if (asset.materials.size() > 1 && slice["triangles"] > 0)
      slice["material"] =
          asset.materials[static_cast<std::size_t>(indices.at(one.first_label))].name;
  }
  return out;
}

json labels_report(const Run& run, const std::set<int>& labels) {
  json out = json::array();
  for (const int label : labels)
    out.push_back({{"label", label}, {"name", run.options.names.name_of(label)}});
  return out;
}

// The sums of changes_report() over all slices, and of their areas.
json sums_of_changes(const Collected& all) {
  json out = {{"area_mm2", all.area_mm2}};
  for (const ChangedSlice& one : all.changed) {
    const json of_slice = changes_report(one.changes);
    for (const auto& [name, mm2] : of_slice.items())
      out[name] = out.value(name, 0.0) + mm2.get<double>();
  }
  return out;
}

json solid_report(const SolidBone& solid) {
  return {{"filled_mm3", solid.filled_mm3()}, {"dropped_mm3", solid.dropped_mm3()}};
}

// The values of the slices within the crop.
struct Values {
  ValueTally tally;
  bool has_material = false;  // the segmentation finds material
  bool has_wanted = false;    // some of it is left by ScannerTable and SolidBone

  bool is_label_map() const {
    return !tally.has_fractions && !tally.has_inexact && tally.values.size() <= kMaxLabels;
  }
  // The labels, if the values are those of a label map.
  std::set<int> labels() const {
    std::set<int> out = tally.values;
    out.erase(0);
    return out;
  }
};

bool holds_material(const Field& field) {
  return std::any_of(field.image.values.begin(), field.image.values.end(),
                     [&field](float value) { return value >= field.iso; });
}

Result<Values> read_values(const SliceStack& stack, int first, int last,
                           const MeshOptions& options) {
  Values found;
  for (int k = first; k <= last; ++k) {
    auto pixels = read_cropped(stack, k, options);
    if (!pixels) return pixels.error();
    found.tally.add(tally_values(*pixels, true));
    found.has_material |=
        holds_material(segment(*pixels, stack.pixel_unit(), options.segmentation));
    found.has_wanted |= holds_material(slice_field(stack, k, options, std::move(*pixels)).field);
  }
  return found;
}

std::string input_text(const SliceStack& stack, int first, int last) {
  std::set<int> slices;
  for (int k = first; k <= last; ++k)
    slices.insert(k);
  const std::string input = input_name(stack);
  return input + (input.empty() ? "" : ", ") + named_ranges("slice", slices);
}

std::string reason(const Values& found, const MeshOptions& options, const LabelNames& names) {
  if (found.has_wanted)
    return "all components of material are smaller than --min-region " +
           text_of(options.min_region_mm2) + " mm^2";
  if (found.has_material)
    return options.solid == nullptr
               ? "the material there belongs to the scanner's table, which is left out"
               : "the material there is left out by the option that keeps a part of the material "
                 "(--min-volume, --keep, --mask, --seed or --largest)";
  if (const auto* threshold = std::get_if<Threshold>(&options.segmentation))
    return "nothing is at or above the threshold of " + text_of(threshold->value);
  if (const auto* paper = std::get_if<Equalize>(&options.segmentation))
    return "nothing is at or above the level of " + text_of(paper->level) + " after equalisation";
  const auto& [wanted, all, joined] = std::get<Labels>(options.segmentation);
  if (all) return "nothing is labelled";
  return "the " + names.list(wanted) + (wanted.size() == 1 ? " is" : " are") + " not there";
}

std::string values_text(const Values& found, const SliceStack& stack, bool as_labels,
                        const LabelNames& names) {
  std::string out = "the values found are ";
  out += found.tally.low == found.tally.high
             ? "all " + text_of(found.tally.low, 10)
             : text_of(found.tally.low, 10) + " to " + text_of(found.tally.high, 10);
  if (as_labels) {
    return out + (found.labels().empty() ? ", so there is no label"
                                         : ", the " + names.list(found.labels()));
  }
  if (stack.pixel_unit() == PixelUnit::kUncalibrated) return out + " (" + stack.modality + ")";
  return out + (stack.pixel_unit() == PixelUnit::kHounsfield ? " HU" : " (grey levels)");
}

// Advice for the user; empty if there is none.
std::string advice(const Values& found, const SliceStack& stack, bool as_labels,
                   const MeshOptions& options) {
  constexpr double kBone = Threshold{}.value;
  const bool is_hu = stack.pixel_unit() == PixelUnit::kHounsfield;
  if (!as_labels && std::holds_alternative<Labels>(options.segmentation))
    return "it without --labels (this is no label map)";
  if (found.has_wanted) return "a smaller --min-region";
  if (found.has_material)
    return options.solid == nullptr ? "--keep-table" : "it without this option";
  if (as_labels && !found.labels().empty())
    return "--labels " + number_ranges(found.labels(), ",") + " or some of these";
  if (std::holds_alternative<Equalize>(options.segmentation) && found.tally.low < found.tally.high)
    return "a lower --equalize";
  if (found.tally.low < found.tally.high && !as_labels) {
    return is_hu && found.tally.low < kBone && kBone <= found.tally.high
               ? "--threshold " + text_of(kBone)
               : "a --threshold from " + text_of(found.tally.low) + " to " +
                     text_of(found.tally.high);
  }
  return "";
}

// Makes Asset::materials: one entry for each entry of `indices`, in the same order.
std::vector<AssetMaterial> asset_materials(const LabelNames& names, const Labels& wanted,
                                           const MaterialIndices& indices) {
  std::vector<AssetMaterial> out;
  for (const auto& [first_label, index] : indices) {
    AssetMaterial& material = out.emplace_back();
    material.name = material_name(names, wanted, first_label);
    if (joined_with(wanted, first_label) == nullptr) material.label = first_label;
  }
  return out;
}

// Returns one segmentation for each entry of `indices`, in the same order. Each segmentation
// selects only the pixels of its material. If `segmentation` is not Labels, returns `segmentation`
// alone.
std::vector<Segmentation> material_segmentations(const Segmentation& segmentation,
                                                 const MaterialIndices& indices) {
  const auto* const wanted = std::get_if<Labels>(&segmentation);
  if (wanted == nullptr) return {segmentation};
  std::vector<Segmentation> out;
  for (const auto& [first_label, index] : indices) {
    const std::set<int>* const joined = joined_with(*wanted, first_label);
    out.emplace_back(Labels{joined == nullptr ? std::set{first_label} : *joined});
  }
  return out;
}

// The largest distance of a vertex from the edge of the image's outermost pixels, where contours
// end.
double margin_mm(const MeshOptions& options) {
  const double step_mm = options.lattice.step_mm();  // allows for rounding to the lattice
  return std::max(options.simplification.tolerance_mm, kMaxDistanceFromOutline_steps * step_mm) +
         step_mm;
}

// Returns the grid to which Draco quantises the vertices of the slices `first` to `last`, both
// included. It covers the image of these slices, or the crop of the image, and a margin. It
// therefore contains every vertex. Errors: those of asset_grid().
Result<DracoGrid> encoding_grid(const SliceStack& stack, int first, int last,
                                const MeshOptions& options) {
  const Crop c = options.crop.value_or(Crop{0, stack.width() - 1, 0, stack.height() - 1});
  const double beyond = margin_mm(options);
  Eigen::AlignedBox2d box;  // mm
  for (int k = first; k <= last; ++k) {
    const SlicePlane& plane = stack.plane(k);
    const double u = plane.spacing_u_mm, v = plane.spacing_v_mm;
    const Eigen::Vector2d margin(0.5 * u + std::max(0.5 * u, beyond),
                                 0.5 * v + std::max(0.5 * v, beyond));
    box.extend(Eigen::Vector2d(c.x0 * u, c.y0 * v) - margin);
    box.extend(Eigen::Vector2d(c.x1 * u, c.y1 * v) + margin);
  }
  LatticeBox lattice_box;
  const auto snapped = [&](double mm) {
    const double farthest = options.lattice.to_mm(kMaxCoordinate);
    return options.lattice.snap_mm(std::clamp(mm, -farthest, farthest));
  };
  lattice_box.low = {snapped(box.min().x()), snapped(box.min().y())};
  lattice_box.high = {snapped(box.max().x()), snapped(box.max().y())};
  return asset_grid(options.lattice, lattice_box);
}

}  // namespace

Result<void> check_ranges(const SliceStack& stack, const StackOptions& options) {
  if (options.slices) {
    const auto [a, b] = *options.slices;
    if (a < 0 || b < a || b >= stack.size()) {
      return usage("--slices " + std::to_string(a) + ":" + std::to_string(b) +
                   (b < a ? " ends before it begins; there are 0:" : " is outside 0:") +
                   std::to_string(stack.size() - 1));
    }
  }
  const bool is_in_hu = stack.pixel_unit() == PixelUnit::kHounsfield &&
                        !std::holds_alternative<Labels>(options.mesh.segmentation);
  const bool has_hu = is_in_hu || options.mesh.hu != nullptr;
  if (options.mesh.grade_hu > 0 && !is_in_hu)
    return usage("--grade needs a scan in HU: images, label maps and other modalities have none");
  if (options.colours && !has_hu)
    return usage("--colour needs HU: a scan in HU, or the CT of a label map (--hu)");
  if (options.context_mm && !has_hu)
    return usage("--context needs HU: a scan in HU, or the CT of a label map (--hu)");
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

Result<StackResult> mesh_stack(const SliceStack& stack, const StackOptions& given,
                               const json& parameters) {
  if (auto ok = check_ranges(stack, given); !ok) return ok.error();
  Run run{stack,
          given,
          given.slices ? given.slices->first : 0,
          given.slices ? given.slices->second : stack.size() - 1,
          given.threads > 0 ? given.threads : oneapi::tbb::info::default_concurrency(),
          RunStages(given.start)};
  StackOptions& options = run.options;
  options.names.add_defaults(stack.label_names);
  if (options.surface) options.surface->stop = options.stop;
  const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism,
                                          static_cast<std::size_t>(run.threads));
  std::optional<ScannerTable> table;
  if (!options.keep_table) table = ScannerTable::find(stack, options.mesh.segmentation);
  if (table) options.mesh.table = &*table;
  const auto solid = make_solid(run);
  if (!solid) return solid.error();
  if (*solid) options.mesh.solid = &**solid;
  run.sampling = hu_sampling(stack.plane(run.first), run.width(), run.height(), options.mesh);
  Result<DracoGrid> grid = encoding_grid(stack, run.first, run.last, options.mesh);
  if (grid) grid->colours = options.colours;

  auto finished = digest_and_mesh(run, grid);
  if (!finished) return finished.error();
  std::vector<std::string> file_digests;
  for (const auto& digest : finished->digests) {
    if (!digest) return digest.error();
    file_digests.push_back(*digest);
  }
  Collected all = collect(std::move(finished->slices));
  json used = used_parameters(run, parameters, all);
  for (SliceWarning& warning : change_warnings(all.changed, options.mesh.min_region_mm2,
                                               options.mesh.simplification.tolerance_mm))
    all.warnings.push_back(std::move(warning));
  json warnings =
      run_warnings(stack, options.mesh.segmentation, all.values, all.area_mm2, all.warnings);
  if (table) add_warnings(table->warnings(), warnings);
  if (*solid) add_warnings((*solid)->warnings(), warnings);

  StackResult out;
  out.stages = std::move(all.stages);
  Asset asset{options.mesh.lattice, {}, "trocar-mesh " TROCAR_VERSION, json_text(used)};
  asset.lines = options.lines;
  asset.colours = options.colours;
  if (!options.input_key.empty())
    out.input_key_digest = asset.input_key_digest = digest_input(file_digests, options.input_key);
  const MaterialIndices indices = material_indices(all.materials);
  if (indices.empty())
    return empty_asset_error(stack, run.first, run.last, options.mesh, options.names);
  if (const Labels* labels = run.labels()) {
    asset.materials = asset_materials(options.names, *labels, indices);
    warn_of_labels(run, all, indices, warnings);
    if (asset.materials.size() > kMaxMaterials)
      return refused(input_name(stack) + ": more than " + std::to_string(kMaxMaterials) +
                     " labels; join some to one material, as --labels 1-20+21");
  }
  if (auto ok = check_entry_count(all.materials.size()); !ok)
    return ok.error().after(input_name(stack) + ": ");
  if (auto ok = limit_hu(run, all, warnings); !ok) return ok.error();
  std::vector<EncodedSlice> encoded = take_slices(all.materials, indices);
  json surface;
  run.stages.lap("collect");
  if (options.surface) {
    auto added =
        add_surfaces(stack, run.first, run.last, options.mesh, *options.surface,
                     material_segmentations(options.mesh.segmentation, indices), asset, warnings);
    if (!added) return added.error();
    surface = std::move(*added);
    run.stages.lap("surface");
  }
  const auto volumes = hu_volumes(run, std::move(all.hu));
  if (!volumes) return volumes.error();
  run.stages.lap("collect");
  AssetSizes sizes;
  auto glb = assemble_asset(asset, std::move(encoded), &sizes, *volumes);
  if (!glb) return glb.error();
  out.glb = std::move(*glb);
  run.stages.lap("assemble");

  json slices = slices_report(all.materials, asset, indices);
  run.stages.lap("collect");
  out.report = {{"schema", "trocar.report/1"},
                {"program", "trocar-mesh " TROCAR_VERSION},
                {"parameters", std::move(used)},
                {"slices", std::move(slices)},
                {"changes", sums_of_changes(all)},
                {"asset", asset_report(sizes, out.glb.size())},
                {"assemble_ms", run.stages.ms().at("assemble")},
                {"stages_ms", run.stages.ms()},
                {"total_ms", Stopwatch(options.start).lap_ms()},
                {"threads", run.threads},
                {"peak_rss_bytes", peak_rss_bytes()},
                {"warnings", std::move(warnings)}};
  if (run.labels() != nullptr) out.report["labels"] = labels_report(run, all.labels);
  if (*solid) out.report["solid"] = solid_report(**solid);
  if (options.surface) {
    out.report["surface"] = std::move(surface);
    out.report["asset"]["surface_bytes"] = sizes.surface_bytes;
    out.surfaces = std::move(asset.surfaces);
  }
  return out;
}

Error empty_asset_error(const SliceStack& stack, int first, int last, const MeshOptions& options,
                        const LabelNames& names) {
  const auto found = read_values(stack, first, last, options);
  if (!found) return found.error();
  // Without --labels, a scan counts as a label map only if it has no value below 0; a CT has such
  // values.
  const bool as_labels = found->is_label_map() &&
                         (std::holds_alternative<Labels>(options.segmentation) ||
                          (stack.pixel_unit() == PixelUnit::kHounsfield && found->tally.low >= 0));
  std::string tries = advice(*found, stack, as_labels, options);
  const auto add = [&tries](bool applies, const char* what) {
    if (applies) tries += (tries.empty() ? "" : ", or ") + std::string(what);
  };
  add(options.crop.has_value(), "a larger --crop");
  add(first > 0 || last + 1 < stack.size(), "other --slices");
  add(tries.empty(), "another scan");
  return refused(input_text(stack, first, last) + ": " + reason(*found, options, names) + "; " +
                 values_text(*found, stack, as_labels, names) + "; try " + tries);
}

std::string material_name(const LabelNames& names, const Labels& wanted, int first_label) {
  const std::set<int>* const joined = joined_with(wanted, first_label);
  if (joined == nullptr) return names.name_of(first_label);
  std::string out;
  std::size_t left = joined->size();
  for (const int label : *joined) {
    constexpr std::size_t kForMore = 16;  // space for " + 65535 more"
    const std::string name = (out.empty() ? "" : " + ") + names.name_of(label);
    if (!out.empty() && out.size() + name.size() + (left > 1 ? kForMore : 0) > kMaxNameBytes)
      return out + " + " + std::to_string(left) + " more";
    out += name;
    --left;
  }
  return out;
}

}  // namespace trocar::pipeline
