// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/preview/preview_text.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "pipeline/base/number_ranges.h"
#include "pipeline/read/file_names.h"

namespace trocar::pipeline {
namespace {

// A sentence about how much of a bone is filled at the distance between the slices. The figures were
// measured on vertebrae and ribs with expert masks, and on phantoms between them.
std::string fill_text(const Preview& preview) {
  if (!preview.is_filled || preview.slices < 2) return "";
  return " With slices " + number_text(preview.step_mm, 2) +
         " mm apart, expect filled bone to cover " +
         (preview.step_mm <= 1.5  ? "94 to 98"
          : preview.step_mm < 2.5 ? "80 to 95"
                                  : "42 to 90") +
         " % of a vertebra or rib" +
         (preview.step_mm <= 1.5 ? "."
                                 : ", since thin walls fade; slices up to 1.5 mm apart give "
                                   "94 to 98 %.");
}

std::string solid_text(const SolidOptions& o) {
  std::string out;
  if (o.min_volume_mm3 > 0)
    out += "; components below " + number_text(o.min_volume_mm3) + " mm3 dropped";
  if (o.fill_mm2) {
    out += "; filled inside";
    if (std::isfinite(*o.fill_mm2)) out += " up to " + number_text(*o.fill_mm2) + " mm2";
    if (o.close_mm > 0) out += ", gaps up to " + number_text(2 * o.close_mm) + " mm closed";
  }
  if (o.column) out += "; spinal column alone";
  if (!o.mask_labels.empty()) out += "; within mask " + named_ranges("label", o.mask_labels);
  if (!o.seeds_lps_mm.empty()) {
    out += "; nearest to the first of " + std::to_string(o.seeds_lps_mm.size()) +
           (o.seeds_lps_mm.size() == 1 ? " seed" : " seeds");
  }
  if (o.largest > 0) out += "; largest " + std::to_string(o.largest);
  return out;
}

}  // namespace

std::string slices_shown(const Preview& preview) {
  const std::size_t n = preview.shown.size();
  return n == 1 ? "the slice shown" : "the " + std::to_string(n) + " slices shown";
}

std::vector<Warning> shown_warnings(const Preview& preview) {
  // The sentences of these warnings contain only fixed words and numbers.
  static constexpr std::array kPlain = {
      "contrast_filled", "copied_slice",    "gantry_tilt",       "labels_not_counted",
      "localiser",       "looks_like_ct",   "looks_like_labels", "looks_offset",
      "missing_slice",   "no_modality",     "no_orientation",    "no_pixel_spacing",
      "no_rescale",      "no_series_uid",   "no_sop_uid",        "not_dicom",
      "spacing_ignored", "table_connected", "table_removed",     "threshold_out_of_range",
      "uneven_spacing",  "voxel_volume"};
  std::vector<Warning> out;
  for (const Warning& w : preview.warnings) {
    const bool is_plain = std::find(kPlain.begin(), kPlain.end(), w.code) != kPlain.end();
    const std::string sentence = is_plain ? w.sentence : "see the messages of the program";
    if (std::none_of(out.begin(), out.end(), [&](const Warning& other) {
          return other.code == w.code && other.sentence == sentence;
        }))
      out.push_back({w.code, "", sentence});
  }
  return out;
}

std::string changes_text(const Preview& preview) {
  return "Sums over " + slices_shown(preview) + ", of the contours before simplification" +
         (preview.has_solid ? " and without solid bone" : "") +
         (preview.has_table ? ", with the scanner's table." : ".") + fill_text(preview);
}

std::string number_text(double value, int digits) {
  char out[40];
  std::snprintf(out, sizeof out, "%.*g", digits, value);
  // A number with more digits is printed as an integer, not with an exponent.
  if (std::abs(value) >= std::pow(10.0, digits) && std::abs(value) < 1e15)
    std::snprintf(out, sizeof out, "%.0f", value);
  return out;
}

std::string size_text(const Preview& preview, const Crop& view) {
  const SlicePlane& plane = preview.shown[0].plane;
  const auto sides = [&](int width, int height) {
    return number_text(width * plane.spacing_u_mm) + " x " +
           number_text(height * plane.spacing_v_mm) + " mm";
  };
  std::string out =
      std::to_string(preview.slices) + (preview.slices == 1 ? " slice" : " slices") + " of " +
      std::to_string(preview.width) + " x " + std::to_string(preview.height) + " pixels of " +
      number_text(plane.spacing_u_mm) + " x " + number_text(plane.spacing_v_mm) + " mm";
  if (preview.slices > 1) out += ", " + number_text(preview.step_mm) + " mm apart";
  out += "; whole slice " + sides(preview.width, preview.height) + ", shown " +
         sides(view.x1 - view.x0 + 1, view.y1 - view.y0 + 1);
  if (preview.inspected > 0) {
    out += "; the first and the last slice with material were sought in " +
           std::to_string(preview.inspected) +
           " slices, so material in a few slices beyond them can be missing here";
  }
  return out;
}

std::string input_kind(const SliceStack& stack) {
  if (stack.series) return "DICOM";
  if (stack.pixel_unit() == PixelUnit::kGrey) return "images";
  return !stack.files.empty() && is_nrrd(stack.files[0]) ? "NRRD" : "NIfTI";
}

std::string sheet_title(const SliceStack& stack, const Preview& preview) {
  const std::string kind = input_kind(stack);
  return "Preview of " + (kind == "images" ? kind : "a " + kind + " scan") + ": " +
         std::to_string(preview.shown.size()) + " of " + std::to_string(preview.slices) +
         " slices" +
         (preview.unit == PixelUnit::kUncalibrated ? ", not a CT (values are not HU)" : "");
}

std::string options_text(const StackOptions& options, const OpenOptions& input, PixelUnit unit) {
  std::string out = "material: ";
  const MeshOptions& mesh = options.mesh;
  if (const auto* threshold = std::get_if<Threshold>(&mesh.segmentation)) {
    out += "at or above " + number_text(threshold->value, 6);
    if (unit == PixelUnit::kHounsfield) out += " HU";
  } else if (const auto* equalize = std::get_if<Equalize>(&mesh.segmentation)) {
    out += "at or above level " + number_text(equalize->level, 6) + " after equalisation";
  } else {
    const auto& labels = std::get<Labels>(mesh.segmentation);
    out += labels.all ? "all labels" : named_ranges("label", labels.labels);
  }
  if (mesh.contour == ContourKind::kPixel) out += "; pixel chains";
  out += solid_text(options.solid);
  if (mesh.min_region_mm2 > 0)
    out += "; regions below " + number_text(mesh.min_region_mm2) + " mm2 dropped";
  if (options.slices) {
    out += "; slices " + std::to_string(options.slices->first) + " to " +
           std::to_string(options.slices->second);
  }
  if (mesh.crop) {
    out += "; crop " + std::to_string(mesh.crop->x0) + ":" + std::to_string(mesh.crop->x1) + "," +
           std::to_string(mesh.crop->y0) + ":" + std::to_string(mesh.crop->y1);
  }
  if (input.axis && *input.axis != SliceAxis::kAxial)
    out += *input.axis == SliceAxis::kCoronal ? "; coronal slices" : "; sagittal slices";
  return out;
}

}  // namespace trocar::pipeline
