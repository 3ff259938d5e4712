// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/scan/empty_asset.h"

#include <algorithm>
#include <set>
#include <utility>

#include "pipeline/base/number_ranges.h"

namespace trocar::pipeline {
namespace {

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

}  // namespace

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

}  // namespace trocar::pipeline
