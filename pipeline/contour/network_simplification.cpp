// SPDX-License-Identifier: GPL-3.0-or-later
// simplify() and hausdorff_mm() of label_network.h.
#include <algorithm>
#include <functional>
#include <numeric>
#include <optional>
#include <utility>

#include "formats/geometry/lattice_box.h"
#include "formats/geometry/mesh_validity.h"
#include "pipeline/contour/label_network.h"
#include "pipeline/contour/network_walk.h"

namespace trocar::pipeline {
namespace {

// Compares an embedding of the network's chains, in which nothing crosses, with the network itself.
// They are the same but for a deformation if at every node the chains leave in the same order, each
// loop round a material has the same orientation, and each connected part of the network lies
// inside the same loops of the others.
class Embedding {
 public:
  explicit Embedding(const LabelNetwork& network) : network_(network), part_(chains()) {
    std::iota(part_.begin(), part_.end(), 0U);
    for (const BorderNode& node : network.nodes) {
      for (int k = 1; k < node.count; ++k) {
        const std::uint32_t p = part(node.ends[0].chain),
                            q = part(node.ends[static_cast<std::size_t>(k)].chain);
        part_[std::max(p, q)] = std::min(p, q);
      }
    }
    members_.resize(chains());
    for (std::uint32_t c = 0; c < chains(); ++c)
      members_[part(c)].push_back(c);
    const NetworkWalk walk(network);
    const auto is_any = [](MaterialNumber /*m*/) { return true; };
    walk.for_loops(is_any, std::equal_to<>{},
                   [this](const ChainLoop& loop) { loops_.push_back(loop); });
    for (const ChainLoop& loop : loops_)
      rings_.push_back(loop.ring(network));
    for (std::uint32_t i = 0; i < loops_.size(); ++i)
      boxes_.push_back({box_around(rings_[i]), i, true});
    for (std::uint32_t c = 0; c < chains(); ++c) {
      if (members_[c].empty()) continue;
      LatticeBox box = box_around(network.chains[c].points);
      for (const std::uint32_t member : members_[c])
        widen(box, network.chains[member].points);
      boxes_.push_back({box, c, false});
    }
    std::sort(boxes_.begin(), boxes_.end(),
              [](const Boxed& a, const Boxed& b) { return a.box.low.x < b.box.low.x; });
  }

  void mark_differences(const std::vector<Ring>& lines, std::vector<char>& marks) {
    for (const BorderNode& node : network_.nodes) {
      if (is_in_order(node, lines)) continue;
      for (int k = 0; k < node.count; ++k)
        marks[node.ends[static_cast<std::size_t>(k)].chain] = 1;
    }
    LabelNetwork now = network_;
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
        const auto& [loop, of_part] = i->is_loop ? std::pair{*i, *j} : std::pair{*j, *i};
        if (part(loops_[loop.index].chains[0] / 2) == of_part.index) continue;
        if (is_inside(network_.chains[of_part.index].points, rings_[loop.index]) ==
            is_inside(lines[of_part.index], rings_now[loop.index]))
          continue;
        mark_loop(loop.index, marks);
        for (const std::uint32_t c : members_[of_part.index])
          marks[c] = 1;
      }
    }
  }

 private:
  // A loop, or a connected part of the network.
  struct Boxed {
    LatticeBox box;
    std::uint32_t index;
    bool is_loop;
  };

  std::size_t chains() const { return network_.chains.size(); }
  std::uint32_t part(std::uint32_t c) {
    while (part_[c] != c)
      c = part_[c] = part_[part_[c]];
    return c;
  }

  void mark_loop(std::size_t i, std::vector<char>& marks) const {
    for (const DirectedChain d : loops_[i].chains)
      marks[d / 2] = 1;
  }

  // The middle of an edge lies on no edge of another part's loop.
  static bool is_inside(const Ring& line, const Ring& loop) {
    return is_inside_ring(std::int64_t{line[0].x} + line[1].x, std::int64_t{line[0].y} + line[1].y,
                          loop);
  }

  // Do the node's first edges follow each other counter-clockwise, once round?
  static bool is_in_order(const BorderNode& node, const std::vector<Ring>& lines) {
    constexpr LatticePoint kOrigin{0, 0};
    std::vector<LatticePoint> way;
    for (int k = 0; k < node.count; ++k) {
      const BorderNode::End end = node.ends[static_cast<std::size_t>(k)];
      const Ring& line = lines[end.chain];
      const LatticePoint next = end.is_start ? line[1] : line[line.size() - 2];
      way.push_back({next.x - node.at.x, next.y - node.at.y});
    }
    // By the angle from the first one, in [0, 360) degrees.
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

  const LabelNetwork& network_;
  std::vector<std::uint32_t> part_;                  // by chain: the first chain of its part
  std::vector<std::vector<std::uint32_t>> members_;  // of parts, by their first chain
  std::vector<ChainLoop> loops_;
  std::vector<Ring> rings_;
  std::vector<Boxed> boxes_;
};

// The chains as lines, and which of them are open.
std::pair<Pslg, std::vector<bool>> lines_of(const LabelNetwork& network) {
  std::pair<Pslg, std::vector<bool>> out;
  for (const BorderChain& chain : network.chains) {
    out.first.rings.push_back(chain.points);
    out.second.push_back(!chain.is_closed);
  }
  return out;
}

}  // namespace

LabelNetwork simplify(const LabelNetwork& network, const Lattice& lattice,
                      const SimplificationOptions& options) {
  const auto [lines, is_open] = lines_of(network);
  std::optional<Embedding> embedding;  // of Douglas-Peucker
  Pslg simple = simplify_lines(lines, is_open, lattice, options,
                               [&](const std::vector<Ring>& now, std::vector<char>& marks) {
                                 if (!embedding) embedding.emplace(network);
                                 embedding->mark_differences(now, marks);
                               });
  LabelNetwork out = network;
  for (std::size_t c = 0; c < out.chains.size(); ++c)
    out.chains[c].points = std::move(simple.rings[c]);
  return out;
}

double hausdorff_mm(const LabelNetwork& full, const LabelNetwork& simple, const Lattice& lattice) {
  const auto [lines, is_open] = lines_of(full);
  return hausdorff_mm(lines, lines_of(simple).first, lattice, is_open);
}

}  // namespace trocar::pipeline
