// SPDX-License-Identifier: GPL-3.0-or-later
// The outline of the material as rings on the lattice, including holes and nested rings.
#pragma once

#include "formats/geometry/slice_mesh.h"
#include "pipeline/segment/segmentation.h"

namespace trocar::pipeline {

enum class ContourKind {
  kSubpixel,  ///< marching squares; contour_crossing.h places the vertices between pixels
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
/// curve (border_smoothing.h) that joins the crossings computed from values.
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

}  // namespace trocar::pipeline
