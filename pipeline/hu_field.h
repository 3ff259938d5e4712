// SPDX-License-Identifier: GPL-3.0-or-later
// The HU of a slice's material as a field over its mesh: one value a vertex, linear in between.
//
// Sampled at the vertices, HU would be far too low: most vertices lie on the outline, where the
// value is the threshold. So the field h is the least-squares fit to the pixels in the material,
//   minimise  sum over pixels p in the mesh (HU(p) - h(p))^2
//           + smoothing * sum over edges ab of the mesh (h(a) - h(b))^2, boundary edges by half.
// The second sum decides at vertices that few pixels see, and makes the field cheaper to store. It
// is zero for constants on each connected part of the mesh, so that on each the mean of the field
// is the mean of the pixels.
#pragma once

#include <cstdint>
#include <vector>

#include "formats/asset/draco_mesh.h"
#include "formats/geometry/slice_mesh.h"
#include "pipeline/contour/contour.h"

namespace trocar::pipeline {

struct HuFieldOptions {
  /// Of the formula above. 0.01 adds less than 4 % to the error of 0.001 (of L3, whose pixels are
  /// as few as its vertices; of other scans less than 0.1 %).
  double smoothing = 0.01;
  int step = kHuStep;  ///< 0: not rounded
};

struct HuField {
  std::vector<float> values;  ///< HU by vertex
  std::int64_t pixels = 0;    ///< with their centre in the mesh
  /// Mean and root mean square of field minus pixel over these pixels; 0 if there are none.
  double bias_hu = 0, rms_hu = 0;
};

/// Pixels (first_x .. end_x - 1, y) of a cropped image whose centres lie in a triangle.
struct PixelRow {
  std::uint32_t triangle = 0;
  int y = 0, first_x = 0, end_x = 0;
};

/// Every pixel whose centre, rounded to the lattice, lies in the mesh, once. One on an edge belongs
/// to the triangle towards larger x, on a horizontal edge towards larger y; on the outline there
/// may be none. By triangle, then y. Exact. Expects a valid mesh. O(rows of pixels).
std::vector<PixelRow> pixel_rows(const SliceMesh& mesh, const PixelGrid& grid, int width,
                                 int height);

/// The field of a valid mesh over an image of HU. A connected part of the mesh without any pixel's
/// centre takes the values of the pixels nearest to its vertices. Rounded so that the slice's bias
/// stays far below a step. By sparse Cholesky factors of each connected part: O(n^1.5) for a part
/// of n vertices. The same input gives the same bits.
HuField fit_hu_field(const SliceMesh& mesh, const Image& hu, const PixelGrid& grid,
                     const HuFieldOptions& options = {});

}  // namespace trocar::pipeline
