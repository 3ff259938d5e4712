// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/contour/label_borders.h"

#include <algorithm>
#include <cstring>
#include <optional>
#include <utility>

#include "pipeline/contour/border_smoothing.h"
#include "pipeline/contour/border_walk.h"

namespace trocar::pipeline {
namespace {

// The image is padded by one empty pixel: point (x, y) is pixel (x - 1, y - 1).
class BorderTracer {
 public:
  BorderTracer(const MaterialImage& image, const PixelGrid& grid)
      : image_(image), grid_(grid), columns_(image.width + 2), rows_(image.height + 2) {}

  LabelBorders run() {
    scan();
    out_.materials = image_.labels.size();
    for (std::uint32_t n = 0; n < out_.nodes.size(); ++n) {
      for (int k = 0; k < out_.nodes[n].count; ++k) {
        const NodeCell& cell = cells_[n];
        const auto slot = static_cast<std::size_t>(k);
        if (!crossings_[cell.crossing[slot]].is_traced)
          trace(cell.crossing[slot], node_link(n, k), cell.before[slot], cell.after[slot]);
      }
    }
    for (std::uint32_t c = 0; c < crossings_.size(); ++c) {
      const EdgeCrossing& crossing = crossings_[c];
      if (!crossing.is_traced) trace(c, crossing.link[0], crossing.right, crossing.left);
    }
    return std::move(out_);
  }

 private:
  static constexpr std::uint32_t kNodeBit = 0x80000000;
  static std::uint32_t node_link(std::uint32_t node, int end) {
    return kNodeBit | node << 2 | static_cast<std::uint32_t>(end);
  }
  static std::uint32_t node_of(std::uint32_t link) { return (link & ~kNodeBit) >> 2; }

  // A crossing on a grid edge. In each of the two cells at the edge it is linked to another
  // crossing or to a node. The first cell is the one below or to the left, the second the one above
  // or to the right.
  struct EdgeCrossing {
    std::int32_t x, y;
    std::array<std::uint32_t, 2> link;
    MaterialNumber left, right;  // as seen from the first cell
    bool along_v;
    bool is_traced = false;
  };
  // The crossings of a node's cell, counter-clockwise, each with the materials before and after it.
  struct NodeCell {
    Point middle;
    std::array<std::uint32_t, 4> crossing;
    std::array<MaterialNumber, 4> before, after;
  };

  // Finds the cells whose corners are not all equal: compares two neighbouring rows four columns at
  // a time.
  void scan() {
    const auto width = static_cast<std::size_t>(image_.width);
    std::vector<MaterialNumber> below(width + 6, kNoMaterial), above = below;
    above_.assign(static_cast<std::size_t>(columns_), 0);
    for (int y = 0; y + 1 < rows_; ++y) {
      if (y + 2 == rows_) {
        std::fill(above.begin(), above.end(), kNoMaterial);
      } else {
        const auto row = image_.values.begin() + static_cast<std::ptrdiff_t>(y) * image_.width;
        std::copy(row, row + image_.width, above.begin() + 1);
      }
      for (int x = 0; x + 1 < columns_;) {
        std::uint64_t lower = 0, upper = 0;
        std::memcpy(&lower, &below[static_cast<std::size_t>(x)], 8);
        std::memcpy(&upper, &above[static_cast<std::size_t>(x)], 8);
        constexpr std::uint64_t kEach = 0x0001000100010001;
        if (lower == upper && lower == (lower & 0xffff) * kEach) {
          x += 3;  // three cells between four equal columns
          continue;
        }
        for (const int end = std::min(x + 3, columns_ - 1); x < end; ++x) {
          const auto i = static_cast<std::size_t>(x);
          cell(x, y, {below[i], below[i + 1], above[i + 1], above[i]});
        }
      }
      std::swap(below, above);
    }
  }

  std::uint32_t add_crossing(int x, int y, bool along_v, MaterialNumber left,
                             MaterialNumber right) {
    crossings_.push_back({x, y, {}, left, right, along_v});
    return static_cast<std::uint32_t>(crossings_.size() - 1);
  }

  // Corners are counter-clockwise from (x, y); edge k joins corners k and k + 1. A border that
  // leaves the cell over edge k has corner k + 1 on its left.
  void cell(int x, int y, const std::array<MaterialNumber, 4>& corner) {
    std::array<std::size_t, 4> crossed{};
    std::size_t count = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      if (corner[k] != corner[(k + 1) % 4]) crossed[count++] = k;
    }
    if (count == 0) return;
    // The cells below and to the left have already made the crossings shared with this cell.
    std::array<std::uint32_t, 4> id{above_[static_cast<std::size_t>(x)], 0, 0, right_};
    if (corner[1] != corner[2]) right_ = id[1] = add_crossing(x + 1, y, true, corner[2], corner[1]);
    if (corner[2] != corner[3])
      above_[static_cast<std::size_t>(x)] = id[2] =
          add_crossing(x, y + 1, false, corner[3], corner[2]);

    const auto link = [&](std::size_t k) -> std::uint32_t& {
      return crossings_[id[k]].link[k == 0 || k == 3 ? 1 : 0];
    };
    const auto join = [&](std::size_t j, std::size_t k) {
      link(j) = id[k];
      link(k) = id[j];
    };
    if (count == 2) {
      join(crossed[0], crossed[1]);
      return;
    }
    if (count == 4) {
      const Diagonal diagonal = connected_diagonal(corner[0], corner[1], corner[2], corner[3]);
      if (diagonal != Diagonal::kNone) {
        const std::size_t k = diagonal == Diagonal::kAC ? 0 : 1;
        join(k, k + 1);
        join(k + 2, (k + 3) % 4);
        return;
      }
    }
    const auto node = static_cast<std::uint32_t>(out_.nodes.size());
    BorderNode& added = out_.nodes.emplace_back();
    NodeCell& added_cell = cells_.emplace_back();
    added_cell.middle = {x + 0.5, y + 0.5};
    added.at = {snapped_u(added_cell.middle.x), snapped_v(added_cell.middle.y)};
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t k = crossed[i];
      link(k) = node_link(node, added.count++);
      added_cell.crossing[i] = id[k];
      added_cell.before[i] = corner[k];
      added_cell.after[i] = corner[(k + 1) % 4];
    }
  }

  // Follows the border from a crossing, away from the link `from`, up to a node or back to the
  // start.
  void trace(std::uint32_t first, std::uint32_t from, MaterialNumber right, MaterialNumber left) {
    const auto chain = static_cast<std::uint32_t>(out_.chains.size());
    path_.clear();
    std::uint32_t at = first, came = from;
    while ((at & kNodeBit) == 0 && !crossings_[at].is_traced) {
      EdgeCrossing& c = crossings_[at];
      c.is_traced = true;
      const int dx = c.along_v ? 0 : 1, dy = 1 - dx;
      const bool is_at_border = is_padding(c.x, c.y) || is_padding(c.x + dx, c.y + dy);
      path_.push_back({c.x, c.y, c.along_v, is_at_border, 0.5});
      const std::uint32_t next = c.link[c.link[0] == came ? 1 : 0];
      came = at;
      at = next;
    }
    BorderChain& out = out_.chains.emplace_back();
    out.left = left;
    out.right = right;
    out.is_closed = (from & kNodeBit) == 0;
    std::optional<BorderEnds> ends;
    if (!out.is_closed) {
      end_of(from) = {chain, true};
      end_of(at) = {chain, false};
      ends = {cells_[node_of(from)].middle, cells_[node_of(at)].middle};
      out.points.push_back(out_.nodes[node_of(from)].at);
    }
    smooth_border(path_, ends);
    for (const Crossing& c : path_)
      out.points.push_back(snapped(c));
    if (!out.is_closed) out.points.push_back(out_.nodes[node_of(at)].at);
  }

  BorderNode::End& end_of(std::uint32_t link) { return out_.nodes[node_of(link)].ends[link & 3]; }

  bool is_padding(int x, int y) const {
    return x == 0 || y == 0 || x == columns_ - 1 || y == rows_ - 1;
  }

  std::int32_t snapped_u(double x) const {
    return grid_.lattice.snap_mm((x - 1 + grid_.offset_x) * grid_.spacing_u_mm);
  }
  std::int32_t snapped_v(double y) const {
    return grid_.lattice.snap_mm((y - 1 + grid_.offset_y) * grid_.spacing_v_mm);
  }

  // The crossing on the lattice, strictly between its two pixels.
  LatticePoint snapped(const Crossing& c) const {
    const auto between = [](std::int32_t at, std::int32_t low, std::int32_t high) {
      const std::int32_t margin = std::max(2, (high - low) / 50);
      return std::clamp(at, low + margin, high - margin);
    };
    if (c.along_v) {
      return {snapped_u(c.x), between(snapped_v(c.y + c.t), snapped_v(c.y), snapped_v(c.y + 1))};
    }
    return {between(snapped_u(c.x + c.t), snapped_u(c.x), snapped_u(c.x + 1)), snapped_v(c.y)};
  }

  const MaterialImage& image_;
  const PixelGrid& grid_;
  int columns_, rows_;
  std::vector<EdgeCrossing> crossings_;
  std::vector<NodeCell> cells_;       // by node of out_
  std::vector<std::uint32_t> above_;  // by column: the crossing on the last cell's upper edge
  std::uint32_t right_ = 0;           // the crossing on the last cell's right edge
  std::vector<Crossing> path_;
  LabelBorders out_;
};

}  // namespace

LabelBorders label_borders(const MaterialImage& image, const PixelGrid& grid) {
  return BorderTracer(image, grid).run();
}

Pslg outline_of(const LabelBorders& borders, const std::function<bool(MaterialNumber)>& is_wanted) {
  Pslg out;
  for_loops(
      borders, is_wanted,
      [&](MaterialNumber a, MaterialNumber b) { return is_wanted(a) == is_wanted(b); },
      [&](const ChainLoop& loop) { split_at_pinches(loop.ring(borders), out.rings); });
  normalise(out);
  return out;
}

std::vector<Pslg> material_outlines(const LabelBorders& borders) {
  std::vector<Pslg> out(borders.materials);
  for_loops(
      borders, [](MaterialNumber m) { return m != kNoMaterial; }, std::equal_to<>{},
      [&](const ChainLoop& loop) { out[loop.material - 1U].rings.push_back(loop.ring(borders)); });
  for (Pslg& pslg : out)
    normalise(pslg);
  return out;
}

}  // namespace trocar::pipeline
