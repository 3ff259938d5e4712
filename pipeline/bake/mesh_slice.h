// SPDX-License-Identifier: GPL-3.0-or-later
// Turns the pixels of one slice into verified meshes of its materials.
#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "formats/base/result.h"
#include "formats/mesh/mesh_quality.h"
#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/refinement.h"
#include "formats/mesh/slice_mesh.h"
#include "pipeline/bake/hu_field.h"
#include "pipeline/contour/contour.h"
#include "pipeline/contour/label_borders.h"
#include "pipeline/contour/simplification.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/segment/label_pixels.h"
#include "pipeline/segment/solid_bone.h"

namespace trocar::pipeline {

struct MeshOptions : MaterialOptions {
  ContourKind contour = ContourKind::kSubpixel;
  SimplificationOptions simplification;
  RefinementOptions refinement;
  /// Largest area of a triangle as a multiple of a pixel's area. If set, it replaces
  /// refinement.max_area_mm2.
  std::optional<double> max_area_px2;
  Lattice lattice;
  const SliceStack* hu = nullptr;  ///< CT of a label map (open/open_stack.h) or null
  /// Stores the HU of the slices in the asset. This has an effect only if the input is in HU or is
  /// a label map with its CT.
  bool hu_volume = true;
  /// Fits a field of HU to each mesh (hu_field.h). This option needs the same input as hu_volume.
  bool hu_field = false;
  /// Makes triangles smaller where HU change: GradedArea's `hu_per_edge`. 0: off.
  /// Only for a scan in HU: check_ranges() of mesh_stack.h refuses it for other input.
  double grade_hu = 0;
};

/// The times in ms by stage: read, segment, contour, simplify, triangulate, refine, check and hu.
using StageTimes = std::map<std::string, double>;

/// One material of a slice, with all of its data that the asset, the report and the
/// pictures of --dump-stages need.
struct MeshedMaterial {
  /// In a label map: the smallest of the material's labels. It identifies the material
  /// in every slice.
  int first_label = 0;
  Pslg contours;  ///< at full resolution, without small rings
  Pslg pslg;      ///< the simplified contours
  SliceMesh cdt;  ///< constrained Delaunay triangulation of the inside of `pslg`
  Refined refined;
  ProvedOutline outline;  ///< boundary of the refined mesh: `pslg` with its Steiner points
  MeshQuality quality;
  /// The mean HU of the material's pixels. It includes small regions that are dropped later.
  /// There is a value for input in HU with a threshold, and for a label map with its CT.
  std::optional<double> mean_hu;
  std::optional<HuField> hu;  ///< field over refined.mesh, if MeshOptions::hu_field is set
  /// The largest two-sided Hausdorff distance between a ring of `contours` and its simplified ring
  /// in `pslg`. If the slice has several materials, the chains of their borders
  /// (contour/label_borders.h) are compared instead of rings. With SimplificationMethod::kArea,
  /// `contours` are compared with `outline` and not with `pslg`, because refinement moves the
  /// outline as well.
  double simplification_error_mm = 0;
  double area_mm2 = 0;
  int holes = 0;
};

/// Areas that the program has changed in a slice, in all materials together.
struct SliceChanges {
  AreaChange small;  ///< islands and holes below MaterialOptions::min_region_mm2
  /// Area between contours and outlines where these are more than half a pixel apart. (Rounding to
  /// the lattice moves points less: a pixel is at least kMinStepsPerPixel steps wide.)
  double moved_mm2 = 0;
  std::optional<AreaChange> solid;  ///< of SolidBone and ScannerTable; no value without SolidBone
};

struct MeshedSlice {
  bool all_material = false;  ///< whether every pixel is material
  /// The materials of the slice. There is at least one entry; if nothing is material,
  /// its mesh is empty. In a label map there is one entry for each material with a
  /// mesh, ascending by `first_label`. If there are several entries, their outlines
  /// have passed check_shared_borders().
  std::vector<MeshedMaterial> materials;
  std::set<int> labels;         ///< the wanted labels that occur in the slice
  std::size_t not_numbers = 0;  ///< number of NaN pixels in the slice and in the label map's CT
  ValueTally values;            ///< statistics of HU or labels; empty for other input
  /// The wanted bound on the area of triangles. If it would give too many triangles, refinement
  /// uses a larger bound (Refined::max_area_mm2).
  double max_area_bound_mm2 = 0;
  SliceChanges changes;
  std::optional<Image> hu;  ///< HU of all pixels in the crop, for MeshOptions::hu_volume
  StageTimes times;

  double area_mm2() const;
};

/// Checks that a slice fits the lattice. Errors: kRefused if pixels are narrower than
/// kMinStepsPerPixel lattice steps, or if the image with a margin of half a pixel is wider or
/// higher than kMaxAssetSpan lattice steps.
Result<void> check_lattice(const SliceStack& stack, int slice, const Lattice& lattice);

/// Meshes one slice. Every PSLG has passed check_pslg(), and every mesh check_delaunay_mesh()
/// (formats/mesh/mesh_validity.h). If the slice has several materials, two neighbours share
/// their border point by point (contour/label_borders.h), and the outlines have passed
/// check_shared_borders() (formats/mesh/shared_borders.h). Errors: those of stack.read() and
/// check_lattice(); kRefused if there are too many materials; kUsage if an option needs a single
/// material and there are several; kBug if an outline or mesh failed its check.
Result<MeshedSlice> mesh_slice(const SliceStack& stack, int slice, const MeshOptions& options);

// Segments the pixels of one slice and assigns them to materials.

struct SlicePixels {
  Field field;  ///< treats all materials as one
  /// The values before segmentation, if a later stage needs them and `field` no longer has them.
  std::optional<Image> original;
  std::optional<LabelImage> labels;  ///< the labels, if there may be several materials
  std::optional<Image> ct;           ///< the CT of a label map
  bool needs_hu = false;             ///< a later stage uses the slice's own values as HU
  std::optional<double> solid_mean;  ///< result of SolidBone::apply()
  /// The material of each pixel if the slice has several materials. If it has one, this is empty,
  /// because `field` suffices.
  MaterialImage several = {};

  /// The image of HU for the HU field and graded areas; null if there is none.
  const Image* hu() const {
    if (ct) return &*ct;
    if (!needs_hu) return nullptr;
    return original ? &*original : &field.image;
  }
  /// Moves the image of hu() out of this object and returns it; no value if there is none.
  std::optional<Image> take_hu() {
    if (ct) return std::move(ct);
    if (!needs_hu) return std::nullopt;
    return original ? std::move(original) : std::move(field.image);
  }
};

struct SliceImages {
  Pixels pixels;
  std::optional<Image> ct;
};

/// Reads the pixels of a slice, and the CT of a label map. Errors: those of read_pixels().
Result<SliceImages> read_slice(const SliceStack& stack, int slice, const MeshOptions& options);

/// Segments a slice. Sets these members of `out`: materials (at least one entry, with first_label
/// and mean_hu), labels, values, all_material and changes.solid. Errors: kRefused if there are too many materials;
/// kUsage if an option needs a single material and there are several.
Result<SlicePixels> segment_slice(const SliceStack& stack, int slice, const MeshOptions& options,
                                  SliceImages images, MeshedSlice& out);

// A bound on the area of triangles for each position, so that triangles are smaller
// where HU change.

/// The bound at a position is the area of an equilateral triangle. Along an edge of this triangle
/// HU change by at most `hu_per_edge`, according to the gradient of the image (Sobel's, which
/// averages noise over nine pixels). Two rules modify the bound. First, the bound is at least
/// kMinArea_px2 times the area of a pixel. Second, the edge length of this triangle at one pixel
/// exceeds that at any of the eight pixels around it by at most half of the distance between the
/// two pixels. Refinement evaluates the bound at a triangle's centroid. Because of the second rule,
/// a large triangle is refined even if HU change only in a part of it that is away from the
/// centroid.
class GradedArea {
 public:
  static constexpr double kMinArea_px2 = 1;

  /// Precondition: `hu_per_edge` is positive.
  GradedArea(const Image& hu, const PixelGrid& grid, double hu_per_edge);
  /// The bound at the pixel nearest to p.
  double mm2_at(LatticePoint p) const;
  /// The smallest bound at any position.
  double min_mm2() const { return min_mm2_; }

 private:
  PixelGrid grid_;
  int width_, height_;
  double min_mm2_;
  std::vector<float> edge_mm_;  // edge length for each pixel
};

// Computes the borders of the materials of one slice: first contours, then simplified outlines.

/// Traces the contours of a field that treats all materials as one. Precondition: `field`
/// comes from slice_field(). Adds the areas of the small islands and holes to `change`.
Pslg contours_of(const SliceStack& stack, int slice, const MeshOptions& options, const Field& field,
                 AreaChange* change = nullptr);

}  // namespace trocar::pipeline
