// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/contour/label_pixels.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numeric>
#include <optional>
#include <queue>
#include <tuple>
#include <unordered_map>
#include <utility>

namespace trocar::pipeline {
namespace {

// Pieces as sets of runs: a run is a row's consecutive pixels of one material.
class Pieces {
 public:
  explicit Pieces(MaterialImage& image) : image_(image) {
    runs_.push_back({0, 0, 0, kNoMaterial});  // all beyond the image
    std::vector<std::size_t> row_starts;
    for (int y = 0; y < image.height; ++y) {
      row_starts.push_back(runs_.size());
      for (int x = 0; x < image.width;) {
        const int first = x;
        const MaterialNumber material = image.at(x, y);
        while (x < image.width && image.at(x, y) == material)
          ++x;
        runs_.push_back({y, first, x, material});
      }
    }
    row_starts.push_back(runs_.size());
    parent_.resize(runs_.size());
    std::iota(parent_.begin(), parent_.end(), 0U);
    for (int y = 0; y < image.height; ++y)
      connect_row(row_starts[y], row_starts[y + 1]);
    for (int y = 0; y + 1 < image.height; ++y)
      connect_rows(row_starts[y], row_starts[y + 1], row_starts[y + 2]);
    pixels_.assign(runs_.size(), 0);
    for (std::uint32_t r = 1; r < runs_.size(); ++r)
      pixels_[root(r)] += runs_[r].end - runs_[r].first;
  }

  void merge_below(double min_pixels) {
    const std::uint32_t beyond = root(0);
    const auto is_small = [&](std::uint32_t r) {
      return r != root(beyond) && static_cast<double>(pixels_[r]) < min_pixels;
    };
    // The smallest first; of equal ones the first in the image.
    using Entry = std::pair<std::int64_t, std::uint32_t>;
    std::vector<Entry> small;
    for (std::uint32_t r = 0; r < runs_.size(); ++r) {
      if (root(r) == r && is_small(r)) small.emplace_back(pixels_[r], r);
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
      const auto [pixels, piece] = queue.top();
      queue.pop();
      if (root(piece) != piece || pixels_[piece] != pixels) continue;
      const std::optional<MaterialNumber> to = longest_border(piece);
      if (!to) continue;  // it is the whole image
      std::vector<std::uint32_t> neighbours;
      for (const auto& [neighbour, length] : borders_[piece]) {
        if (runs_[neighbour].material == *to) neighbours.push_back(neighbour);
      }
      runs_[piece].material = *to;
      std::uint32_t merged = piece;
      for (const std::uint32_t neighbour : neighbours)
        merged = merge(merged, neighbour);
      if (is_small(merged)) queue.emplace(pixels_[merged], merged);
    }
    for (std::uint32_t r = 1; r < runs_.size(); ++r) {
      const auto row =
          image_.values.begin() + static_cast<std::ptrdiff_t>(runs_[r].y) * image_.width;
      std::fill(row + runs_[r].first, row + runs_[r].end, runs_[root(r)].material);
    }
  }

 private:
  struct Run {
    int y, first, end;
    MaterialNumber material;  // of the piece, at its root
  };
  struct Contact {
    std::uint32_t a, b;
    int length;
  };

  std::uint32_t root(std::uint32_t r) {
    while (parent_[r] != r)
      r = parent_[r] = parent_[parent_[r]];
    return r;
  }

  void touch(std::uint32_t a, std::uint32_t b, int length) {
    if (runs_[a].material == runs_[b].material)
      unite(a, b);
    else
      contacts_.push_back({a, b, length});
  }
  void unite(std::uint32_t a, std::uint32_t b) {
    const std::uint32_t r = root(a), q = root(b);
    parent_[std::max(r, q)] = std::min(r, q);
  }

  void connect_row(std::size_t first, std::size_t end) {
    const int y = runs_[first].y;
    for (std::size_t r = first; r < end; ++r) {
      const auto id = static_cast<std::uint32_t>(r);
      if (r + 1 < end) touch(id, id + 1, 1);
      const int sides = (runs_[r].first == 0 ? 1 : 0) + (runs_[r].end == image_.width ? 1 : 0);
      const int rows = (y == 0 ? 1 : 0) + (y + 1 == image_.height ? 1 : 0);
      const int length = sides + rows * (runs_[r].end - runs_[r].first);
      if (length > 0) touch(0, id, length);
    }
  }

  void connect_rows(std::size_t lower, std::size_t upper, std::size_t end) {
    for (std::size_t r = lower, q = upper; r < upper && q < end;) {
      const Run &below = runs_[r], &above = runs_[q];
      const auto id = static_cast<std::uint32_t>(r), other = static_cast<std::uint32_t>(q);
      touch(id, other, std::min(below.end, above.end) - std::max(below.first, above.first));
      if (below.end == above.end) {
        if (below.end < image_.width) connect_diagonal(id, other);
        ++r, ++q;
      } else {
        ++(below.end < above.end ? r : q);
      }
    }
  }

  // Two runs of either row end at the same place: d | c above a | b.
  void connect_diagonal(std::uint32_t a, std::uint32_t d) {
    const std::uint32_t b = a + 1, c = d + 1;
    if (runs_[a].material == runs_[d].material || runs_[b].material == runs_[c].material) return;
    const Diagonal diagonal = connected_diagonal(runs_[a].material, runs_[b].material,
                                                 runs_[c].material, runs_[d].material);
    if (diagonal == Diagonal::kAC) unite(a, c);
    if (diagonal == Diagonal::kBD) unite(b, d);
  }

  std::optional<MaterialNumber> longest_border(std::uint32_t piece) const {
    std::map<MaterialNumber, std::int64_t> lengths;
    for (const auto& [neighbour, length] : borders_[piece])
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
    parent_[b] = a;
    pixels_[a] += pixels_[b];
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
  std::vector<std::uint32_t> parent_;
  std::vector<Contact> contacts_;
  std::vector<std::int64_t> pixels_;                                      // by root
  std::vector<std::unordered_map<std::uint32_t, std::int64_t>> borders_;  // by root
};

}  // namespace

MaterialImage material_image(const Image& labels, std::span<const Labels> materials) {
  MaterialImage out{labels.width, labels.height, {}, {}};
  out.labels.resize(materials.size());
  out.values.reserve(labels.values.size());
  float last = 0;
  MaterialNumber last_material = kNoMaterial;
  bool is_first = true;
  for (const float v : labels.values) {
    if (is_first || v != last) {
      last = v;
      is_first = false;
      last_material = kNoMaterial;
      if (std::rint(v) == v && std::abs(v) < 1e9F) {
        const int label = static_cast<int>(v);
        const auto has = [label](const Labels& m) {
          return m.all ? label != 0 : m.labels.contains(label);
        };
        const auto it = std::find_if(materials.begin(), materials.end(), has);
        if (it != materials.end()) {
          last_material = static_cast<MaterialNumber>(it - materials.begin() + 1);
          out.labels[static_cast<std::size_t>(it - materials.begin())].insert(label);
        }
      }
    }
    out.values.push_back(last_material);
  }
  return out;
}

void merge_small_pieces(MaterialImage& image, double min_pixels) {
  if (min_pixels > 1 && !image.values.empty()) Pieces(image).merge_below(min_pixels);
}

}  // namespace trocar::pipeline
