// SPDX-License-Identifier: GPL-3.0-or-later
// The HU of a slice's material as a field over its mesh, with one value for each vertex and linear
// interpolation in between.
//
// Values sampled at the vertices would be far too low, because most vertices lie on the outline,
// where HU equal the threshold. The field h is therefore the least-squares fit to the material's
// pixels: the field that minimises
//   sum_p (HU(p) - h(p))^2 + smoothing * sum_ab (h(a) - h(b))^2
// over all pixels p in the mesh and all edges ab of the mesh, where a boundary edge has half the
// weight. The second sum determines h at vertices with few pixels around them, and makes the field
// cheaper to store. A change of h by a constant on a connected component of the mesh does not
// change the second sum. The mean of the field over a component therefore equals the mean of the
// pixels.
#pragma once

#include <cstdint>
#include <vector>

#include "formats/asset/draco_mesh.h"
#include "formats/geometry/slice_mesh.h"
#include "pipeline/contour/contour.h"

namespace trocar::pipeline {

struct HuFieldOptions {
  /// The factor in the formula above. With 0.01 instead of 0.001 the error is less than 4 % larger
  /// for the scan L3, which has only as many pixels as vertices, and less than 0.1 % larger for
  /// other scans.
  double smoothing = 0.01;
  int step = kHuStep;  ///< HU are rounded to multiples of this; 0: not rounded
};

struct HuField {
  std::vector<float> values;  ///< HU of each vertex
  std::int64_t pixels = 0;    ///< number of pixels with their centre in the mesh
  /// Mean and root mean square of (field - pixel) over these pixels; 0 if there are none.
  double bias_hu = 0, rms_hu = 0;
};

/// Pixels (first_x .. end_x - 1, y) of a cropped image whose centres lie in a triangle.
struct PixelRow {
  std::uint32_t triangle = 0;
  int y = 0, first_x = 0, end_x = 0;
};

/// Lists every pixel whose centre, rounded to the lattice, lies in the mesh. Each pixel is listed
/// once, ordered by triangle and then by y. A centre on an edge belongs to the triangle on the side
/// of larger x or, on a horizontal edge, of larger y. On the outline there may be no such triangle.
/// The result is exact. Precondition: `mesh` is valid. O(rows of pixels).
std::vector<PixelRow> pixel_rows(const SliceMesh& mesh, const PixelGrid& grid, int width,
                                 int height);

/// The field of a valid mesh over an image of HU. If a connected component of the mesh contains no
/// pixel's centre, its vertices take the values of the nearest pixels. The values are rounded so
/// that the slice's bias stays far below one step. The same input gives the same bits. O(n^1.5) for
/// a component of n vertices, because of the sparse Cholesky factors.
HuField fit_hu_field(const SliceMesh& mesh, const Image& hu, const PixelGrid& grid,
                     const HuFieldOptions& options = {});

}  // namespace trocar::pipeline
