// SPDX-License-Identifier: GPL-3.0-or-later
// Computes the borders of the materials of one slice: first contours, then simplified outlines.
// Tests: tests/pipeline/scan/materials_test.cpp
#pragma once

#include <optional>
#include <vector>

#include "pipeline/contour/label_borders.h"
#include "pipeline/scan/mesh_slice.h"
#include "pipeline/scan/slice_pixels.h"

namespace trocar::pipeline {

/// The grid of the slice's cropped pixels.
PixelGrid pixel_grid(const SlicePlane& plane, const MeshOptions& options);

/// The contours of a slice's field as one material. Precondition: `field` comes from slice_field().
Pslg contours_of(const SliceStack& stack, int slice, const MeshOptions& options,
                 const Field& field);

struct SliceBorders {
  std::vector<Pslg> outlines;  ///< outline of each material
  /// The borders that several materials share. `outlines` are then their material_outlines().
  std::optional<LabelBorders> shared;
};

/// The contours of all materials of a slice. First merges small components in pixels.several. A
/// material that vanishes because of this is removed from `materials`, which keeps at least one
/// entry.
SliceBorders slice_contours(const SliceStack& stack, int slice, const MeshOptions& options,
                            SlicePixels& pixels, std::vector<MeshedMaterial>& materials);

/// Simplifies the contours of a slice.
SliceBorders simplified(const SliceBorders& contours, const Lattice& lattice,
                        const SimplificationOptions& options);

/// The two-sided Hausdorff distance of each material, in mm: the distance between the material's
/// borders in `contours` and the borders of the same index in `other`.
std::vector<double> distances_mm(const SliceBorders& contours, const SliceBorders& other,
                                 const Lattice& lattice);

}  // namespace trocar::pipeline
