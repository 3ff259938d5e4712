// SPDX-License-Identifier: GPL-3.0-or-later
// Implements simplify() of label_borders.h.
#include <algorithm>
#include <functional>
#include <optional>
#include <utility>

#include "formats/base/disjoint_sets.h"
#include "formats/geometry/lattice_box.h"
#include "formats/geometry/mesh_validity.h"
#include "pipeline/contour/border_walk.h"
#include "pipeline/contour/label_borders.h"

namespace trocar::pipeline {
namespace {

// Compares simplified chains, which do not cross, with the original chains. The two embeddings are
// topologically equal if at every node the chains leave in the same order, each loop around a
// material has the same orientation, and each connected component of the borders lies inside the
// same loops of the other components.
class Embedding {
 public:
  explicit Embedding(const LabelBorders& borders) : borders_(borders), components_(chains()) {
    for (const BorderNode& node : borders.nodes) {
      for (int k = 1; k < node.count; ++k)
        components_.join(node.ends[0].chain, node.ends[static_cast<std::size_t>(k)].chain);
    }
    members_.resize(chains());
    for (std::uint32_t c = 0; c < chains(); ++c)
      members_[components_.root(c)].push_back(c);
    const auto is_any = [](MaterialNumber /*m*/) { return true; };
    for_loops(borders, is_any, std::equal_to<>{},
              [this](const ChainLoop& loop) { loops_.push_back(loop); });
    for (const ChainLoop& loop : loops_)
      rings_.push_back(loop.ring(borders));
    for (std::uint32_t i = 0; i < loops_.size(); ++i)
      boxes_.push_back({box_around(rings_[i]), i, true});
    for (std::uint32_t c = 0; c < chains(); ++c) {
      if (members_[c].empty()) continue;
      LatticeBox box = box_around(borders.chains[c].points);
      for (const std::uint32_t member : members_[c])
        widen(box, borders.chains[member].points);
      boxes_.push_back({box, c, false});
    }
    std::sort(boxes_.begin(), boxes_.end(),
              [](const Boxed& a, const Boxed& b) { return a.box.low.x < b.box.low.x; });
  }

  void mark_differences(const std::vector<Ring>& lines, std::vector<char>& marks) {
    for (const BorderNode& node : borders_.nodes) {
      if (is_in_order(node, lines)) continue;
      for (int k = 0; k < node.count; ++k)
        marks[node.ends[static_cast<std::size_t>(k)].chain] = 1;
    }
    LabelBorders now = borders_;
    for (std::size_t c = 0; c < lines.size(); ++c)
      now.chains[c].points = lines[c];
    std::vector<Ring> rings_now;
    for (std::size_t i = 0; i < loops_.size(); ++i) {
      rings_now.push_back(loops_[i].ring(now));
      const std::int64_t area = doubled_area(rings_now[i]);
      if (area == 0 || (area > 0) != (doubled_area(rings_[i]) > 0)) mark_loop(i, marks);
    }
    for (auto i = boxes_.begin(); i != boxes_.end(); ++i) {
      for (auto j = i + 1; j != boxes_.end() && j->box.low.x <= i->box.high.x; ++j) {
        if (i->is_loop == j->is_loop || apart(i->box, j->box)) continue;
        const auto& [loop, other] = i->is_loop ? std::pair{*i, *j} : std::pair{*j, *i};
        if (components_.root(loops_[loop.index].chains[0] / 2) == other.index) continue;
        if (is_inside(borders_.chains[other.index].points, rings_[loop.index]) ==
            is_inside(lines[other.index], rings_now[loop.index]))
          continue;
        mark_loop(loop.index, marks);
        for (const std::uint32_t c : members_[other.index])
          marks[c] = 1;
      }
    }
  }

 private:
  // A loop, or a connected component of the borders.
  struct Boxed {
    LatticeBox box;
    std::uint32_t index;
    bool is_loop;
  };

  std::size_t chains() const { return borders_.chains.size(); }

  void mark_loop(std::size_t i, std::vector<char>& marks) const {
    for (const DirectedChain d : loops_[i].chains)
      marks[d / 2] = 1;
  }

  // The middle of an edge lies on no edge of another component's loop, so it decides for the line.
  static bool is_inside(const Ring& line, const Ring& loop) {
    return is_inside_ring(std::int64_t{line[0].x} + line[1].x, std::int64_t{line[0].y} + line[1].y,
                          loop);
  }

  // Do the node's first edges follow each other counter-clockwise within one turn?
  static bool is_in_order(const BorderNode& node, const std::vector<Ring>& lines) {
    constexpr LatticePoint kOrigin{0, 0};
    std::vector<LatticePoint> way;
    for (int k = 0; k < node.count; ++k) {
      const BorderNode::End end = node.ends[static_cast<std::size_t>(k)];
      const Ring& line = lines[end.chain];
      const LatticePoint next = end.is_start ? line[1] : line[line.size() - 2];
      way.push_back({next.x - node.at.x, next.y - node.at.y});
    }
    // Sorts by the angle from the first edge, in [0, 360) degrees.
    const auto half = [&](LatticePoint p) {
      const std::int64_t side = orient2d(kOrigin, way[0], p);
      return side > 0 ? 1 : side < 0 ? 3 : diametral_dot(way[0], p, kOrigin) > 0 ? 0 : 2;
    };
    for (std::size_t k = 1; k < way.size(); ++k) {
      const int before = half(way[k - 1]), after = half(way[k]);
      if (after == 0 || after < before) return false;
      if (after == before && orient2d(kOrigin, way[k - 1], way[k]) <= 0) return false;
    }
    return true;
  }

  const LabelBorders& borders_;
  DisjointSets components_;                          // the root is the component's first chain
  std::vector<std::vector<std::uint32_t>> members_;  // chains of each component, by its root
  std::vector<ChainLoop> loops_;
  std::vector<Ring> rings_;
  std::vector<Boxed> boxes_;
};

}  // namespace

LabelBorders simplify(const LabelBorders& borders, const Lattice& lattice,
                      const SimplificationOptions& options) {
  Pslg lines;
  std::vector<bool> is_open;
  for (const BorderChain& chain : borders.chains) {
    lines.rings.push_back(chain.points);
    is_open.push_back(!chain.is_closed);
  }
  std::optional<Embedding> embedding;  // only Douglas-Peucker needs it
  Pslg simple = simplify_lines(lines, is_open, lattice, options,
                               [&](const std::vector<Ring>& now, std::vector<char>& marks) {
                                 if (!embedding) embedding.emplace(borders);
                                 embedding->mark_differences(now, marks);
                               });
  LabelBorders out = borders;
  for (std::size_t c = 0; c < out.chains.size(); ++c)
    out.chains[c].points = std::move(simple.rings[c]);
  return out;
}

}  // namespace trocar::pipeline
