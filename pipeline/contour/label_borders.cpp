// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/contour/label_borders.h"

#include <cstring>

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
    if (c.along_v)
      return {snapped_u(c.x), between(snapped_v(c.y + c.t), snapped_v(c.y), snapped_v(c.y + 1))};
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

constexpr std::size_t kCrossingsPerSigma = 14;
constexpr std::size_t kMaxSigma = 3;
constexpr std::size_t kMaxKernelCrossings = kCrossingsPerSigma * kMaxSigma;  // crossings
constexpr std::size_t kMinCrossings = 6;  // a shorter border would hardly move: sigma is below 0.4
// In each pass, crossings that the curve would move beyond their pixels are clamped, and the next
// curve takes account of that.
constexpr int kPasses = 6;
constexpr double kFar = 1e9;
// Rounds that restore the area after the last pass; one is enough after the earlier ones.
constexpr int kRounds = 8;
constexpr std::size_t kWindow = 4;  // crossings on either side where the curve may meet a grid line

// The kernel from its middle outwards, for borders of n crossings.
std::vector<double> make_kernel(std::size_t n) {
  const double sigma = static_cast<double>(n) / static_cast<double>(kCrossingsPerSigma);
  const auto radius = static_cast<std::size_t>(std::ceil(3 * std::sqrt(2.0) * sigma));
  std::array<double, 2> sums{};
  const auto gauss = [sigma](std::size_t k, int twice) {
    const auto x = static_cast<double>(k);
    return std::exp(-x * x / (2 * sigma * sigma * (1 + twice)));
  };
  for (std::size_t k = 0; k <= radius; ++k) {
    for (int twice = 0; twice < 2; ++twice)
      sums[static_cast<std::size_t>(twice)] += (k == 0 ? 1 : 2) * gauss(k, twice);
  }
  // Weights are rounded to 2^-24, because the last bits of exp() may differ between machines.
  constexpr double kStep = 1.0 / (1 << 24);
  std::vector<double> out(radius + 1);
  double rest = 0;
  for (std::size_t k = 1; k <= radius; ++k) {
    out[k] = std::rint((2 * gauss(k, 0) / sums[0] - gauss(k, 1) / sums[1]) / kStep) * kStep;
    rest += 2 * out[k];
  }
  out[0] = 1 - rest;
  return out;
}

std::span<const double> kernel(std::size_t n) {
  static const std::vector<std::vector<double>> kKernels = [] {
    std::vector<std::vector<double>> out(kMaxKernelCrossings + 1);
    for (std::size_t k = kMinCrossings; k <= kMaxKernelCrossings; ++k)
      out[k] = make_kernel(k);
    return out;
  }();
  return kKernels[std::min(n, kMaxKernelCrossings)];
}

Point position(const Crossing& c) {
  return {c.x + (c.along_v ? 0 : c.t), c.y + (c.along_v ? c.t : 0)};
}

// Consecutive crossings none of which is fixed.
class FreeCrossings {
 public:
  FreeCrossings(std::span<Crossing> crossings, const std::optional<BorderEnds>& ends)
      : crossings_(crossings), ends_(ends), n_(crossings.size()) {}

  void smooth() {
    const std::span<const double> weights = kernel(n_);
    const std::size_t margin = std::max(weights.size() - 1, kWindow);
    std::vector<Point> points(n_), curve(n_);
    locate(points);
    const double area = doubled_area(points);
    for (int pass = 0; pass < kPasses; ++pass) {
      const std::vector<Point> wide = extended(points, margin);
      for (std::size_t i = 0; i < n_; ++i) {
        const Point* at = &wide[i + margin];
        Point sum{weights[0] * at->x, weights[0] * at->y};
        for (std::size_t k = 1; k < weights.size(); ++k) {
          const Point &before = *(at - k), &after = *(at + k);
          sum.x += weights[k] * (before.x + after.x);
          sum.y += weights[k] * (before.y + after.y);
        }
        curve[i] = sum;
      }
      put_back(extended(curve, kWindow));
      restore(area, points, pass + 1 < kPasses ? 1 : kRounds);
    }
  }

 private:
  void locate(std::vector<Point>& points) const {
    for (std::size_t i = 0; i < n_; ++i)
      points[i] = position(crossings_[i]);
  }

  // Beyond its ends an open border continues as its own point reflection; a closed one is periodic.
  std::vector<Point> extended(const std::vector<Point>& points, std::size_t margin) const {
    std::vector<Point> out(n_ + 2 * margin);
    std::copy(points.begin(), points.end(), out.begin() + static_cast<std::ptrdiff_t>(margin));
    for (std::size_t k = 0; k < margin; ++k) {
      Point &before = out[margin - 1 - k], &after = out[margin + n_ + k];
      if (!ends_) {
        before = points[n_ - 1 - k % n_];
        after = points[k % n_];
      } else if (k == 0) {
        before = ends_->from;
        after = ends_->to;
      } else {
        const Point p = points[k - 1], q = points[n_ - k];
        before = {2 * ends_->from.x - p.x, 2 * ends_->from.y - p.y};
        after = {2 * ends_->to.x - q.x, 2 * ends_->to.y - q.y};
      }
    }
    return out;
  }

  // Moves each crossing to the point where the curve meets its grid line, near the crossing's own
  // point of the curve.
  void put_back(const std::vector<Point>& curve) {
    for (std::size_t i = 0; i < n_; ++i) {
      Crossing& c = crossings_[i];
      const std::size_t middle = i + kWindow;
      const double line = c.along_v ? c.x : c.y;
      const auto along = [&c](Point p) { return c.along_v ? p.y : p.x; };
      const auto off = [&c, line](Point p) { return (c.along_v ? p.x : p.y) - line; };
      const double here = along(curve[middle]);
      double best = here, least = kFar;
      const auto meet = [&](const Point& p, const Point& q) {
        const double f = off(p), g = off(q);
        if ((f > 0) == (g > 0)) return;
        const double at = along(p) + f / (f - g) * (along(q) - along(p));
        if (std::abs(at - here) < least) least = std::abs(at - here), best = at;
      };
      for (std::size_t k = 0; k < kWindow && least == kFar; ++k) {
        meet(curve[middle - k - 1], curve[middle - k]);
        meet(curve[middle + k], curve[middle + k + 1]);
      }
      c.t = clamped(best - (c.along_v ? c.y : c.x));
    }
  }

  static double clamped(double t) {
    return std::clamp(t, kMinPixelDistance, 1 - kMinPixelDistance);
  }

  Point before(const std::vector<Point>& points, std::size_t i) const {
    return i > 0 ? points[i - 1] : ends_ ? ends_->from : points[n_ - 1];
  }
  Point after(const std::vector<Point>& points, std::size_t i) const {
    return i + 1 < n_ ? points[i + 1] : ends_ ? ends_->to : points[0];
  }

  // Twice the area inside the border, which is closed by the line from its end to its start if it
  // is open. Coordinates are relative to the first point.
  double doubled_area(const std::vector<Point>& points) const {
    const Point o = before(points, 0);
    double sum = 0;
    for (std::size_t i = 0; i < n_; ++i) {
      const Point p = points[i], q = after(points, i);
      sum += (p.x - o.x) * (q.y - o.y) - (p.y - o.y) * (q.x - o.x);
    }
    return sum;
  }

  // Moves the crossings in proportion to the area that each one's move gains, until the area is
  // `area`. Few rounds suffice: only the products of neighbours' moves and the clamped crossings
  // remain after each.
  void restore(double area, std::vector<Point>& points, int rounds) {
    constexpr double kNegligible = 1e-7;  // pixels^2
    for (int round = 0;; ++round) {
      locate(points);
      const double missing = area - doubled_area(points);
      if (round == rounds || std::abs(missing) < kNegligible) return;
      double squares = 0;
      for (std::size_t i = 0; i < n_; ++i) {
        const double g = free_gain(points, i, missing);
        squares += g * g;
      }
      if (squares < 1e-9) return;
      for (std::size_t i = 0; i < n_; ++i) {
        Crossing& c = crossings_[i];
        c.t = clamped(c.t + free_gain(points, i, missing) * missing / squares);
      }
    }
  }

  // The change of twice the area if crossing i moves by one pixel; 0 if it cannot move in the
  // direction that reduces `missing`.
  double free_gain(const std::vector<Point>& points, std::size_t i, double missing) const {
    const Point p = before(points, i), q = after(points, i);
    const Crossing& c = crossings_[i];
    const double gain = c.along_v ? p.x - q.x : q.y - p.y;
    const bool is_up = gain * missing > 0;
    return is_up ? (c.t < 1 - kMinPixelDistance ? gain : 0) : (c.t > kMinPixelDistance ? gain : 0);
  }

  std::span<Crossing> crossings_;
  const std::optional<BorderEnds>& ends_;
  std::size_t n_;
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

void smooth_border(std::vector<Crossing>& border, const std::optional<BorderEnds>& ends) {
  const auto is_fixed = [](const Crossing& c) { return c.fixed; };
  const auto first = std::find_if(border.begin(), border.end(), is_fixed);
  if (first == border.end()) {
    if (border.size() >= kMinCrossings) FreeCrossings(border, ends).smooth();
    return;
  }
  if (!ends) std::rotate(border.begin(), first, border.end());
  for (std::size_t i = 0; i < border.size();) {
    if (border[i].fixed) {
      ++i;
      continue;
    }
    std::size_t end = i;
    while (end < border.size() && !border[end].fixed)
      ++end;
    if (end - i >= kMinCrossings) {
      const std::optional<BorderEnds> run_ends = BorderEnds{
          i > 0 ? position(border[i - 1]) : ends->from, end < border.size() ? position(border[end])
                                                        : ends              ? ends->to
                                                                            : position(border[0])};
      FreeCrossings(std::span(border).subspan(i, end - i), run_ends).smooth();
    }
    i = end;
  }
}

}  // namespace trocar::pipeline
