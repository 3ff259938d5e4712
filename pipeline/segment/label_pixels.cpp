// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/segment/label_pixels.h"

#include <algorithm>
#include <array>
#include <functional>
#include <map>
#include <numeric>
#include <optional>
#include <queue>
#include <string>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "formats/base/disjoint_sets.h"

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

}  // namespace trocar::pipeline
