// SPDX-License-Identifier: GPL-3.0-or-later
// The borders of several materials in a label map as one network: materials that touch share the
// border between them, point by point, so that there is no gap and no overlap.
#pragma once

#include <array>
#include <functional>

#include "formats/base/result.h"
#include "formats/geometry/slice_mesh.h"
#include "pipeline/contour/contour.h"
#include "pipeline/contour/label_pixels.h"
#include "pipeline/contour/simplification.h"

namespace trocar::pipeline {

/// A border between two materials: closed, or from a node to a node (its first and last point).
struct BorderChain {
  std::vector<LatticePoint> points;
  MaterialNumber left = kNoMaterial, right = kNoMaterial;  ///< never equal; kNoMaterial: outside
  bool is_closed = false;
};

/// A point in which three or four chains end.
struct BorderNode {
  struct End {
    std::uint32_t chain = 0;
    bool is_start = false;  ///< of the chain; else its end
  };
  LatticePoint at;
  std::array<End, 4> ends{};  ///< the first `count`, counter-clockwise
  int count = 0;
};

struct LabelNetwork {
  std::size_t materials = 0;
  std::vector<BorderNode> nodes;
  std::vector<BorderChain> chains;
};

/// Smooth borders (border_smoothing.h), on the lattice. The network is an embedding by
/// construction, whatever the pixels:
///  - Two neighbouring pixels of different materials have one crossing between them, strictly
///    between their centres. Beyond the image's border is no material; the crossings there are
///    fixed at the pixels' edges.
///  - In a cell of four pixels with two crossings, a segment joins these. With three or four there
///    is a node in the cell's middle, joined to all; but where a diagonal is connected
///    (connected_diagonal()), two segments cut off the other two corners. Within a cell nothing
///    crosses, and cells meet only in crossings.
/// So every material has the pixels' topology, and no ring passes a point twice. The
/// pixels are at least kMinStepsPerPixel steps wide. O(pixels + crossings).
LabelNetwork label_network(const MaterialImage& image, const PixelGrid& grid);

/// The outline of all materials for which is_wanted() holds, together; see contours(). Where it
/// passes a node twice, its rings touch there.
Pslg outline_of(const LabelNetwork& network, const std::function<bool(MaterialNumber)>& is_wanted);

/// One for each material (the first is number 1). Shared borders consist of the same points, in
/// opposite directions.
std::vector<Pslg> material_outlines(const LabelNetwork& network);

/// Proves that no point of the plane is in two materials, and that every point within the outline
/// of all of them is in one: each outline and that of all pass check_pslg(), and the sum of the
/// areas is the area of all. (Chains between two materials cancel in the sum of windings, so that
/// this is the winding of the outline of all: 0 or 1.) Errors: (bug) what is not so.
Result<void> check_network(const LabelNetwork& network);

/// Chain by chain, nodes fixed; a chain keeps its place among all others, its tolerance (two-sided)
/// and, by SimplificationMethod::kArea, its area, so that each ring keeps its own. See simplify()
/// of simplification.h.
LabelNetwork simplify(const LabelNetwork& network, const Lattice& lattice,
                      const SimplificationOptions& options);

/// Largest distance between chains of the same index, either way, in mm.
double hausdorff_mm(const LabelNetwork& full, const LabelNetwork& simple, const Lattice& lattice);

}  // namespace trocar::pipeline
