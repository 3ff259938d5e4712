// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/segment/label_map_detection.h"

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "pipeline/base/number_ranges.h"

namespace trocar::pipeline {
namespace {

bool may_be_labels(const ValueTally& t) {
  return !t.has_negative && !t.has_fractions && t.values.size() <= kMaxLabels;
}

// Counts everything but the pairs. Returns false if it has stopped early.
template <typename AnyImage>
bool tally_pixels(const AnyImage& image, bool as_labels, ValueTally& out) {
  constexpr double kMaxExact = 1 << 24;
  const auto* before = static_cast<decltype(image.values.data())>(nullptr);
  for (const auto& value : image.values) {
    ++out.pixels;
    if (value >= 964 && value <= 1124) ++out.offset_soft_tissue;
    if (before != nullptr && value == *before) continue;
    before = &value;
    const auto number = static_cast<double>(value);
    out.low = std::min(out.low, number);
    out.high = std::max(out.high, number);
    if (std::rint(number) != number) {
      out.has_fractions = true;
    } else if (std::is_floating_point_v<std::decay_t<decltype(value)>> &&
               std::abs(number) > kMaxExact) {
      out.has_inexact = true;
    } else if (out.values.size() <= kMaxLabels) {
      out.values.insert(static_cast<int>(value));
    }
    out.has_negative |= value < 0;
    if (!as_labels && out.has_negative) return false;
  }
  return true;
}

template <typename AnyImage>
void tally_pairs(const AnyImage& image, ValueTally& out) {
  using Value = typename decltype(image.values)::value_type;
  const auto low = static_cast<Value>(out.low), high = static_cast<Value>(out.high);
  const auto is_inside = [low, high](Value v) { return v > low && v < high; };
  const auto pair = [&](Value a, Value b) {
    if (!is_inside(a) && !is_inside(b)) return;
    const auto apart = std::abs(static_cast<double>(a) - static_cast<double>(b));
    ++(apart == 0 ? out.equal : apart <= 1 ? out.steps : out.jumps);
  };
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const Value here = image.at(x, y);
      if (x > 0) pair(image.at(x - 1, y), here);
      if (y > 0) pair(image.at(x, y - 1), here);
    }
  }
}

template <typename AnyImage>
ValueTally tally(const AnyImage& image, bool as_labels) {
  ValueTally out;
  if (image.values.empty()) return out;
  out.low = out.high = static_cast<double>(image.values[0]);
  const bool is_whole_image = tally_pixels(image, as_labels, out);
  if (is_whole_image && (as_labels || may_be_labels(out))) tally_pairs(image, out);
  return out;
}

std::set<int> labels_of(const ValueTally& t) {
  std::set<int> out = t.values;
  out.erase(0);
  return out;
}

bool follow_each_other(const std::set<int>& labels) {
  return std::adjacent_find(labels.begin(), labels.end(),
                            [](int a, int b) { return b - a == 1; }) != labels.end();
}

bool looks_like_labels(const ValueTally& t, double level) {
  constexpr double kMinEqual = 0.55, kMinJumps = 0.4;
  constexpr std::size_t kFew = 16;
  if (!may_be_labels(t)) return false;
  const std::set<int> labels = labels_of(t);
  // A mask gives the same mesh as a label if the threshold is half of its level. Else its outline
  // is off by up to half a pixel.
  const bool is_mask = labels.size() == 1 && t.high <= 255 && 2 * level != t.high;
  if (!t.has_inexact &&
      ((labels.size() < 2 && !is_mask) || (t.high > 255 && !follow_each_other(labels))))
    return false;
  const auto equal = static_cast<double>(t.equal), steps = static_cast<double>(t.steps),
             jumps = static_cast<double>(t.jumps);
  if (equal < kMinEqual * (equal + steps + jumps)) return false;
  return t.values.size() <= kFew || jumps >= kMinJumps * (steps + jumps);
}

bool looks_offset(const ValueTally& t) {
  return !t.has_negative && t.values.size() > kMaxLabels &&
         100 * t.offset_soft_tissue >= 15 * t.pixels;
}

bool changes_everywhere(const ValueTally& t) {
  constexpr std::int64_t kMinPairs = 32;
  const std::int64_t unequal = t.steps + t.jumps;
  return unequal >= kMinPairs && 100 * unequal >= t.pixels && 2 * t.equal < unequal;
}

}  // namespace

void ValueTally::add(const ValueTally& other) {
  if (other.pixels == 0) return;
  low = pixels == 0 ? other.low : std::min(low, other.low);
  high = pixels == 0 ? other.high : std::max(high, other.high);
  pixels += other.pixels;
  has_fractions |= other.has_fractions;
  has_inexact |= other.has_inexact;
  for (const int value : other.values) {
    if (values.size() <= kMaxLabels) values.insert(value);
  }
  equal += other.equal;
  steps += other.steps;
  jumps += other.jumps;
  has_negative |= other.has_negative;
  offset_soft_tissue += other.offset_soft_tissue;
  rounded += other.rounded;
  largest_rounding = std::max(largest_rounding, other.largest_rounding);
}

ValueTally tally_values(const Image& image, bool as_labels) {
  return tally(image, as_labels);
}

ValueTally tally_values(const LabelImage& image) {
  ValueTally out = tally(image, true);
  out.rounded = static_cast<std::int64_t>(image.rounded);
  out.largest_rounding = image.largest_rounding;
  return out;
}

ValueTally tally_values(const Pixels& pixels, bool as_labels) {
  const auto* labels = std::get_if<LabelImage>(&pixels);
  return labels != nullptr ? tally_values(*labels)
                           : tally_values(std::get<Image>(pixels), as_labels);
}

std::optional<Warning> value_warning(const ValueTally& t, PixelUnit unit, const Segmentation& how,
                                     const std::string& where) {
  if (!std::holds_alternative<Labels>(how)) {
    const auto* threshold = std::get_if<Threshold>(&how);
    const double level = threshold != nullptr ? threshold->value : 0;
    if (unit != PixelUnit::kHounsfield) return {};
    if (threshold != nullptr && looks_offset(t)) {
      return Warning{"looks_offset", where,
                     "the values look like HU with 1024 added: none is negative, and soft tissue "
                     "seems to be near 1064; correct the scan (its intercept is missing), or add "
                     "1024 to --threshold, but then mean HU and tissues are wrong"};
    }
    if (!looks_like_labels(t, level)) return {};
    const std::string found =
        "the values look like labels and not like HU: whole numbers in even regions, none "
        "negative, ";
    if (t.has_inexact)
      return Warning{
          "looks_like_labels", where,
          found + "up to about " + text_of(t.high) + "; if this is a label map, try --labels all"};
    const std::set<int> labels = labels_of(t);
    return Warning{"looks_like_labels", where,
                   found + "the labels " + number_ranges(labels) +
                       "; if this is a label map, try --labels " + number_ranges(labels, ",") +
                       " or some of these"};
  }
  if (!changes_everywhere(t)) return {};
  return Warning{"looks_like_ct", where,
                 "the values look like " +
                     std::string(unit == PixelUnit::kHounsfield ? "HU" : "grey levels") +
                     " and not like labels: " + text_of(t.low, 10) + " to " + text_of(t.high, 10) +
                     ", changing from pixel to pixel; if this is no label map, try it without "
                     "--labels"};
}

std::optional<Warning> rounding_warning(const ValueTally& t, const std::string& where) {
  if (t.rounded == 0) return {};
  return Warning{"labels_rounded", where,
                 std::to_string(t.rounded) + " voxels are not whole numbers, but within " +
                     text_of(t.largest_rounding, 3) + " of one; their labels are rounded"};
}

}  // namespace trocar::pipeline
