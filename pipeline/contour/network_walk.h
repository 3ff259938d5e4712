// SPDX-License-Identifier: GPL-3.0-or-later
// How the chains of a LabelNetwork follow each other round its materials.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "pipeline/contour/label_network.h"

namespace trocar::pipeline {

/// Chain c from its start is number 2 c, and 2 c + 1 from its end.
using DirectedChain = std::uint32_t;

/// Chains that follow each other round a piece of a material, which is on their left.
struct ChainLoop {
  MaterialNumber material = kNoMaterial;
  std::vector<DirectedChain> chains;

  /// By the network's points, or those of one with the same chains. It passes a node twice where
  /// the material does.
  Ring ring(const LabelNetwork& network) const {
    Ring out;
    for (const DirectedChain d : chains) {
      const BorderChain& c = network.chains[d / 2];
      const std::ptrdiff_t last = c.is_closed ? 0 : 1;  // the next chain begins with it
      if (d % 2 == 0)
        out.insert(out.end(), c.points.begin(), c.points.end() - last);
      else
        out.insert(out.end(), c.points.rbegin(), c.points.rend() - last);
    }
    return out;
  }
};

class NetworkWalk {
 public:
  /// The network must outlive it.
  explicit NetworkWalk(const LabelNetwork& network)
      : network_(network), heads_(2 * network.chains.size()) {
    for (std::uint32_t n = 0; n < network.nodes.size(); ++n) {
      for (int k = 0; k < network.nodes[n].count; ++k) {
        const BorderNode::End end = network.nodes[n].ends[static_cast<std::size_t>(k)];
        // A chain that starts here arrives here when it is reversed.
        heads_[2 * end.chain + (end.is_start ? 1 : 0)] = {n, k};
      }
    }
  }

  /// Calls visit(loop) for the loops of the materials that are wanted. Materials for which
  /// is_same(left, right) holds count as one.
  template <typename Wanted, typename Same, typename Visit>
  void for_loops(const Wanted& is_wanted, const Same& is_same, const Visit& visit) const {
    std::vector<char> is_done(heads_.size(), 0);
    ChainLoop loop;
    for (DirectedChain first = 0; first < heads_.size(); ++first) {
      loop.material = left(first);
      if (is_done[first] != 0 || !is_wanted(left(first)) || is_same(left(first), right(first)))
        continue;
      loop.chains.clear();
      DirectedChain at = first;
      do {
        is_done[at] = 1;
        loop.chains.push_back(at);
        at = next(at, is_same);
      } while (at != first);
      visit(loop);
    }
  }

 private:
  struct Head {
    std::uint32_t node = 0;
    int end = 0;
  };

  const BorderChain& chain(DirectedChain d) const { return network_.chains[d / 2]; }
  MaterialNumber left(DirectedChain d) const { return d % 2 == 0 ? chain(d).left : chain(d).right; }
  MaterialNumber right(DirectedChain d) const { return left(d ^ 1U); }

  // The first chain clockwise from the node's end that has the material on the left only.
  template <typename Same>
  DirectedChain next(DirectedChain d, const Same& is_same) const {
    if (chain(d).is_closed) return d;
    const Head head = heads_[d];
    const BorderNode& node = network_.nodes[head.node];
    for (int k = head.end;;) {
      k = (k + node.count - 1) % node.count;
      const BorderNode::End end = node.ends[static_cast<std::size_t>(k)];
      const DirectedChain out = 2 * end.chain + (end.is_start ? 0 : 1);
      if (!is_same(left(out), right(out))) return out;
    }
  }

  const LabelNetwork& network_;
  std::vector<Head> heads_;  // by directed chain: where it arrives
};

}  // namespace trocar::pipeline
