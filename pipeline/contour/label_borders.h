// SPDX-License-Identifier: GPL-3.0-or-later
// The borders between the materials of a label map, as chains and nodes. Materials that touch share
// the border between them, point by point, so that there is no gap and no overlap.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "formats/mesh/segment_grid.h"
#include "formats/mesh/slice_mesh.h"
#include "pipeline/contour/contour.h"
#include "pipeline/contour/simplification.h"
#include "pipeline/segment/label_pixels.h"

namespace trocar::pipeline {

/// A border between two materials, or between a material and the background. It either is a closed
/// ring without nodes, or its first and last point are nodes. The two may be the same node.
struct BorderChain {
  std::vector<LatticePoint> points;
  /// The materials on the two sides, which are different. kNoMaterial stands for the background.
  MaterialNumber left = kNoMaterial, right = kNoMaterial;
  bool is_closed = false;
};

/// A point at which three or four ends of chains meet.
struct BorderNode {
  struct End {
    std::uint32_t chain = 0;
    bool is_start = false;  ///< true if the chain's first point is here, false if its last is
  };
  LatticePoint at;
  std::array<End, 4> ends{};  ///< chain ends, counter-clockwise; the first `count` are used
  int count = 0;
};

/// The borders of all materials of a slice.
struct LabelBorders {
  std::size_t materials = 0;  ///< number of materials; they have the numbers 1 to `materials`
  std::vector<BorderNode> nodes;
  std::vector<BorderChain> chains;
};

/// Traces smooth borders on the lattice. Precondition: pixels are at least
/// kMinStepsPerPixel steps wide. No two borders cross, whatever the pixels are:
///  - Exactly one point of a border, called a crossing, lies between the centres of any two
///    neighbouring pixels of different materials. Outside the image every pixel counts as
///    background. Smoothing does not move the crossings at the image's border: they lie on the
///    outer edges of the pixels.
///  - A cell is the square between the centres of four pixels. If it has two crossings, a segment
///    joins them. If it has three or four, a node in the cell's middle is joined to all of them.
///    There is one exception: if connected_diagonal() (label_pixels.h) connects two diagonal pixels
///    of the same material, two segments cut off the other two pixels.
///  - Within a cell no two segments intersect, and segments of two cells meet only at crossings.
/// Every material therefore has the topology of its pixels, which are connected along their edges
/// and by connected_diagonal(). No ring of a material passes a point twice. O(pixels + crossings).
LabelBorders label_borders(const MaterialImage& image, const PixelGrid& grid);

/// The outline of the union of all materials for which is_wanted() holds. Its rings have the
/// properties stated at contours() (contour.h): where the outline passes a node twice, it is
/// divided into rings that touch.
Pslg outline_of(const LabelBorders& borders, const std::function<bool(MaterialNumber)>& is_wanted);

/// One outline for each material; the first belongs to material number 1. The outlines of two
/// neighbours have the same points along their common border, in opposite order.
std::vector<Pslg> material_outlines(const LabelBorders& borders);

/// Simplifies each chain; nodes do not move. The two-sided Hausdorff distance between each chain
/// and its original is at most the tolerance, and the topology of the borders does not change.
/// SimplificationMethod::kArea also keeps the area on both sides of each chain and therefore the
/// area of each ring. See simplify() of simplification.h.
LabelBorders simplify(const LabelBorders& borders, const Lattice& lattice,
                      const SimplificationOptions& options);

// Walks around each material along its borders. LabelBorders (label_borders.h) holds the borders as
// chains of points between nodes, the points where borders join.

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

// Smooths the borders between labels. A border is given by its crossings, the points at which it
// crosses grid lines. A grid line joins the centres of two neighbouring pixels.

/// Smallest distance between a smoothed crossing and the centre of either of its two pixels, in
/// pixels.
inline constexpr double kMinPixelDistance = 0.02;

/// The two ends of an open border, in pixels.
struct BorderEnds {
  Point from, to;
};

/// Moves the crossings of a border along their grid lines onto a smooth curve. Crossings that are
/// `fixed` do not move. They divide the border into sections, each of which is smoothed by itself;
/// a section of fewer than 6 crossings stays as it is. Precondition: every crossing that is not
/// fixed lies half-way between its two pixels.
///
/// The curve is the section convolved with the kernel 2 G(s) - G(sqrt(2) s), which keeps curvature.
/// G(s) is a Gaussian with standard deviation s along the section. Lengths are counted in
/// crossings: s is a fourteenth of the section's length, but at most 3 crossings. Each crossing
/// stays between its two pixels, so borders cannot cross. The areas on both sides of the border
/// stay the same if the crossings can move far enough for this between their pixels. For a closed
/// border `ends` has no value. If a closed border has fixed crossings, it starts at one of them
/// after the call. O(n).
void smooth_border(std::vector<Crossing>& border, const std::optional<BorderEnds>& ends);

}  // namespace trocar::pipeline
