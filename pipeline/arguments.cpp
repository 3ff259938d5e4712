// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/arguments.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <limits>
#include <sstream>
#include <utility>

#include "formats/base/file_io.h"
#include "pipeline/presets.h"

namespace trocar::pipeline {
namespace {

using nlohmann::json;

// The numbers in a text such as "A:B", "X,Y,Z" or "X0:X1,Y0:Y1". `pattern` has a # for each number;
// the text must match it completely. `like`: how it is called in the message.
template <typename T>
Result<std::vector<T>> numbers(const std::string& text, std::string_view pattern,
                               const std::string& option, const char* like) {
  std::vector<T> out;
  std::istringstream in(text);
  for (const char c : pattern) {
    if (c == '#') {
      T value{};
      if (!(in >> value)) break;
      out.push_back(value);
    } else if (in.get() != c) {
      break;
    }
  }
  if (in.fail() || in.peek() != std::char_traits<char>::eof() ||
      out.size() != static_cast<std::size_t>(std::count(pattern.begin(), pattern.end(), '#'))) {
    return usage(option + " " + text + ": must be " + like);
  }
  return out;
}

// Adds the labels of a list of L and A-B with commas between. If `joined` is given, labels may also
// have a + between them: each such set is added to it.
Result<void> add_labels(const std::string& option, const std::string& list, std::set<int>& labels,
                        std::vector<std::set<int>>* joined = nullptr) {
  constexpr int kMostOfRange = 65536;
  const std::string given = option + " " + list + ": ";
  const Error wrong =
      usage(given + "must be all, or labels L and ranges A-B with commas between them" +
            (joined == nullptr ? "" : ", or with + to join them"));
  const char *at = list.data(), *const end = at + list.size();
  bool after_plus = false;
  while (true) {
    int first = 0;
    auto [rest, error] = std::from_chars(at, end, first);
    if (error != std::errc()) return wrong;
    int last = first;
    if (rest != end && *rest == '-') {
      const auto range = std::from_chars(rest + 1, end, last);
      if (range.ec != std::errc()) return wrong;
      rest = range.ptr;
    }
    const bool before_plus = joined != nullptr && rest != end && *rest == '+';
    if (rest != end && *rest != ',' && !before_plus) return wrong;
    if (last < first) return usage(given + "a range ends before it begins");
    if (static_cast<std::int64_t>(last) - first >= kMostOfRange)
      return usage(given + "a range has more than 65536 labels");
    if (before_plus && !after_plus) joined->emplace_back();
    for (std::int64_t label = first; label <= last; ++label) {
      if (before_plus || after_plus) {
        if (!joined->back().insert(static_cast<int>(label)).second)
          return usage(given + "label " + std::to_string(label) + " is joined to itself");
      } else {
        labels.insert(static_cast<int>(label));
      }
    }
    if (rest == end) return {};
    after_plus = before_plus;
    at = rest + 1;
  }
}

// The option may be given several times.
Result<Labels> labels(const std::vector<std::string>& lists) {
  Labels out;
  for (const std::string& list : lists) {
    if (list == "all") {
      out.all = true;
    } else if (auto ok = add_labels("--labels", list, out.labels, &out.joined); !ok) {
      return ok.error();
    }
  }
  for (const std::set<int>& joined : out.joined) {
    for (const int label : joined) {
      if (!out.labels.insert(label).second)
        return usage("--labels: label " + std::to_string(label) +
                     " is in two materials; name it once");
    }
  }
  return out;
}

Result<Segmentation> segmentation(const Arguments& a) {
  if (a.labels_given->count() > 0) {
    if (a.threshold_given->count() + a.equalize_given->count() > 0)
      return usage("--labels cannot be combined with --threshold, --equalize or a preset");
    auto wanted = labels(a.labels);
    if (!wanted) return wanted.error();
    return Segmentation(std::move(*wanted));
  }
  if (a.equalize_given->count() > 0) {
    if (a.threshold_given->count() > 0)
      return usage("--threshold and --equalize (or presets with them) exclude each other");
    return Segmentation(Equalize{a.equalize});
  }
  return Segmentation(Threshold{a.threshold});
}

// Options of the stages, in their order.
void add_stage_options(CLI::App& app, Arguments& a) {
  a.threshold_given =
      app.add_option("--threshold", a.threshold,
                     "iso-value in HU: 226 dense bone, 180 bone of low density, -300 skin; "
                     "on images 0..255, also with 16 bits")
          ->capture_default_str()
          ->check(CLI::Range(-1e6, 1e6));
  a.equalize_given =
      app.add_option("--equalize", a.equalize, "histogram equalisation, then this level")
          ->capture_default_str()
          ->check(CLI::Range(0.0, 255.0));
  a.labels_given =
      app.add_option(
             "--labels", a.labels,
             "of a label map: L, A-B, several, or all, a material each; 20+21 joins two to one")
          ->allow_extra_args(false);
  a.contour_given = app.add_option("--contour", a.contour, "iso-contour or pixel chains")
                        ->capture_default_str()
                        ->check(CLI::IsMember({"subpixel", "pixel"}));
  app.add_option("--simplify", a.simplify, "collapse that keeps areas, or Douglas-Peucker")
      ->capture_default_str()
      ->check(CLI::IsMember({"area", "dp"}));
  app.add_option("--tolerance", a.tolerance_mm, "largest distance from the contour, mm")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1e4));
  app.add_option("--min-angle", a.min_angle_deg, "smallest angle, degrees")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 60.0));
  a.area_given = app.add_option("--max-area", a.max_area_mm2, "largest triangle, mm^2")
                     ->capture_default_str()
                     ->check(CLI::Range(1e-6, 1e12));
  a.area_px_given = app.add_option("--max-area-px", a.max_area_px2,
                                   "largest triangle in pixels of the slice, instead of mm^2")
                        ->check(CLI::Range(1e-6, 1e12));
  app.add_option("--grade", a.grade_hu,
                 "smaller triangles where HU change by more than this along an edge; 0: not")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1e6));
  app.add_option("--min-region", a.min_region_mm2, "drop smaller islands, fill smaller holes, mm^2")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1e12));
}

// Options of label maps.
void add_label_options(CLI::App& app, Arguments& a) {
  app.add_option("--names", a.names,
                 "of labels: a JSON file {\"20\": \"L1\"}, or verse or totalsegmentator");
  app.add_option("--hu", a.hu,
                 "the CT that the labels were made on, on the same grid: gives them a mean HU");
}

// Options of solid_bone.h.
void add_solid_options(CLI::App& app, Arguments& a) {
  app.add_option("--close", a.close_mm, "with --fill: gaps of up to twice this count as closed, mm")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 100.0));
  app.add_option("--fill", a.fill,
                 "fill what is enclosed in two of three slice directions by at most MM2, or all");
  app.add_option("--min-volume", a.min_volume_mm3, "drop pieces of less, mm^3; before --fill")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1e12));
  app.add_option("--largest", a.largest, "keep the N largest pieces; 0 keeps all")
      ->capture_default_str()
      ->check(CLI::Range(0, 1'000'000));
  app.add_option("--seed", a.seeds,
                 "X,Y,Z patient coordinates, mm: keep what is nearer to the first than to others")
      ->allow_extra_args(false);
  app.add_option("--mask", a.mask,
                 "LABELS.nii.gz:L[,L]: keep what is within 1.5 mm of these labels");
}

// Options of display_surface.h.
void add_surface_options(CLI::App& app, Arguments& a) {
  app.add_flag("--surface", a.surface, "add a closed surface to look at; see export --surface");
  a.surface_triangles_given =
      app.add_option("--surface-triangles", a.surface_triangles,
                     "of the surface, at most; the default is exceeded where the distance to the "
                     "material needs it")
          ->capture_default_str()
          ->check(CLI::Range(100, 5'000'000));
}

// Options that select a part of the scan, its spacing and its axis.
void add_scan_options(CLI::App& app, Arguments& a) {
  app.add_option("--spacing", a.spacing, "X,Y,Z in mm, where the input has none");
  app.add_option("--slices", a.slices, "A:B, first and last slice, from 0");
  app.add_option("--crop", a.crop, "X0:X1,Y0:Y1, first and last pixel, from 0");
  app.add_option("--series", a.series, "UID, number or description, of several in a folder");
  app.add_flag("--any-modality", a.any_modality,
               "take DICOM that is not CT; its values are not HU");
  a.axis_given = app.add_option("--axis", a.axis, "of a volume; else as stored, a NIfTI transverse")
                     ->check(CLI::IsMember({"transverse", "coronal", "sagittal"}));
}

Result<SolidOptions> solid_options(const Arguments& a) {
  SolidOptions out;
  out.close_mm = a.close_mm;
  out.min_volume_mm3 = a.min_volume_mm3;
  out.largest = a.largest;
  if (a.fill == "all") {
    out.fill_mm2 = std::numeric_limits<double>::infinity();
  } else if (!a.fill.empty()) {
    const auto n = numbers<double>(a.fill, "#", "--fill", "an area in mm^2, or all");
    if (!n) return n.error();
    if (!((*n)[0] >= 0 && (*n)[0] <= 1e12))
      return usage("--fill " + a.fill + ": must be within 0 and 1e12 mm^2, or all");
    out.fill_mm2 = (*n)[0];
  }
  if (a.close_mm > 0 && !out.fill_mm2)
    return usage(
        "--close needs --fill MM2 or --fill all: it says which gaps count as closed there");
  for (const std::string& seed : a.seeds) {
    const auto n = numbers<double>(seed, "#,#,#", "--seed", "X,Y,Z in mm");
    if (!n) return n.error();
    for (const double mm : *n)
      if (!(std::abs(mm) < 1e6)) return usage("--seed " + seed + ": each must lie within 1e6 mm");
    out.seeds_lps_mm.emplace_back((*n)[0], (*n)[1], (*n)[2]);
  }
  if (!a.mask.empty()) {
    const auto colon = a.mask.rfind(':');
    if (colon == std::string::npos || colon == 0)
      return usage("--mask " + a.mask + ": must be LABELS.nii.gz:L[,L]");
    out.mask_file = a.mask.substr(0, colon);
    if (auto ok = add_labels("--mask", a.mask.substr(colon + 1), out.mask_labels); !ok)
      return ok.error();
  }
  return out;
}

// What a run and its preview have in common.
void add_common_options(CLI::App& app, Arguments& a, const char* output) {
  app.add_option("INPUT", a.inputs, "the scan");
  app.add_option("-o,--output", a.output, output);
  add_stage_options(app, a);
  add_label_options(app, a);
  add_solid_options(app, a);
  add_surface_options(app, a);
  add_scan_options(app, a);
  app.add_flag("--no-hu", a.no_hu, "leave HU out of the asset");
  std::vector<std::string> names;
  for (const Preset& preset : presets())
    names.emplace_back(preset.name);
  app.add_option("--preset", a.preset, "a set of options; see --explain")
      ->check(CLI::IsMember(names));
  app.add_flag("--explain", a.explain, "print the options of --preset, or of all presets");
  app.add_option("--lattice-bits", a.lattice_bits, "lattice step 2^-N mm")
      ->capture_default_str()
      ->check(CLI::Range(kMinLatticeBits, kMaxLatticeBits));
  app.add_option("--jobs", a.jobs, "threads; 0 is all cores")
      ->capture_default_str()
      ->check(CLI::Range(0, 1024));
}

}  // namespace

void add_mesh_options(CLI::App& app, Arguments& a) {
  add_common_options(app, a, "the asset to write (.glb)");
  app.add_flag("--lines", a.lines, "also store the outlines as lines, for viewers");
  app.add_flag("--colour", a.colour,
               "also store HU as colours, -200 dark to 1848 light, for viewers");
  app.add_option("--input-key", a.input_key,
                 "a file of 16 to 64 bytes: store the input's digest with this key");
  app.add_option("--report", a.report, "what was done, as JSON");
  app.add_option("--dump-stages", a.dump_stages, "stages of --dump-slice, as JSON for pictures");
  a.dump_slice_given = app.add_option("--dump-slice", a.dump_slice, "the slice of --dump-stages")
                           ->check(CLI::NonNegativeNumber);
  app.add_flag("--quiet", a.quiet, "print errors only");
}

void add_preview_options(CLI::App& app, Arguments& a) {
  add_common_options(app, a, "the sheet to write (.png, or .html with the numbers as text)");
  app.add_option("--count", a.count, "slices shown, evenly spread over those with material")
      ->capture_default_str()
      ->check(CLI::Range(1, 100));
  app.add_flag("--quiet", a.quiet, "print errors only");
}

Result<BatchOptions> batch_options(const Arguments& a) {
  // CLI11 2.1 accepts nan in every range.
  for (const auto& [name, value] :
       {std::pair{"--threshold", a.threshold}, std::pair{"--equalize", a.equalize},
        std::pair{"--tolerance", a.tolerance_mm}, std::pair{"--min-angle", a.min_angle_deg},
        std::pair{"--max-area", a.max_area_mm2}, std::pair{"--max-area-px", a.max_area_px2},
        std::pair{"--min-region", a.min_region_mm2}, std::pair{"--close", a.close_mm},
        std::pair{"--min-volume", a.min_volume_mm3}, std::pair{"--grade", a.grade_hu}}) {
    if (!std::isfinite(value)) return usage(std::string(name) + ": not a finite number");
  }
  BatchOptions out;
  auto how = segmentation(a);
  if (!how) return how.error();
  if (a.labels_given->count() == 0) {
    if (!a.names.empty()) return usage("--names is for label maps: give --labels L, or all");
    if (!a.hu.empty())
      return usage(
          "--hu is the CT beside a label map: give --labels L, or all; other scans in HU "
          "need no CT beside them");
  }
  if (!a.names.empty()) {
    auto names = LabelNames::named(a.names);
    if (!names) return names.error();
    out.names = std::move(*names);
  }
  if (const auto* wanted = std::get_if<Labels>(&*how);
      wanted != nullptr && a.contour == "pixel" && are_several(*wanted))
    return usage(
        "--contour pixel leaves gaps between materials: join the labels with +, as --labels "
        "20+21");
  out.mesh.segmentation = std::move(*how);
  out.mesh.contour = a.contour == "pixel" ? ContourKind::kPixel : ContourKind::kSubpixel;
  out.mesh.simplification.tolerance_mm = a.tolerance_mm;
  out.mesh.simplification.method =
      a.simplify == "area" ? SimplificationMethod::kArea : SimplificationMethod::kDouglasPeucker;
  out.mesh.refinement.min_angle_deg = a.min_angle_deg;
  out.mesh.refinement.max_area_mm2 = a.max_area_mm2;
  if (a.area_px_given->count() > 0) {
    if (a.area_given->count() > 0) return usage("--max-area and --max-area-px exclude each other");
    out.mesh.max_area_px2 = a.max_area_px2;
  }
  auto solid = solid_options(a);
  if (!solid) return solid.error();
  if (const auto* wanted = std::get_if<Labels>(&out.mesh.segmentation);
      wanted != nullptr && solid->fill_mm2 && are_several(*wanted))
    return usage("--fill fills one material: join the labels with +, as --labels 20+21");
  out.solid = std::move(*solid);
  if (a.surface) {
    out.surface = SurfaceOptions{a.surface_triangles, a.surface_triangles_given->count() > 0};
  } else if (a.surface_triangles_given->count() > 0) {
    return usage("--surface-triangles needs --surface");
  }
  out.mesh.min_region_mm2 = a.min_region_mm2;
  out.mesh.lattice.bits = a.lattice_bits;
  out.mesh.hu_field = !a.no_hu;
  out.mesh.grade_hu = a.grade_hu;
  out.threads = a.jobs;
  out.lines = a.lines;
  if (a.colour && a.no_hu) return usage("--colour shows the HU that --no-hu leaves out");
  out.colours = a.colour;
  if (!a.input_key.empty()) {
    auto key = read_file(a.input_key, kMostKeyBytes);
    if (!key) return key.error();
    if (key->size() < kLeastKeyBytes)
      return usage("--input-key " + a.input_key.string() + ": has " + std::to_string(key->size()) +
                   " bytes; a key has 16 to 64");
    out.input_key = std::move(*key);
  }
  if (!a.slices.empty()) {
    const auto n = numbers<int>(a.slices, "#:#", "--slices", "A:B, first and last slice");
    if (!n) return n.error();
    out.slices = std::pair{(*n)[0], (*n)[1]};
  }
  if (!a.crop.empty()) {
    const auto n = numbers<int>(a.crop, "#:#,#:#", "--crop", "X0:X1,Y0:Y1, first and last pixel");
    if (!n) return n.error();
    out.mesh.crop = Crop{(*n)[0], (*n)[1], (*n)[2], (*n)[3]};
  }
  const bool has_dump_slice = a.dump_slice_given != nullptr && a.dump_slice_given->count() > 0;
  if (has_dump_slice == a.dump_stages.empty())
    return usage("--dump-slice and --dump-stages go together: which slice, and the file for it");
  if (has_dump_slice) out.dump_slice = a.dump_slice;
  return out;
}

Result<OpenOptions> open_options(const Arguments& a) {
  OpenOptions out;
  out.series = a.series;
  if (a.axis_given->count() > 0) {
    out.axis = a.axis == "coronal"    ? SliceAxis::kCoronal
               : a.axis == "sagittal" ? SliceAxis::kSagittal
                                      : SliceAxis::kTransverse;
  }
  out.any_modality = a.any_modality;
  out.as_labels = a.labels_given->count() > 0;
  auto wanted = labels(a.labels);
  if (!wanted) return wanted.error();
  if (!wanted->all) out.labels = std::move(wanted->labels);
  if (!a.spacing.empty()) {
    const auto n = numbers<double>(a.spacing, "#,#,#", "--spacing", "X,Y,Z in mm");
    if (!n) return n.error();
    for (const double mm : *n) {
      if (!(mm > 1e-6 && mm < 1e6))
        return usage("--spacing " + a.spacing + ": each must lie between 1e-6 and 1e6 mm");
    }
    out.spacing_mm = {(*n)[0], (*n)[1], (*n)[2]};
  }
  return out;
}

namespace {

// Of a mask only the labels are stored: its file's name could tell whose scan it is.
void add_solid_parameters(const SolidOptions& o, json& out) {
  if (o.fill_mm2) {
    out["close_mm"] = o.close_mm;
    out["fill_mm2"] = std::isfinite(*o.fill_mm2) ? json(*o.fill_mm2) : json("all");
  }
  if (o.min_volume_mm3 > 0) out["min_volume_mm3"] = o.min_volume_mm3;
  if (o.largest > 0) out["largest"] = o.largest;
  for (const Eigen::Vector3d& seed : o.seeds_lps_mm)
    out["seeds_lps_mm"].push_back({seed.x(), seed.y(), seed.z()});
  if (!o.mask_labels.empty()) out["mask_labels"] = o.mask_labels;
}

}  // namespace

json parameters_json(const BatchOptions& o, const OpenOptions& input) {
  json out = {{"contour", o.mesh.contour == ContourKind::kPixel ? "pixel" : "subpixel"},
              {"tolerance_mm", o.mesh.simplification.tolerance_mm},
              {"min_angle_deg", o.mesh.refinement.min_angle_deg},
              {"min_region_mm2", o.mesh.min_region_mm2},
              {"lattice_bits", o.mesh.lattice.bits}};
  if (o.mesh.simplification.method == SimplificationMethod::kArea) out["simplify"] = "area";
  if (!o.mesh.hu_field) out["hu"] = false;
  if (o.mesh.grade_hu > 0) out["grade_hu"] = o.mesh.grade_hu;
  if (o.mesh.max_area_px2) {
    out["max_area_px2"] = *o.mesh.max_area_px2;
  } else {
    out["max_area_mm2"] = o.mesh.refinement.max_area_mm2;
  }
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
  if (o.surface) out["surface_triangles"] = o.surface->triangles;
  if (input.spacing_mm) out["spacing_mm"] = *input.spacing_mm;
  if (input.axis) {
    out["axis"] = *input.axis == SliceAxis::kCoronal    ? "coronal"
                  : *input.axis == SliceAxis::kSagittal ? "sagittal"
                                                        : "transverse";
  }
  return out;
}

}  // namespace trocar::pipeline
