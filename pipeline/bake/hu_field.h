// SPDX-License-Identifier: GPL-3.0-or-later
// The HU of a slice's material as a field over its mesh, with one value for each vertex and linear
// interpolation in between.
//
// Values sampled at the vertices would be far too low, because most vertices lie on the outline,
// where HU equal the threshold. The field h is therefore a least-squares fit to the material's
// pixels. It minimises
//   sum_p (HU(p) - h(p))^2 + smoothing * sum_ab (h(a) - h(b))^2
// where p are all pixels with their centre in the mesh, and ab are all edges of the mesh. In the
// second sum a boundary edge has half the weight. The second sum determines h at vertices with few
// pixels around them, and makes the field cheaper to store. If a constant is added to h on a
// connected component of the mesh, only the first sum changes. At the minimum no such constant
// makes this sum smaller, so the mean of h over the pixels of a component is the mean of their HU.
#pragma once

#include <cstdint>
#include <vector>

#include "formats/asset/draco_mesh.h"
#include "formats/mesh/slice_mesh.h"
#include "pipeline/contour/contour.h"

namespace trocar::pipeline {

struct HuFieldOptions {
  /// The factor in the formula above. A larger factor makes the field cheaper to store, but less
  /// exact. With 0.01 instead of 0.001, the error grows by less than 4 % for a scan of the vertebra
  /// L3, which has only as many pixels as vertices, and by less than 0.1 % for other scans.
  double smoothing = 0.01;
  int step = kHuStep;  ///< values are rounded to multiples of it; 0: not rounded
};

struct HuField {
  std::vector<float> values;  ///< HU of each vertex
  std::int64_t pixels = 0;    ///< number of pixels with their centre in the mesh
  /// Mean and root mean square of (field - HU of the pixel) over these pixels; 0 without pixels.
  double bias_hu = 0, rms_hu = 0;
};

/// Neighbouring pixels in one row whose centres lie in one triangle: the pixels (x, y) of the
/// cropped image with first_x <= x < end_x.
struct PixelRow {
  std::uint32_t triangle = 0;
  int y = 0, first_x = 0, end_x = 0;
};

/// Lists the pixels whose centres, rounded to the lattice, lie in the mesh. Each pixel is listed
/// once. The list is ordered by triangle and then by y. A centre on an edge belongs to the triangle
/// on the side of larger x or, if the edge is horizontal, of larger y. If this side is outside the
/// mesh, the pixel is not listed. All decisions are exact. Precondition: `mesh` is valid.
/// O(pixels + t + r) for t triangles, where r is the number of rows that each triangle crosses,
/// summed over all triangles.
std::vector<PixelRow> pixel_rows(const SliceMesh& mesh, const PixelGrid& grid, int width,
                                 int height);

/// Fits the field to an image of HU. Precondition: `mesh` is valid. If a connected component of
/// the mesh contains no pixel's centre, the field is fitted there to the pixels nearest to the
/// vertices. The values are then rounded such that |HuField::bias_hu| stays far below one step.
/// The same input gives the same bits. O(n^1.5) for a component of n vertices, because of the
/// sparse Cholesky factors.
HuField fit_hu_field(const SliceMesh& mesh, const Image& hu, const PixelGrid& grid,
                     const HuFieldOptions& options = {});

}  // namespace trocar::pipeline
