// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/arguments.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <sstream>
#include <utility>

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

// Adds the labels of a list of L and A-B with commas between.
Result<void> add_labels(const std::string& list, std::set<int>& labels) {
  constexpr int kMostOfRange = 65536;
  const Error wrong = usage("--labels " + list +
                            ": must be all, or labels L and ranges A-B with commas between them");
  const char *at = list.data(), *const end = at + list.size();
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
    if (rest != end && *rest != ',') return wrong;
    if (last < first) return usage("--labels " + list + ": a range ends before it begins");
    if (static_cast<std::int64_t>(last) - first >= kMostOfRange)
      return usage("--labels " + list + ": a range has more than 65536 labels");
    for (std::int64_t label = first; label <= last; ++label)
      labels.insert(static_cast<int>(label));
    if (rest == end) return {};
    at = rest + 1;
  }
}

// The option may be given several times.
Result<Labels> labels(const std::vector<std::string>& lists) {
  Labels out;
  for (const std::string& list : lists) {
    if (list == "all") {
      out.all = true;
    } else if (auto ok = add_labels(list, out.labels); !ok) {
      return ok.error();
    }
  }
  return out;
}

Result<Segmentation> segmentation(const Arguments& a, bool paper) {
  if (a.labels_given->count() > 0) {
    if (a.threshold_given->count() + a.equalize_given->count() > 0 || paper)
      return usage("--labels cannot be combined with --threshold, --equalize or --preset paper");
    auto wanted = labels(a.labels);
    if (!wanted) return wanted.error();
    return Segmentation(std::move(*wanted));
  }
  if (a.equalize_given->count() > 0 || paper) {
    if (a.threshold_given->count() > 0)
      return usage("--threshold and --equalize (or --preset paper) exclude each other");
    return Segmentation(Equalize{a.equalize});
  }
  return Segmentation(Threshold{a.threshold});
}

// Options of the stages, in their order.
void add_stage_options(CLI::App& app, Arguments& a) {
  a.threshold_given = app.add_option("--threshold", a.threshold,
                                     "iso-value in HU; on images 0..255, also with 16 bits")
                          ->capture_default_str()
                          ->check(CLI::Range(-1e6, 1e6));
  a.equalize_given =
      app.add_option("--equalize", a.equalize, "histogram equalisation, then this level")
          ->capture_default_str()
          ->check(CLI::Range(0.0, 255.0));
  a.labels_given =
      app.add_option("--labels", a.labels, "of a label map; material is L, A-B, several, or all")
          ->allow_extra_args(false);
  a.contour_given = app.add_option("--contour", a.contour, "iso-contour or pixel chains")
                        ->capture_default_str()
                        ->check(CLI::IsMember({"subpixel", "pixel"}));
  app.add_option("--tolerance", a.tolerance_mm, "Douglas-Peucker tolerance, mm")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1e4));
  app.add_option("--min-angle", a.min_angle_deg, "smallest angle, degrees")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 60.0));
  a.area_given = app.add_option("--max-area", a.max_area_mm2, "largest triangle, mm^2")
                     ->capture_default_str()
                     ->check(CLI::Range(1e-6, 1e12));
  app.add_option("--min-region", a.min_region_mm2, "drop smaller islands, fill smaller holes, mm^2")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1e12));
}

// Options that select a part of the scan, its spacing and its axis.
void add_scan_options(CLI::App& app, Arguments& a) {
  app.add_option("--spacing", a.spacing, "X,Y,Z in mm, where the input has none");
  app.add_option("--slices", a.slices, "A:B, first and last slice, from 0");
  app.add_option("--crop", a.crop, "X0:X1,Y0:Y1, first and last pixel, from 0");
  app.add_option("--series", a.series, "SeriesInstanceUID, of several in a folder");
  app.add_option("--axis", a.axis, "slices of a volume: transverse, coronal or sagittal")
      ->capture_default_str()
      ->check(CLI::IsMember({"transverse", "coronal", "sagittal"}));
}

}  // namespace

void add_mesh_options(CLI::App& app, Arguments& a) {
  app.add_option("INPUT", a.inputs, "the scan");
  app.add_option("-o,--output", a.output, "the asset to write (.glb)");
  add_stage_options(app, a);
  add_scan_options(app, a);
  app.add_option("--preset", a.preset, "paper: equalise, pixel chains, 30 degrees, 200 px^2")
      ->check(CLI::IsMember({"paper"}));
  app.add_option("--lattice-bits", a.lattice_bits, "lattice step 2^-N mm")
      ->capture_default_str()
      ->check(CLI::Range(kMinLatticeBits, kMaxLatticeBits));
  app.add_option("--jobs", a.jobs, "threads; 0 is all cores")
      ->capture_default_str()
      ->check(CLI::Range(0, 1024));
  app.add_option("--report", a.report, "what was done, as JSON");
  app.add_option("--dump-stages", a.dump_stages, "stages of --dump-slice, as JSON for pictures");
  a.dump_slice_given = app.add_option("--dump-slice", a.dump_slice, "the slice of --dump-stages")
                           ->check(CLI::NonNegativeNumber);
  app.add_flag("--quiet", a.quiet, "print errors only");
}

Result<BatchOptions> batch_options(const Arguments& a) {
  // CLI11 2.1 accepts nan in every range.
  for (const auto& [name, value] :
       {std::pair{"--threshold", a.threshold}, std::pair{"--equalize", a.equalize},
        std::pair{"--tolerance", a.tolerance_mm}, std::pair{"--min-angle", a.min_angle_deg},
        std::pair{"--max-area", a.max_area_mm2}, std::pair{"--min-region", a.min_region_mm2}}) {
    if (!std::isfinite(value)) return usage(std::string(name) + ": not a finite number");
  }
  BatchOptions out;
  const bool paper = a.preset == "paper";
  auto how = segmentation(a, paper);
  if (!how) return how.error();
  out.mesh.segmentation = std::move(*how);
  const bool pixel = a.contour_given->count() > 0 ? a.contour == "pixel" : paper;
  out.mesh.contour = pixel ? ContourKind::kPixel : ContourKind::kSubpixel;
  out.mesh.simplification.tolerance_mm = a.tolerance_mm;
  out.mesh.refinement.min_angle_deg = a.min_angle_deg;
  out.mesh.refinement.max_area_mm2 = a.max_area_mm2;
  if (paper && a.area_given->count() == 0) out.mesh.max_area_px2 = 200;
  out.mesh.min_region_mm2 = a.min_region_mm2;
  out.mesh.lattice.bits = a.lattice_bits;
  out.threads = a.jobs;
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
  if ((a.dump_slice_given->count() > 0) == a.dump_stages.empty())
    return usage("--dump-slice and --dump-stages go together: which slice, and the file for it");
  if (a.dump_slice_given->count() > 0) out.dump_slice = a.dump_slice;
  return out;
}

Result<OpenOptions> open_options(const Arguments& a) {
  OpenOptions out;
  out.series_uid = a.series;
  out.axis = a.axis == "coronal"    ? SliceAxis::kCoronal
             : a.axis == "sagittal" ? SliceAxis::kSagittal
                                    : SliceAxis::kTransverse;
  out.as_labels = a.labels_given->count() > 0;
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

json parameters_json(const BatchOptions& o, const OpenOptions& input) {
  json out = {{"contour", o.mesh.contour == ContourKind::kPixel ? "pixel" : "subpixel"},
              {"tolerance_mm", o.mesh.simplification.tolerance_mm},
              {"min_angle_deg", o.mesh.refinement.min_angle_deg},
              {"min_region_mm2", o.mesh.min_region_mm2},
              {"lattice_bits", o.mesh.lattice.bits}};
  if (o.mesh.max_area_px2) {
    out["max_area_px2"] = *o.mesh.max_area_px2;
  } else {
    out["max_area_mm2"] = o.mesh.refinement.max_area_mm2;
  }
  if (const auto* t = std::get_if<Threshold>(&o.mesh.segmentation)) out["threshold"] = t->value;
  if (const auto* e = std::get_if<Equalize>(&o.mesh.segmentation)) out["equalize"] = e->level;
  if (const auto* l = std::get_if<Labels>(&o.mesh.segmentation)) out["labels"] = l->labels;
  if (o.slices) out["slices"] = {o.slices->first, o.slices->second};
  if (o.mesh.crop)
    out["crop"] = {o.mesh.crop->x0, o.mesh.crop->x1, o.mesh.crop->y0, o.mesh.crop->y1};
  if (input.spacing_mm) out["spacing_mm"] = *input.spacing_mm;
  if (!input.series_uid.empty()) out["series"] = input.series_uid;
  if (input.axis != SliceAxis::kTransverse)
    out["axis"] = input.axis == SliceAxis::kCoronal ? "coronal" : "sagittal";
  return out;
}

}  // namespace trocar::pipeline
