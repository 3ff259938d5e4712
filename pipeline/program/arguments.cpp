// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/arguments.h"

#include <charconv>
#include <iterator>
#include <string_view>

#include "formats/base/command_line.h"
#include "formats/base/files.h"
#include "formats/base/text.h"
#include "pipeline/read/file_names.h"

namespace trocar::pipeline {
namespace {

using nlohmann::json;

struct Preset {
  std::string_view name, words;  // words: what the preset is for
  // The name of each option, such as "--threshold", and the option's value.
  std::vector<std::pair<std::string_view, std::string_view>> options;
};

bool gives(const std::vector<std::string>& words, std::string_view option) {
  return std::any_of(words.begin(), words.end(), [option](const std::string& word) {
    return word.starts_with(option) && (word.size() == option.size() || word[option.size()] == '=');
  });
}

std::span<const Preset> presets() {
  static const std::vector<Preset> all{
      {"bone",
       "dense bone (cortical and dense cancellous), just as the threshold gives it",
       {{"--threshold", "226"}}},
      {"solid-bone",
       "bone with its inside filled and small specks dropped; canals and sinuses stay open",
       {{"--threshold", "226"}, {"--close", "3"}, {"--fill", "2500"}, {"--min-volume", "100"}}},
      {"vertebra",
       "like solid-bone with a lower threshold, which also suits vertebrae of low density",
       {{"--threshold", "180"}, {"--close", "3"}, {"--fill", "2500"}, {"--min-volume", "100"}}},
      {"column",
       "like vertebra, but the spinal column alone, without contrast-filled vessels",
       {{"--threshold", "180"},
        {"--close", "3"},
        {"--fill", "2500"},
        {"--min-volume", "100"},
        {"--keep", "column"}}},
      {"skin",
       "the surface of the body without the CT table; air inside the body is not filled",
       {{"--threshold", "-300"}, {"--fill", "all"}, {"--min-volume", "1000"}, {"--largest", "1"}}},
      {"paper",
       "the published method: equalised histogram, and outlines along pixel centres;\n"
       "  triangles with angles of at least 30 degrees, and of at most 200 pixels",
       {{"--equalize", "230"},
        {"--contour", "pixel"},
        {"--simplify", "dp"},
        {"--min-angle", "30"},
        {"--max-area-px", "200"}}},
  };
  return all;
}

const Preset* find_preset(std::string_view name) {
  const auto all = presets();
  const auto at =
      std::find_if(all.begin(), all.end(), [name](const Preset& p) { return p.name == name; });
  return at == all.end() ? nullptr : &*at;
}

// The options of the preset that the words do not give themselves.
std::vector<std::pair<std::string_view, std::string_view>> added(
    const std::vector<std::string>& words) {
  std::string name;
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (words[i].starts_with("--preset=")) name = words[i].substr(std::string("--preset=").size());
    if (words[i] == "--preset" && i + 1 < words.size()) name = words[i + 1];
  }
  std::vector<std::pair<std::string_view, std::string_view>> out;
  const Preset* preset = find_preset(name);
  if (preset == nullptr) return out;
  std::copy_if(preset->options.begin(), preset->options.end(), std::back_inserter(out),
               [&words](const auto& each) {
                 const bool other_unit =
                     each.first == "--max-area-px" && gives(words, "--max-area");
                 return !gives(words, each.first) && !other_unit;
               });
  return out;
}

// Reads a list such as "7,20-24" into `labels`. If `joined` is not null, + joins labels, as in
// "20+21", to a set of it, which is one material. Returns why the list is wrong.
std::string read_labels(const std::string& list, std::set<int>& labels,
                        std::vector<std::set<int>>* joined = nullptr) {
  constexpr int kMaxOfRange = 65536;
  const auto is_outside = [](std::errc error, int label) {
    return error == std::errc::result_out_of_range || (error == std::errc() && label < 0);
  };
  std::string wrong =
      std::string("must be all, or labels L and ranges A-B with commas between them") +
      (joined == nullptr ? "" : ", or with + to join them");
  std::string outside = "labels are 0 to " + std::to_string(kMaxLabel);
  const char *at = list.data(), *const end = at + list.size();
  bool after_plus = false;
  while (true) {
    int first = 0;
    auto [rest, error] = std::from_chars(at, end, first);
    if (is_outside(error, first)) return outside;
    if (error != std::errc()) return wrong;
    int last = first;
    if (rest != end && *rest == '-') {
      const auto range = std::from_chars(rest + 1, end, last);
      if (is_outside(range.ec, last)) return outside;
      if (range.ec != std::errc()) return wrong;
      rest = range.ptr;
    }
    const bool before_plus = joined != nullptr && rest != end && *rest == '+';
    if (rest != end && *rest != ',' && !before_plus) return wrong;
    if (last < first) return "a range ends before it begins";
    if (static_cast<std::int64_t>(last) - first >= kMaxOfRange)
      return "a range has more than 65536 labels";
    if (before_plus && !after_plus) joined->emplace_back();
    for (std::int64_t label = first; label <= last; ++label) {
      if (!before_plus && !after_plus)
        labels.insert(static_cast<int>(label));
      else if (!joined->back().insert(static_cast<int>(label)).second)
        return "label " + std::to_string(label) + " is joined to itself";
    }
    if (rest == end) return {};
    after_plus = before_plus;
    at = rest + 1;
  }
}

void add_input_options(CLI::App& app, Arguments& a) {
  app.add_option("INPUT", a.inputs, "the scan");
  const auto spacing = [&a](const std::string& text) {
    const auto n = numbers<double>(text, "#,#,#");
    if (!n) return "must be X,Y,Z in mm";
    for (const double mm : *n)
      if (!(mm > 1e-6 && mm < 1e6)) return "each must lie between 1e-6 and 1e6 mm";
    a.open.spacing_mm = {(*n)[0], (*n)[1], (*n)[2]};
    return "";
  };
  add_parsed(
      app, "--spacing", spacing,
      "pixel width, pixel height and distance of slices, in mm; for INPUT that does not state\n"
      "them",
      "X,Y,Z");
  const auto slices = [&a](const std::string& text) {
    const auto n = numbers<int>(text, "#:#");
    if (!n) return "must be A:B, first and last slice";
    a.stack.slices = std::pair{(*n)[0], (*n)[1]};
    return "";
  };
  add_parsed(app, "--slices", slices, "mesh only the slices A to B, both included, counted from 0",
             "A:B");
  const auto crop = [&a](const std::string& text) {
    const auto n = numbers<int>(text, "#:#,#:#");
    if (!n) return "must be X0:X1,Y0:Y1, first and last pixel";
    a.stack.mesh.crop = Crop{(*n)[0], (*n)[1], (*n)[2], (*n)[3]};
    return "";
  };
  add_parsed(app, "--crop", crop,
             "mesh only the columns X0 to X1 and rows Y0 to Y1, all included, counted from 0",
             "X0:X1,Y0:Y1");
  app.add_option(
         "--series", a.open.series,
         "if INPUT holds several series: the one to mesh, by its UID, number or description")
      ->type_name("SERIES");
  add_number(
      app, "--volume", a.open.volume, {0, 1'000'000'000, "N"},
      "for a NIfTI or NRRD file (4D) or a DICOM series with several volumes: the one to mesh,\n"
      "counted from 0");
  app.add_flag("--any-modality", a.open.any_modality,
               "accept DICOM images other than CT, whose values are not HU");
  app.add_flag("--completeness-unknown", a.open.completeness_unknown,
               "nobody has said how many images the scan has: the report warns of it, and the\n"
               "asset says so");
  add_choice<std::optional<SliceAxis>>(app, "--axis", a.open.axis,
                                       {{"axial", SliceAxis::kAxial},
                                        {"transverse", SliceAxis::kAxial},
                                        {"coronal", SliceAxis::kCoronal},
                                        {"sagittal", SliceAxis::kSagittal}},
                                       "plane of the slices; transverse is axial (default: the "
                                       "stored one; of NIfTI and NRRD axial)");
  set_heading(app, "Input");
}

void add_material_options(CLI::App& app, Arguments& a) {
  std::vector<std::string> names;
  for (const Preset& preset : presets())
    names.emplace_back(preset.name);
  one_of(app.add_option("--preset", a.preset,
                        "the options that suit this material; --explain prints them"),
         names);
  app.add_flag("--explain", a.explain, "print the options of --preset, or of every preset");
  add_number(app, "--threshold", a.threshold, {-1e6, 1e6, "HU"},
             "lowest HU of the material (226: dense bone, 180: bone of low density, "
             "-300: skin), or of\n"
             "images a grey level from 0 to 255")
      ->default_str("226");
  add_number(app, "--equalize", a.equalize, {0, 255, "LEVEL"},
             "instead of --threshold: lowest grey level, 0 to 255, after equalisation "
             "of the histogram of\n"
             "each slice");
  const auto read = [&a](const std::string& list) -> std::string {
    if (!a.labels) a.labels.emplace();
    if (list != "all") return read_labels(list, a.labels->labels, &a.labels->joined);
    a.labels->all = true;
    return {};
  };
  CLI::Option* const labels = many(add_parsed(app, "--labels", read,
                                              "INPUT is a label map: mesh the labels L, such as "
                                              "20 or 20-24, or all, each as one material;\n"
                                              "20+21 joins two",
                                              "L"));
  app.add_option("--hu", a.hu, "CT of a label map, on the same grid of voxels, that gives the HU")
      ->type_name("CT")
      ->needs(labels);
  app.add_option("--names", a.names,
                 "names of the labels: JSON such as {\"20\": \"L1\"}, or verse or totalsegmentator")
      ->type_name("FILE")
      ->needs(labels);
  app.add_flag("--keep-table", a.stack.keep_table, "mesh the scanner's table, too");
  set_heading(app, "Material");
}

void add_solid_options(CLI::App& app, SolidOptions& solid) {
  const auto fill = [&solid](const std::string& text) {
    const auto n = numbers<double>(text, "#");
    if (!n && text != "all") return "must be an area in mm^2, or all";
    solid.fill_mm2 = n ? (*n)[0] : std::numeric_limits<double>::infinity();
    return !n || (*solid.fill_mm2 >= 0 && *solid.fill_mm2 <= 1e12)
               ? ""
               : "must be within 0 and 1e12 mm^2, or all";
  };
  add_parsed(
      app, "--fill", fill,
      "fill what bone encloses in two of the three planes, up to this area in a plane, mm^2; all:\n"
      "no limit. Canals stay open",
      "MM2");
  add_number(app, "--close", solid.close_mm, {0, 100, "MM"},
             "with --fill: gaps up to 2 x MM wide count as closed");
  add_number(app, "--min-volume", solid.min_volume_mm3, {0, 1e12, "MM3"},
             "drop pieces (connected components) of less than this volume, before --fill, mm^3");
  add_choice<bool>(app, "--keep", solid.column, {{"all", false}, {"column", true}},
                   "all bone; or, with --fill, the spinal column alone, without vessels full of "
                   "contrast medium")
      ->default_str("all");
  add_number(app, "--largest", solid.largest, {0, 1'000'000, "N"},
             "keep only the N largest components; 0: all");
  const auto seed = [&solid](const std::string& text) {
    const auto n = numbers<double>(text, "#,#,#");
    if (!n) return "must be X,Y,Z in mm";
    for (const double mm : *n)
      if (!(std::abs(mm) < 1e6)) return "each must lie within 1e6 mm";
    solid.seeds_lps_mm.emplace_back((*n)[0], (*n)[1], (*n)[2]);
    return "";
  };
  many(add_parsed(
      app, "--seed", seed,
      "keep only what is connected to this point, mm in DICOM's patient coordinates (LPS), and\n"
      "nearer to it than to the points of further --seed",
      "X,Y,Z"));
  const auto mask = [&solid](const std::string& text) -> std::string {
    const auto colon = text.rfind(':');
    if (colon == std::string::npos || colon == 0) return "must be LABELS.nii.gz:L[,L]";
    solid.mask_file = text.substr(0, colon);
    return read_labels(text.substr(colon + 1), solid.mask_labels);
  };
  add_parsed(app, "--mask", mask,
             "keep only material within 1.5 mm of the labels L of this label map",
             "LABELS.nii.gz:L[,L]");
  set_heading(app, "Solid bone");
}

void add_stage_options(CLI::App& app, StackOptions& stack) {
  MeshOptions& mesh = stack.mesh;
  add_choice<ContourKind>(
      app, "--contour", mesh.contour,
      {{"subpixel", ContourKind::kSubpixel}, {"pixel", ContourKind::kPixel}},
      "where the border runs: between pixel centres, where the interpolated value is the\n"
      "threshold, or through the centres of the outermost pixels")
      ->default_str("subpixel");
  add_choice<SimplificationMethod>(
      app, "--simplify", mesh.simplification.method,
      {{"area", SimplificationMethod::kArea}, {"dp", SimplificationMethod::kDouglasPeucker}},
      "outlines keep their area, or a subset of their vertices (Douglas and Peucker)")
      ->default_str("area");
  const CLI::Option* const tolerance = add_number(
      app, "--tolerance", mesh.simplification.tolerance_mm, {0, 1e4, "MM"},
      "largest distance of the simplified outline from the original, mm (pixels below 0.3 mm: at\n"
      "most 0.4 pixels)");
  const CLI::Option* const min_region = add_number(
      app, "--min-region", mesh.min_region_mm2, {0, 1e12, "MM2"},
      "drop islands and fill holes below this area in a slice, mm^2 (pixels below 0.3 mm: at most\n"
      "4 pixels)");
  add_number(app, "--min-angle", mesh.refinement.min_angle_deg, {0, 60, "DEG"},
             "smallest angle of a triangle, degrees");
  CLI::Option* const area = add_number(app, "--max-area", mesh.refinement.max_area_mm2,
                                       {1e-6, 1e12, "MM2"}, "largest area of a triangle, mm^2");
  add_number(app, "--max-area-px", mesh.max_area_px2, {1e-6, 1e12, "PX2"},
             "largest area of a triangle in pixels, instead of --max-area")
      ->excludes(area);
  add_number(app, "--grade", mesh.grade_hu, {0, 1e6, "HU"},
             "smaller triangles where the HU change by more than this along an edge; 0: never");
  const CLI::Option* const lattice = add_number(
      app, "--lattice-bits", mesh.lattice.bits, {kMinLatticeBits, kMaxLatticeBits, "N"},
      "coordinates are multiples of 2^-N mm (pixels below 0.25 mm: at least 64 steps a pixel)");
  set_heading(app, "Mesh");
  app.parse_complete_callback([&stack, tolerance, min_region, lattice] {
    stack.defaults = {tolerance->count() == 0, min_region->count() == 0, lattice->count() == 0};
  });
}

// Options of the asset. A preview accepts them without effect, so that the options of a run can be
// given to its preview, and hides them from its help.
void add_asset_options(CLI::App& app, const char* heading, Arguments& a) {
  CLI::Option* const no_hu =
      app.add_flag_callback(
             "--no-hu", [&a] { a.stack.mesh.hu_volume = false; }, "store no HU in the asset")
          ->group(heading);
  app.add_flag("--surface", a.surface,
               "add a closed surface of the material for display (trocar-mesh export --surface)");
  add_number(
      app, "--surface-triangles", a.surface_triangles, {100, 5'000'000, "N"},
      "largest number of its triangles, but for those against intersections (default: 50000,\n"
      "doubled until 99 % lies within half a voxel of the boundary)");
  app.add_flag("--lines", a.stack.lines, "also store the outlines as lines, for 3D viewers");
  app.add_flag("--colour", a.stack.colours, "also store HU as colours for 3D viewers")
      ->excludes(no_hu);
  const auto context = [&pitch = a.stack.context_mm](const std::string& text) {
    const auto n = numbers<double>(text, "#");
    if (!n && !text.empty()) return "must be MM, a length in mm, or nothing";
    pitch = n ? (*n)[0] : 0;
    return !n || (*pitch >= 1 && *pitch <= 20) ? "" : "must lie between 1 and 20 mm";
  };
  add_parsed(app, "--context", context,
             "also store the HU around the material every MM mm (default: 2 to 4 mm), for "
             "simulated X-ray\n"
             "pictures; of a head they can show the face",
             "[MM]")
      ->expected(0, 1)
      ->excludes(no_hu);
  app.add_option(
         "--input-key", a.input_key,
         "store a checksum of the input with the key in FILE, 16 to 64 bytes, by which its owners\n"
         "recognise the scan")
      ->type_name("FILE");
  set_heading(app, heading);
}

// The options that a run and its preview share; `output` is the help of -o.
void add_common_options(CLI::App& app, Arguments& a, const char* output) {
  add_input_options(app, a);
  add_material_options(app, a);
  add_solid_options(app, a.stack.solid);
  add_stage_options(app, a.stack);
  app.add_option("-o,--output", a.output, output)->type_name("FILE");
  add_number(app, "--jobs", a.stack.threads, {0, 1024, "N"},
             "number of threads; 0: one for each core");
  app.add_flag("--quiet", a.quiet, "print errors only");
  set_heading(app, "Output");
}

Result<Segmentation> segmentation(const Arguments& a) {
  if (!a.labels) {
    if (!a.equalize) return Segmentation(a.threshold ? Threshold{*a.threshold} : Threshold{});
    if (a.threshold)
      return usage("--threshold and --equalize (or presets with them) exclude each other");
    return Segmentation(Equalize{*a.equalize});
  }
  if (a.threshold || a.equalize)
    return usage("--labels cannot be combined with --threshold, --equalize or a preset");
  Labels out = *a.labels;
  for (const std::set<int>& joined : out.joined)
    for (const int label : joined)
      if (!out.labels.insert(label).second)
        return usage("--labels: label " + std::to_string(label) +
                     " is in two materials; name it once");
  return Segmentation(std::move(out));
}

Result<void> complete_solid(const StackOptions& stack) {
  const SolidOptions& solid = stack.solid;
  if (!solid.fill_mm2 && solid.close_mm > 0)
    return usage(
        "--close needs --fill MM2 or --fill all: it says which gaps count as closed there");
  if (!solid.fill_mm2 && solid.column)
    return usage("--keep column needs --fill MM2 or --fill all, which finds the spinal canal");
  const auto* const wanted = std::get_if<Labels>(&stack.mesh.segmentation);
  if (wanted == nullptr || !are_several(*wanted)) return {};
  if (stack.mesh.contour == ContourKind::kPixel)
    return usage(
        "--contour pixel leaves gaps between materials: join the labels with +, as --labels 20+21");
  return solid.fill_mm2 ? fill_of_several_error() : Result<void>();
}

// Only the labels of a mask are stored, because its file name may identify the patient.
void add_solid_parameters(const SolidOptions& o, json& out) {
  if (o.fill_mm2) {
    out["close_mm"] = o.close_mm;
    out["fill_mm2"] = std::isfinite(*o.fill_mm2) ? json(*o.fill_mm2) : json("all");
  }
  if (o.min_volume_mm3 > 0) out["min_volume_mm3"] = o.min_volume_mm3;
  if (o.column) out["keep"] = "column";
  if (o.largest > 0) out["largest"] = o.largest;
  for (const Eigen::Vector3d& seed : o.seeds_lps_mm)
    out["seeds_lps_mm"].push_back({seed.x(), seed.y(), seed.z()});
  if (!o.mask_labels.empty()) out["mask_labels"] = o.mask_labels;
}

// The name of the axis: "transverse" (for kAxial), "coronal" or "sagittal".
const char* axis_name(SliceAxis axis) {
  return axis == SliceAxis::kCoronal    ? "coronal"
         : axis == SliceAxis::kSagittal ? "sagittal"
                                        : "transverse";
}

}  // namespace

std::vector<std::string> with_preset_options(const std::vector<std::string>& words) {
  std::vector<std::string> out = words;
  // After "--" there are only inputs.
  auto end = std::find(out.begin(), out.end(), "--") - out.begin();
  for (const auto& [option, value] : added(words))
    out.insert(out.begin() + end++, std::string(option).append("=").append(value));
  return out;
}

std::set<std::string> added_by_preset(const std::vector<std::string>& words) {
  std::set<std::string> out;
  for (const auto& [option, value] : added(words))
    out.emplace(option);
  return out;
}

Result<std::string> explain_presets(const std::string& name) {
  std::vector<std::string> names;
  std::string out;
  for (const Preset& preset : presets()) {
    names.emplace_back(preset.name);
    if (!name.empty() && name != preset.name) continue;
    out.append(preset.name).append(":");
    for (const auto& [option, value] : preset.options)
      out.append(" ").append(option).append(" ").append(value);
    out.append("\n  ").append(preset.words).append("\n");
  }
  if (out.empty())
    return usage("--preset " + name + ": no such preset" + did_you_mean(name, names));
  return out;
}

void add_mesh_options(CLI::App& app, Arguments& a) {
  add_common_options(app, a, "the asset to write (.glb), or only its surface (.stl, .ply, .obj)");
  app.add_option("--report", a.report,
                 "write what was done in each slice, and the warnings, as JSON")
      ->type_name("FILE");
  add_asset_options(app, "Output", a);
  CLI::Option* const stages =
      app.add_option("--dump-stages", a.dump_stages,
                     "write contour, outline and mesh of --dump-slice as JSON, for pictures")
          ->type_name("FILE")
          ->group(kDiagnostics);
  CLI::Option* const slice =
      add_number(app, "--dump-slice", a.stack.dump_slice, {0, 1'000'000'000, "N"},
                 "the slice of --dump-stages, counted from 0")
          ->group(kDiagnostics);
  stages->needs(slice);
  slice->needs(stages);
}

void add_preview_options(CLI::App& app, Arguments& a) {
  add_common_options(
      app, a,
      "the preview to write: .png, a picture; or .html, a page with it and tables of areas,\n"
      "outlines and labels");
  add_number(
      app, "--count", a.count, {1, 100, "N"},
      "number of slices shown, evenly spread from the first to the last slice with material");
  set_heading(app, "Output");
  add_asset_options(app, "", a);
}

Result<void> complete(Arguments& a) {
  StackOptions& stack = a.stack;
  if (const auto ok = segmentation(a).into(stack.mesh.segmentation); !ok) return ok.error();
  if (const auto* wanted = std::get_if<Labels>(&stack.mesh.segmentation)) {
    a.open.as_labels = true;
    if (!wanted->all) a.open.labels = wanted->labels;
  }
  if (!a.names.empty()) {
    if (const auto ok = LabelNames::named(a.names).into(stack.names); !ok) return ok.error();
  }
  if (auto ok = complete_solid(stack); !ok) return ok;
  stack.defaults.close = a.of_preset.contains("--close");
  stack.defaults.min_volume = a.of_preset.contains("--min-volume");
  stack.mesh.hu_field = stack.colours;
  if (a.surface_triangles && !a.surface) return usage("--surface-triangles needs --surface");
  if (a.surface) {
    stack.surface.emplace();
    if (a.surface_triangles) stack.surface = SurfaceOptions{*a.surface_triangles, true};
  }
  if (a.input_key.empty()) return {};
  auto key = read_file(a.input_key, kMaxKeyBytes);
  if (!key) return key.error();
  if (key->size() < kMinKeyBytes)
    return usage("--input-key " + a.input_key.string() + ": has " + std::to_string(key->size()) +
                 " bytes; a key has 16 to 64");
  stack.input_key = std::move(*key);
  return {};
}

json parameters_json(const StackOptions& o, const OpenOptions& input) {
  json out = {{"contour", o.mesh.contour == ContourKind::kPixel ? "pixel" : "subpixel"},
              {"tolerance_mm", o.mesh.simplification.tolerance_mm},
              {"min_angle_deg", o.mesh.refinement.min_angle_deg},
              {"min_region_mm2", o.mesh.min_region_mm2},
              {"lattice_bits", o.mesh.lattice.bits}};
  if (o.mesh.simplification.method == SimplificationMethod::kArea) out["simplify"] = "area";
  if (!o.mesh.hu_volume) out["hu"] = false;
  if (o.mesh.grade_hu > 0) out["grade_hu"] = o.mesh.grade_hu;
  if (o.context_mm) out["context_mm"] = *o.context_mm;
  if (o.mesh.max_area_px2)
    out["max_area_px2"] = *o.mesh.max_area_px2;
  else
    out["max_area_mm2"] = o.mesh.refinement.max_area_mm2;
  if (const auto* t = std::get_if<Threshold>(&o.mesh.segmentation)) out["threshold"] = t->value;
  if (const auto* e = std::get_if<Equalize>(&o.mesh.segmentation)) out["equalize"] = e->level;
  if (const auto* l = std::get_if<Labels>(&o.mesh.segmentation)) {
    out["labels"] = l->labels;
    if (!l->joined.empty()) out["joined_labels"] = l->joined;
  }
  if (o.slices) out["slices"] = {o.slices->first, o.slices->second};
  if (o.mesh.crop)
    out["crop"] = {o.mesh.crop->x0, o.mesh.crop->x1, o.mesh.crop->y0, o.mesh.crop->y1};
  add_solid_parameters(o.solid, out);
  if (o.keep_table) out["keep_table"] = true;
  if (o.surface) out["surface_triangles"] = o.surface->triangles;
  if (input.spacing_mm) out["spacing_mm"] = *input.spacing_mm;
  if (input.volume) out["volume"] = *input.volume;
  if (input.axis) out["axis"] = axis_name(*input.axis);
  if (input.completeness_unknown) out["completeness"] = "unknown";
  return out;
}

}  // namespace trocar::pipeline
