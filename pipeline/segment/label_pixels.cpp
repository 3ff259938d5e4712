// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/segment/label_pixels.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <queue>
#include <tuple>
#include <type_traits>
#include <unordered_map>

#include "formats/base/disjoint_sets.h"
#include "pipeline/read/number_ranges.h"

namespace trocar::pipeline {
namespace {

// The area of a cell between four pixels, counter-clockwise, on each pixel's side of the half-way
// outline, in eighths of the cell.
std::array<int, 4> eighths_of(const std::array<MaterialNumber, 4>& corner) {
  std::array<int, 4> out{2, 2, 2, 2};
  for (std::size_t k = 0; k < 4; ++k) {
    const MaterialNumber other = corner[(k + 1) % 4];
    if (corner[k] == other || corner[(k + 3) % 4] != other) continue;
    if (corner[(k + 2) % 4] == other) return out[k] = 1, out[(k + 2) % 4] = 3, out;
  }
  if (corner[0] == corner[1] || corner[1] == corner[2] || corner[2] == corner[3] ||
      corner[3] == corner[0])
    return out;
  const Diagonal diagonal = connected_diagonal(corner[0], corner[1], corner[2], corner[3]);
  if (diagonal == Diagonal::kAC) return {3, 1, 3, 1};
  if (diagonal == Diagonal::kBD) return {1, 3, 1, 3};
  return out;
}

// Components as sets of runs: a run is a row's consecutive pixels of one material. The image is
// padded by one pixel of background.
class Components {
 public:
  explicit Components(MaterialImage& image) : image_(image) {
    std::vector<std::size_t> row_starts;
    for (int y = -1; y <= image.height; ++y) {
      row_starts.push_back(runs_.size());
      const auto at = [&](int x) {
        return y < 0 || y == image.height || x < 0 || x == image.width ? kNoMaterial
                                                                       : image.at(x, y);
      };
      for (int x = -1; x <= image.width;) {
        const int first = x;
        const MaterialNumber material = at(x);
        while (x <= image.width && at(x) == material)
          ++x;
        runs_.push_back({y, first, x, 0, material});
      }
    }
    row_starts.push_back(runs_.size());
    components_ = DisjointSets(runs_.size());
    for (std::size_t row = 0; row + 2 < row_starts.size(); ++row) {
      const std::size_t upper = row_starts[row + 1];
      for (std::size_t r = row_starts[row]; r + 1 < upper; ++r)
        touch(static_cast<std::uint32_t>(r), static_cast<std::uint32_t>(r + 1), 1);
      connect_rows(row_starts[row], upper, row_starts[row + 2]);
    }
    eighths_.assign(runs_.size(), 0);
    for (std::uint32_t r = 0; r < runs_.size(); ++r)
      eighths_[root(r)] += runs_[r].eighths;
  }

  void merge_below(double min_pixels) {
    const auto is_small = [&](std::uint32_t r) {
      return r != root(0) && static_cast<double>(eighths_[r]) < 8 * min_pixels;
    };
    // The smallest component comes first; of equal ones the first in the image.
    using Entry = std::pair<std::int64_t, std::uint32_t>;
    std::vector<Entry> small;
    for (std::uint32_t r = 0; r < runs_.size(); ++r) {
      if (root(r) == r && is_small(r)) small.emplace_back(eighths_[r], r);
    }
    if (small.empty()) return;
    borders_.resize(runs_.size());
    for (const Contact& c : contacts_) {
      const std::uint32_t r = root(c.a), q = root(c.b);
      if (r == q) continue;
      borders_[r][q] += c.length;
      borders_[q][r] += c.length;
    }
    std::priority_queue queue(std::greater<>{}, std::move(small));
    while (!queue.empty()) {
      const auto [eighths, component] = queue.top();
      queue.pop();
      if (root(component) != component || eighths_[component] != eighths) continue;
      const std::optional<MaterialNumber> to = longest_border(component);
      if (!to) continue;
      std::vector<std::uint32_t> neighbours;
      for (const auto& [neighbour, length] : borders_[component]) {
        if (runs_[neighbour].material == *to) neighbours.push_back(neighbour);
      }
      runs_[component].material = *to;
      std::uint32_t merged = component;
      for (const std::uint32_t neighbour : neighbours)
        merged = merge(merged, neighbour);
      if (is_small(merged)) queue.emplace(eighths_[merged], merged);
    }
    for (std::uint32_t r = 0; r < runs_.size(); ++r) {
      const Run& run = runs_[r];
      if (run.y < 0 || run.y == image_.height) continue;
      const auto row = image_.values.begin() + static_cast<std::ptrdiff_t>(run.y) * image_.width;
      std::fill(row + std::max(0, run.first), row + std::min(run.end, image_.width),
                runs_[root(r)].material);
    }
  }

 private:
  struct Run {
    int y, first, end;
    int eighths;              // area of the run in eighths of a pixel
    MaterialNumber material;  // material of the component, valid at its root
  };
  struct Contact {
    std::uint32_t a, b;
    int length;
  };

  std::uint32_t root(std::uint32_t r) { return components_.root(r); }

  void touch(std::uint32_t a, std::uint32_t b, int length) {
    if (runs_[a].material == runs_[b].material)
      components_.join(a, b);
    else
      contacts_.push_back({a, b, length});
  }

  void connect_rows(std::size_t lower, std::size_t upper, std::size_t end) {
    for (std::size_t r = lower, q = upper; r < upper && q < end;) {
      const auto a = static_cast<std::uint32_t>(r), d = static_cast<std::uint32_t>(q);
      const int until = std::min(runs_[r].end, runs_[q].end);
      const int length = until - std::max(runs_[r].first, runs_[q].first);
      touch(a, d, length);
      runs_[a].eighths += 4 * (length - 1);
      runs_[d].eighths += 4 * (length - 1);
      if (runs_[r].end == until) ++r;
      if (runs_[q].end == until) ++q;
      if (r < upper && q < end)
        connect_cell({a, static_cast<std::uint32_t>(r), static_cast<std::uint32_t>(q), d});
    }
  }

  // Adds the cell in which a run of either row, or of both, ends.
  void connect_cell(const std::array<std::uint32_t, 4>& run) {
    std::array<MaterialNumber, 4> corner{};
    for (std::size_t k = 0; k < 4; ++k)
      corner[k] = runs_[run[k]].material;
    const std::array<int, 4> shares = eighths_of(corner);
    for (std::size_t k = 0; k < 4; ++k)
      runs_[run[k]].eighths += shares[k];
    if (corner[0] == corner[2] && shares[0] == 3) components_.join(run[0], run[2]);
    if (corner[1] == corner[3] && shares[1] == 3) components_.join(run[1], run[3]);
  }

  std::optional<MaterialNumber> longest_border(std::uint32_t component) const {
    std::map<MaterialNumber, std::int64_t> lengths;
    for (const auto& [neighbour, length] : borders_[component])
      lengths[runs_[neighbour].material] += length;
    std::optional<MaterialNumber> best;
    for (const auto& [material, length] : lengths) {
      if (!best || length > lengths[*best] || (length == lengths[*best] && *best == kNoMaterial))
        best = material;
    }
    return best;
  }

  std::uint32_t merge(std::uint32_t a, std::uint32_t b) {
    if (borders_[a].size() < borders_[b].size()) std::swap(a, b);
    components_.put_under(a, b);
    eighths_[a] += eighths_[b];
    for (const auto& [neighbour, length] : borders_[b]) {
      borders_[neighbour].erase(b);
      if (neighbour == a) continue;
      borders_[neighbour][a] += length;
      borders_[a][neighbour] += length;
    }
    borders_[b].clear();
    return a;
  }

  MaterialImage& image_;
  std::vector<Run> runs_;
  DisjointSets components_;
  std::vector<Contact> contacts_;
  std::vector<std::int64_t> eighths_;                                     // by root
  std::vector<std::unordered_map<std::uint32_t, std::int64_t>> borders_;  // by root
};

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

Result<LabelMaterials> label_materials(const LabelImage& labels, const Labels& wanted) {
  std::unordered_map<int, int> first_of_joined;
  for (const std::set<int>& joined : wanted.joined) {
    for (const int label : joined)
      first_of_joined.emplace(label, *joined.begin());
  }
  // Materials are numbered in the order in which they occur; 0 is the background.
  std::vector<std::pair<int, std::set<int>>> found(1);
  std::unordered_map<int, std::size_t> of_label, of_first;
  const auto number_of = [&](int label) -> std::size_t {
    const auto [known, is_new] = of_label.try_emplace(label, 0);
    if (!is_new || !(wanted.all ? label != 0 : wanted.labels.contains(label))) return known->second;
    const auto joined = first_of_joined.find(label);
    const int first = joined == first_of_joined.end() ? label : joined->second;
    const auto [number, is_new_material] = of_first.try_emplace(first, found.size());
    if (is_new_material) found.emplace_back(first, std::set<int>());
    found[number->second].second.insert(label);
    return known->second = number->second;
  };
  LabelMaterials out{{labels.width, labels.height, {}, {}}, {}};
  std::vector<MaterialNumber>& values = out.image.values;
  values.resize(labels.values.size());
  for (std::size_t i = 0; i < values.size();) {
    const std::int32_t label = labels.values[i];
    const std::size_t number = number_of(label);
    if (number > kMaxMaterials)
      return refused("more than " + std::to_string(kMaxMaterials) +
                     " labels; join some to one material, as --labels 1-20+21");
    do {
      values[i++] = static_cast<MaterialNumber>(number);
    } while (i < values.size() && labels.values[i] == label);
  }

  std::vector<std::size_t> order(found.size() - 1);
  std::iota(order.begin(), order.end(), std::size_t{1});
  std::sort(order.begin(), order.end(),
            [&found](std::size_t a, std::size_t b) { return found[a].first < found[b].first; });
  std::vector<MaterialNumber> index(found.size(), kNoMaterial);
  for (std::size_t k = 0; k < order.size(); ++k) {
    auto& [first, used] = found[order[k]];
    index[order[k]] = static_cast<MaterialNumber>(k + 1);
    out.first_labels.push_back(first);
    out.image.labels.push_back(std::move(used));
  }
  for (MaterialNumber& number : values)
    number = index[number];
  return out;
}

void merge_small_components(MaterialImage& image, double min_pixels) {
  if (min_pixels > 0 && !image.values.empty()) Components(image).merge_below(min_pixels);
}

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
