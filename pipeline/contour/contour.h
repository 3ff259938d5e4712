// SPDX-License-Identifier: GPL-3.0-or-later
// A grid that finds the contour edges that may be near a point. Each cell lists the edges whose
// bounding boxes intersect the cell. The grid is built once.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "formats/mesh/lattice.h"
#include "formats/mesh/slice_mesh.h"
#include "pipeline/segment/segmentation.h"

namespace trocar::pipeline {

class ContourGrid {
 public:
  /// An entry in the list of a cell: the consecutive edges `first` to `last` of one ring.
  /// `next_in_cell` is the index of the cell's next run, or kNone.
  struct Run {
    std::uint32_t first, last, next_in_cell;
  };

  /// Makes an empty grid over the box. `edges` is the number of edges that will be added; the grid
  /// has about as many cells.
  ContourGrid(const LatticeBox& box, std::size_t edges) : cells_(box, static_cast<double>(edges)) {
    heads_.assign(cells_.count(), kNone);
    runs_.reserve(edges);
  }

  /// Adds an edge. Precondition: the edges of a ring are added in the ring's order and have
  /// consecutive numbers from `first_of_ring` on. At least one number between the numbers of two
  /// rings is unused.
  void add(std::uint32_t edge, LatticePoint from, LatticePoint to, std::uint32_t first_of_ring) {
    any_cell(box_around(from, to), [&](std::uint32_t& head) {
      if (head != kNone && runs_[head].first >= first_of_ring && runs_[head].last + 1 >= edge) {
        runs_[head].last = edge;
      } else {
        runs_.push_back({edge, edge, head});
        head = static_cast<std::uint32_t>(runs_.size() - 1);
      }
      return false;
    });
  }

  /// Returns true if is_wanted(run) holds for a run of a cell that the box intersects.
  template <typename Wanted>
  bool any_near(const LatticeBox& box, const Wanted& is_wanted) {
    return any_cell(box, [&](std::uint32_t head) {
      for (; head != kNone; head = runs_[head].next_in_cell)
        if (is_wanted(runs_[head])) return true;
      return false;
    });
  }

 private:
  static constexpr std::uint32_t kNone = 0xffffffff;

  // Calls visit(head) for the cells that intersect the box, until visit() returns true. Returns
  // whether visit() returned true. Points outside the grid belong to its outermost cells.
  template <typename Visit>
  bool any_cell(const LatticeBox& box, const Visit& visit) {
    const auto cell = [this](std::int32_t at, std::int32_t low, std::int32_t count) {
      const double c = (static_cast<double>(at) - low) / cells_.size;
      return static_cast<std::int32_t>(std::clamp(c, 0.0, static_cast<double>(count - 1)));
    };
    const std::int32_t x0 = cell(box.low.x, cells_.low.x, cells_.columns),
                       x1 = cell(box.high.x, cells_.low.x, cells_.columns);
    const std::int32_t y0 = cell(box.low.y, cells_.low.y, cells_.rows),
                       y1 = cell(box.high.y, cells_.low.y, cells_.rows);
    for (std::int32_t y = y0; y <= y1; ++y) {
      for (std::int32_t x = x0; x <= x1; ++x)
        if (visit(heads_[static_cast<std::size_t>(y) * static_cast<std::size_t>(cells_.columns) +
                         static_cast<std::size_t>(x)]))
          return true;
    }
    return false;
  }

  LatticeCells cells_;
  std::vector<std::uint32_t> heads_;  // for each cell: the index of its first run, or kNone
  std::vector<Run> runs_;
};

// The outline of the material as rings on the lattice, including holes and nested rings.

enum class ContourKind {
  kSubpixel,  ///< marching squares; GridLine places the vertices between pixels
  kPixel,     ///< the paper's chains through pixel centres (Suzuki and Abe, cv::findContours)
};

/// Maps pixels to the slice plane: u = (x + offset_x) * spacing_u_mm, v = (y + offset_y) *
/// spacing_v_mm. Points are then rounded to the lattice.
struct PixelGrid {
  double spacing_u_mm = 1, spacing_v_mm = 1;
  int offset_x = 0, offset_y = 0;  ///< origin of a cropped image in the full image, pixels
  Lattice lattice;
};

/// Smallest width of a pixel, in lattice steps, for which the properties stated at contours() hold.
inline constexpr int kMinStepsPerPixel = 8;

/// Traces the outline with material on the left: outer rings are counter-clockwise in (u, v), holes
/// clockwise. Rings are simple, touch only at vertices and never cross (contour.cpp gives the
/// reasons). Everything outside the image is treated as outside the material. Precondition: pixels
/// are at least kMinStepsPerPixel steps wide. O(pixels + vertices log vertices).
///
/// SolidBone and ScannerTable (pipeline/segment) add pixels to the material or remove them. For
/// this they move values across the iso-value (Field::changed). Between a changed and an unchanged
/// pixel, the values do not say where the border lies. With kSubpixel, the border there is a smooth
/// curve (label_borders.h) that joins the crossings computed from values.
Pslg contours(const Field& field, const PixelGrid& grid, ContourKind kind);

/// Lets each ring start at its smallest vertex, and sorts the rings.
void normalise(Pslg& outline);

/// Areas by which a step changes the material of a slice.
struct AreaChange {
  double dropped_mm2 = 0;  ///< of islands
  double filled_mm2 = 0;   ///< of holes
};

/// Removes rings with an area below `min_area_mm2`: small islands vanish and small holes are
/// filled. Rings inside a removed ring are even smaller, so they are removed too. Adds the areas of
/// all removed rings to `change`, so the area of the material grows by filled - dropped.
Pslg drop_small_rings(Pslg contours, double min_area_mm2, const Lattice& lattice,
                      AreaChange* change = nullptr);

// Finds the point at which an iso-contour crosses a grid line, which joins the centres of two
// neighbouring pixels. The result is more accurate than linear interpolation. Also moves such
// crossings so that the polygon through them has the area that the curve encloses.

/// Eight samples along a grid line, each minus the iso-value. The contour passes between value[3]
/// and value[4], exactly one of which is >= 0. Only the samples with the indices `first` to `last`
/// lie in the image, with 0 <= first <= 3 and 4 <= last <= 7.
struct GridLine {
  std::array<double, 8> value{};
  int first = 0, last = 7;
};

/// The crossing as a fraction in [0, 1] of the way from sample 3 to sample 4. There are two cases:
///  - The samples rise or fall monotonically from one constant value to another, and the iso-value
///    is about half-way between the two constants. The samples are then those of a blurred edge.
///    Each pixel is the average over its area, so the sum of the samples says where a sharp
///    straight edge lies, exactly. The crossing is the position of the sharp edge whose samples
///    have the same sum.
///  - Otherwise a cubic interpolates between samples 3 and 4 (Steffen, Astronomy and Astrophysics
///    239, 1990), and the crossing is its only zero there. The cubic is monotone, and linear if the
///    samples are linear.
double crossing(const GridLine& line);

/// A crossing on the grid line from pixel (x, y) to the next pixel in u, or in v if `along_v` is
/// true. It lies at the fraction t of the way.
struct Crossing {
  int x = 0, y = 0;
  bool along_v = false;
  bool fixed = false;  ///< true if the crossing must not move, as at the image's border
  double t = 0;
};

/// Moves the crossings of a closed ring (material on the left) along their grid lines. At first the
/// crossings lie on a smooth curve. Afterwards the polygon through them has the area that this
/// curve encloses. A chord of length c cuts an area of k c^3 / 12 off a curve of curvature k.
/// Crossings therefore move outwards where the curve is convex. They move by some hundredths of a
/// pixel, at most by a sixteenth. O(n).
void restore_chord_areas(std::span<Crossing> ring);

}  // namespace trocar::pipeline
