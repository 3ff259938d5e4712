// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/stage_options.h"

#include <cmath>
#include <limits>
#include <utility>

#include "formats/base/file_io.h"
#include "pipeline/program/argument_values.h"
#include "pipeline/read/digest.h"

namespace trocar::pipeline {
namespace {

using nlohmann::json;

Result<Segmentation> segmentation(const Arguments& a) {
  if (a.labels_option.is_given()) {
    if (a.threshold_option.is_given() || a.equalize_option.is_given())
      return usage("--labels cannot be combined with --threshold, --equalize or a preset");
    auto wanted = labels(a.labels);
    if (!wanted) return wanted.error();
    return Segmentation(std::move(*wanted));
  }
  if (a.equalize_option.is_given()) {
    if (a.threshold_option.is_given())
      return usage("--threshold and --equalize (or presets with them) exclude each other");
    return Segmentation(Equalize{a.equalize});
  }
  return Segmentation(Threshold{a.threshold});
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
  out.column = a.keep == "column";
  if (out.column && !out.fill_mm2)
    return usage("--keep column needs --fill MM2 or --fill all, which finds the spinal canal");
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

// Refuses options that apply only to label maps if no labels are wanted.
Result<void> check_label_options(const Arguments& a) {
  if (a.labels_option.is_given()) return {};
  if (!a.names.empty()) return usage("--names is for label maps: give --labels L, or all");
  if (!a.hu.empty())
    return usage(
        "--hu is the CT beside a label map: give --labels L, or all; other scans in HU "
        "need no CT beside them");
  return {};
}

// Sets the segmentation of the material and the names of the labels.
Result<void> set_material(const Arguments& a, StackOptions& out) {
  auto how = segmentation(a);
  if (!how) return how.error();
  if (auto ok = check_label_options(a); !ok) return ok;
  if (!a.names.empty()) {
    auto names = LabelNames::named(a.names);
    if (!names) return names.error();
    out.names = std::move(*names);
  }
  auto solid = solid_options(a);
  if (!solid) return solid.error();
  if (const auto* wanted = std::get_if<Labels>(&*how); wanted != nullptr && are_several(*wanted)) {
    if (a.contour == "pixel")
      return usage(
          "--contour pixel leaves gaps between materials: join the labels with +, as --labels "
          "20+21");
    if (solid->fill_mm2) return fill_of_several_error();
  }
  out.mesh.segmentation = std::move(*how);
  out.solid = std::move(*solid);
  out.keep_table = a.keep_table;
  return {};
}

Result<void> set_mesh(const Arguments& a, StackOptions& out) {
  out.mesh.contour = a.contour == "pixel" ? ContourKind::kPixel : ContourKind::kSubpixel;
  out.mesh.simplification.tolerance_mm = a.tolerance_mm;
  out.mesh.simplification.method =
      a.simplify == "area" ? SimplificationMethod::kArea : SimplificationMethod::kDouglasPeucker;
  out.mesh.refinement.min_angle_deg = a.min_angle_deg;
  out.mesh.refinement.max_area_mm2 = a.max_area_mm2;
  if (a.area_px_option.is_given()) {
    if (a.area_option.is_given()) return usage("--max-area and --max-area-px exclude each other");
    out.mesh.max_area_px2 = a.max_area_px2;
  }
  out.mesh.min_region_mm2 = a.min_region_mm2;
  out.mesh.lattice.bits = a.lattice_bits;
  out.defaults = {!a.tolerance_option.is_given(), !a.min_region_option.is_given(),
                  !a.lattice_option.is_given(), a.of_preset.contains("--close"),
                  a.of_preset.contains("--min-volume")};
  out.mesh.hu_volume = !a.no_hu;
  out.mesh.hu_field = a.colour;
  out.mesh.grade_hu = a.grade_hu;
  return {};
}

Result<void> set_outputs(const Arguments& a, StackOptions& out) {
  if (a.surface) {
    out.surface = SurfaceOptions{a.surface_triangles, a.surface_triangles_option.is_given()};
  } else if (a.surface_triangles_option.is_given()) {
    return usage("--surface-triangles needs --surface");
  }
  out.lines = a.lines;
  if (a.colour && a.no_hu) return usage("--colour shows the HU that --no-hu leaves out");
  out.colours = a.colour;
  if (a.context_option.is_given()) {
    if (a.no_hu) return usage("--context stores HU, which --no-hu leaves out");
    out.context_mm = 0;
    if (!a.context.empty()) {
      const auto mm =
          numbers<double>(a.context, "#", "--context", "MM, a length in mm, or nothing");
      if (!mm) return mm.error();
      if (!((*mm)[0] >= 1 && (*mm)[0] <= 20))
        return usage("--context " + a.context + ": must lie between 1 and 20 mm");
      out.context_mm = (*mm)[0];
    }
  }
  if (!a.input_key.empty()) {
    auto key = read_file(a.input_key, kMaxKeyBytes);
    if (!key) return key.error();
    if (key->size() < kMinKeyBytes)
      return usage("--input-key " + a.input_key.string() + ": has " + std::to_string(key->size()) +
                   " bytes; a key has 16 to 64");
    out.input_key = std::move(*key);
  }
  const bool has_dump_slice = a.dump_slice_option.is_given();
  if (has_dump_slice == a.dump_stages.empty())
    return usage("--dump-slice and --dump-stages go together: which slice, and the file for it");
  if (has_dump_slice) out.dump_slice = a.dump_slice;
  return {};
}

Result<void> set_region(const Arguments& a, StackOptions& out) {
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
  return {};
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

}  // namespace

Result<StackOptions> stack_options(const Arguments& a) {
  StackOptions out;
  for (const auto& set : {set_material, set_mesh, set_outputs, set_region}) {
    if (auto ok = set(a, out); !ok) return ok.error();
  }
  out.threads = a.jobs;
  return out;
}

Result<OpenOptions> open_options(const Arguments& a) {
  OpenOptions out;
  out.series = a.series;
  if (a.axis_option.is_given()) {
    out.axis = a.axis == "coronal"    ? SliceAxis::kCoronal
               : a.axis == "sagittal" ? SliceAxis::kSagittal
                                      : SliceAxis::kAxial;  // also called transverse
  }
  if (a.volume_option.is_given()) out.volume = a.volume;
  out.any_modality = a.any_modality;
  out.completeness_unknown = a.completeness_unknown;
  out.as_labels = a.labels_option.is_given();
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

const char* axis_name(SliceAxis axis) {
  return axis == SliceAxis::kCoronal    ? "coronal"
         : axis == SliceAxis::kSagittal ? "sagittal"
                                        : "transverse";
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
  if (o.keep_table) out["keep_table"] = true;
  if (o.surface) out["surface_triangles"] = o.surface->triangles;
  if (input.spacing_mm) out["spacing_mm"] = *input.spacing_mm;
  if (input.volume) out["volume"] = *input.volume;
  if (input.axis) out["axis"] = axis_name(*input.axis);
  if (input.completeness_unknown) out["completeness"] = "unknown";
  return out;
}

}  // namespace trocar::pipeline
