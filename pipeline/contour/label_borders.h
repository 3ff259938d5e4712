// SPDX-License-Identifier: GPL-3.0-or-later
// The borders between the materials of a label map, as chains and nodes. Materials that touch share
// the border between them, point by point, so that there is no gap and no overlap.
#pragma once

#include <array>
#include <functional>

#include "formats/geometry/slice_mesh.h"
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

/// Traces smooth borders (border_smoothing.h) on the lattice. Precondition: pixels are at least
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

}  // namespace trocar::pipeline
