// SPDX-License-Identifier: GPL-3.0-or-later
// Computes the borders of the materials of one slice: first contours, then simplified outlines.
#pragma once

#include <optional>
#include <vector>

#include "pipeline/contour/label_borders.h"
#include "pipeline/scan/mesh_slice.h"
#include "pipeline/scan/slice_pixels.h"

namespace trocar::pipeline {

/// The grid of the slice's cropped pixels.
PixelGrid pixel_grid(const SlicePlane& plane, const MeshOptions& options);

/// Traces the contours of a field that treats all materials as one. Precondition: `field`
/// comes from slice_field(). Adds the areas of the small islands and holes to `change`.
Pslg contours_of(const SliceStack& stack, int slice, const MeshOptions& options, const Field& field,
                 AreaChange* change = nullptr);

struct SliceBorders {
  std::vector<Pslg> outlines;  ///< outline of each material
  /// If there are several materials: all of their borders, also those with the background.
  /// `outlines` are then the result of material_outlines() for these borders.
  std::optional<LabelBorders> shared;
};

/// Traces the contours of all materials of a slice. If there are several materials, the function
/// first merges small components of pixels.several into their neighbours. A material that vanishes
/// because of this is removed from `materials`, which keeps at least one entry. Adds the areas of
/// the components to `change`; one that becomes another material counts as dropped and filled.
SliceBorders slice_contours(const SliceStack& stack, int slice, const MeshOptions& options,
                            SlicePixels& pixels, std::vector<MeshedMaterial>& materials,
                            AreaChange& change);

SliceBorders simplified(const SliceBorders& contours, const Lattice& lattice,
                        const SimplificationOptions& options);

/// Returns for each material the largest two-sided Hausdorff distance, in mm, between one of its
/// borders in `contours` and the border of the same index in `other`.
std::vector<double> distances_mm(const SliceBorders& contours, const SliceBorders& other,
                                 const Lattice& lattice);

/// The moved_area_mm2() of all borders.
double moved_area_mm2(const SliceBorders& contours, const SliceBorders& other,
                      const Lattice& lattice, double beyond_mm);

}  // namespace trocar::pipeline
