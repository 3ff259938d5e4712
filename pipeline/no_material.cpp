// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/no_material.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "pipeline/number_ranges.h"

namespace trocar::pipeline {
namespace {

// What the slices hold within the crop.
struct Found {
  double low = std::numeric_limits<double>::infinity(), high = -low;  // of finite values
  // Every value is a whole number, and there are few different ones.
  bool is_label_map = true;
  std::set<int> labels;       // without the background, 0; only of a label map
  bool has_material = false;  // before small regions are dropped
};

void add_label(Found& found, float value) {
  constexpr std::size_t kMostLabels = 256;
  if (std::rint(value) != value || std::abs(value) >= 1e9F) {
    found.is_label_map = false;
  } else if (value != 0) {
    found.labels.insert(static_cast<int>(value));
    found.is_label_map = found.labels.size() <= kMostLabels;
  }
}

void add_values(Found& found, const Image& image) {
  float before = 0;
  for (const float value : image.values) {
    if (!std::isfinite(value)) continue;
    found.low = std::min(found.low, static_cast<double>(value));
    found.high = std::max(found.high, static_cast<double>(value));
    if (found.is_label_map && value != before) add_label(found, value);
    before = value;
  }
}

Result<Found> look_again(const SliceStack& stack, int first, int last, const MeshOptions& options) {
  Found found;
  for (int k = first; k <= last; ++k) {
    auto image = read_cropped(stack, k, options.crop);
    if (!image) return image.error();
    add_values(found, *image);
    const Field field = segment(std::move(*image), stack.pixel_unit(), options.segmentation);
    found.has_material |= std::any_of(field.image.values.begin(), field.image.values.end(),
                                      [&field](float value) { return value >= field.iso; });
  }
  return found;
}

std::string place(const SliceStack& stack, int first, int last) {
  std::set<int> slices;
  for (int k = first; k <= last; ++k)
    slices.insert(k);
  const std::string input = input_name(stack);
  return input + (input.empty() ? "" : ", ") + named_ranges("slice", slices);
}

std::string reason(const Found& found, const MeshOptions& options, const LabelNames& names) {
  if (found.has_material)
    return "all pieces of material are smaller than --min-region " +
           text_of(options.min_region_mm2) + " mm^2";
  if (const auto* threshold = std::get_if<Threshold>(&options.segmentation))
    return "nothing is at or above the threshold of " + text_of(threshold->value);
  if (const auto* paper = std::get_if<Equalize>(&options.segmentation))
    return "nothing is at or above the level of " + text_of(paper->level) + " after equalisation";
  const auto& [wanted, all, joined] = std::get<Labels>(options.segmentation);
  if (all) return "nothing is labelled";
  return "the " + names.list(wanted) + (wanted.size() == 1 ? " is" : " are") + " not there";
}

std::string values(const Found& found, const SliceStack& stack, bool as_labels,
                   const LabelNames& names) {
  if (found.low > found.high) return "there is no value that is a number";
  std::string out = "the values found are ";
  out += found.low == found.high ? "all " + text_of(found.low)
                                 : text_of(found.low) + " to " + text_of(found.high);
  if (as_labels) {
    return out +
           (found.labels.empty() ? ", so there is no label" : ", the " + names.list(found.labels));
  }
  if (stack.pixel_unit() == PixelUnit::kUncalibrated) return out + " (" + stack.modality + ")";
  return out + (stack.pixel_unit() == PixelUnit::kHounsfield ? " HU" : " (grey levels)");
}

// What to try; empty if nothing is known.
std::string advice(const Found& found, const SliceStack& stack, bool as_labels,
                   const MeshOptions& options) {
  constexpr double kBone = Threshold{}.value;
  const bool is_hu = stack.pixel_unit() == PixelUnit::kHounsfield;
  if (!as_labels && std::holds_alternative<Labels>(options.segmentation))
    return "it without --labels (this is no label map)";
  if (found.has_material) return "a smaller --min-region";
  if (as_labels && !found.labels.empty())
    return "--labels " + number_ranges(found.labels, ",") + " or some of these";
  if (std::holds_alternative<Equalize>(options.segmentation) && found.low < found.high)
    return "a lower --equalize";
  if (found.low < found.high && !as_labels) {
    return is_hu && found.low < kBone && kBone <= found.high
               ? "--threshold " + text_of(kBone)
               : "a --threshold from " + text_of(found.low) + " to " + text_of(found.high);
  }
  return "";
}

}  // namespace

std::string input_name(const SliceStack& stack) {
  if (stack.files.empty()) return {};
  const std::filesystem::path& file = stack.files[0];
  const std::filesystem::path folder = file.has_parent_path() ? file.parent_path() : ".";
  return (stack.files.size() == 1 ? file : folder).string();
}

Error no_material(const SliceStack& stack, int first, int last, const MeshOptions& options,
                  const LabelNames& names) {
  const auto found = look_again(stack, first, last, options);
  if (!found) return found.error();
  // Without --labels, what looks like a label map has none below 0, as a CT has.
  const bool as_labels =
      found->is_label_map && (std::holds_alternative<Labels>(options.segmentation) ||
                              (stack.pixel_unit() == PixelUnit::kHounsfield && found->low >= 0));
  std::string tries = advice(*found, stack, as_labels, options);
  const auto add = [&tries](bool applies, const char* what) {
    if (applies) tries += (tries.empty() ? "" : ", or ") + std::string(what);
  };
  add(options.crop.has_value(), "a larger --crop");
  add(first > 0 || last + 1 < stack.size(), "other --slices");
  add(tries.empty(), "another scan");
  return refused(place(stack, first, last) + ": " + reason(*found, options, names) + "; " +
                 values(*found, stack, as_labels, names) + "; try " + tries);
}

}  // namespace trocar::pipeline
