// SPDX-License-Identifier: GPL-3.0-or-later
// Walks around each material along its borders. LabelBorders (label_borders.h) holds the borders as
// chains of points between nodes, the points where borders join.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "pipeline/contour/label_borders.h"

namespace trocar::pipeline {

/// The number 2 c stands for chain c followed from its start, and 2 c + 1 for chain c followed
/// from its end.
using DirectedChain = std::uint32_t;

/// The chains along one closed boundary of a material, with the material on their left.
struct ChainLoop {
  MaterialNumber material = kNoMaterial;
  std::vector<DirectedChain> chains;

  /// Returns the loop as a ring of points. `borders` are the borders that were walked, or their
  /// simplified form. Where the material touches itself, the ring passes a node twice.
  Ring ring(const LabelBorders& borders) const {
    Ring out;
    for (const DirectedChain d : chains) {
      const BorderChain& c = borders.chains[d / 2];
      const std::ptrdiff_t last = c.is_closed ? 0 : 1;  // the next chain starts with the last point
      if (d % 2 == 0)
        out.insert(out.end(), c.points.begin(), c.points.end() - last);
      else
        out.insert(out.end(), c.points.rbegin(), c.points.rend() - last);
    }
    return out;
  }
};

/// Calls visit(loop) for each loop around a material m for which is_wanted(m) holds. If
/// is_same(left, right) holds for the two materials of a chain, these materials are treated as one,
/// and no loop contains the chain.
template <typename Wanted, typename Same, typename Visit>
void for_loops(const LabelBorders& borders, const Wanted& is_wanted, const Same& is_same,
               const Visit& visit) {
  // Directed chain d arrives at node heads[d].node, where it is entry heads[d].end of `ends`.
  struct Head {
    std::uint32_t node = 0;
    int end = 0;
  };
  std::vector<Head> heads(2 * borders.chains.size());
  for (std::uint32_t n = 0; n < borders.nodes.size(); ++n) {
    for (int k = 0; k < borders.nodes[n].count; ++k) {
      const BorderNode::End end = borders.nodes[n].ends[static_cast<std::size_t>(k)];
      // A chain that starts here arrives here when it is reversed.
      heads[2 * end.chain + (end.is_start ? 1 : 0)] = {n, k};
    }
  }
  const auto left = [&borders](DirectedChain d) {
    const BorderChain& chain = borders.chains[d / 2];
    return d % 2 == 0 ? chain.left : chain.right;
  };
  const auto is_inner = [&](DirectedChain d) { return is_same(left(d), left(d ^ 1U)); };
  // Goes clockwise around the node at which d arrives, to the next chain that leaves the node with
  // the material on its left but not on its right.
  const auto next = [&](DirectedChain d) {
    if (borders.chains[d / 2].is_closed) return d;
    const BorderNode& node = borders.nodes[heads[d].node];
    for (int k = heads[d].end;;) {
      k = (k + node.count - 1) % node.count;
      const BorderNode::End end = node.ends[static_cast<std::size_t>(k)];
      const DirectedChain out = 2 * end.chain + (end.is_start ? 0 : 1);
      if (!is_inner(out)) return out;
    }
  };
  std::vector<char> is_done(heads.size(), 0);
  ChainLoop loop;
  for (DirectedChain first = 0; first < heads.size(); ++first) {
    loop.material = left(first);
    if (is_done[first] != 0 || !is_wanted(left(first)) || is_inner(first)) continue;
    loop.chains.clear();
    DirectedChain at = first;
    do {
      is_done[at] = 1;
      loop.chains.push_back(at);
      at = next(at);
    } while (at != first);
    visit(loop);
  }
}

}  // namespace trocar::pipeline
