// SPDX-License-Identifier: Apache-2.0
// A raster of an uncut slice. Each pixel says whether there is material, and gives its HU. The
// haptic thread reads the raster in constant time. Holes cut during the session do not change the
// raster.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/asset/hu_codec.h"
#include "formats/mesh/lattice.h"
#include "formats/mesh/slice_mesh.h"
#include "formats/session/scene.h"
#include "runtime/haptics/tool.h"

namespace trocar::runtime {

/// Contract:
///  1. A pixel has material if its centre lies in a triangle. Its HU is that of the asset's HU
///     volume at the centre. If the asset has HU at vertices only, the pixel's HU is interpolated
///     linearly between the corners of the triangle. If the asset has no HU, the pixel's HU is 0.
///  2. Pixels have the size kPixel_mm, or are larger if the slice would otherwise have more than
///     about kMaxPixels pixels.
class SliceField {
 public:
  static constexpr double kPixel_mm = 0.25;
  static constexpr std::size_t kMaxPixels = 400'000;

  SliceField() = default;
  /// Precondition: `mesh` is valid. `hu` has one value for each vertex of the mesh, or is empty.
  /// `plane` is that plane of the asset's HU volume which belongs to the slice, or null.
  SliceField(const SliceMesh& mesh, std::span<const float> hu, const Lattice& lattice,
             const HuPlane* plane = nullptr);

  bool has_hu() const noexcept { return has_hu_; }
  double mean_hu() const noexcept { return mean_hu_; }  ///< mean HU of all material
  std::size_t pixels() const noexcept { return hu_.size(); }

  struct Mean {
    double share = 0;  ///< coverage: fraction of the disc's sample points that lie over material
    double hu = 0;     ///< mean HU of these points; 0 if there are none
  };
  /// Returns coverage and mean HU of a disc in {B}, from 19 sample points of equal weight. No
  /// allocation.
  Mean mean(const PlanarTransform& transform, const Eigen::Vector2d& at_m,
            double radius_m) const noexcept;

 private:
  float at(double x_mm, double y_mm) const noexcept;

  double left_mm_ = 0, bottom_mm_ = 0, pixel_mm_ = kPixel_mm;
  int columns_ = 0, rows_ = 0;
  bool has_hu_ = false;
  double mean_hu_ = 0;
  std::vector<float> hu_;  // HU of each pixel, row by row; nan: the pixel is empty
};

// Chooses the tissue of a slice from the tissues of the scene.

enum class TissueReason : std::uint8_t {
  kNamed,    ///< the scene's slice names the tissue
  kLabel,    ///< the asset was made from one of the tissue's labels
  kMeanHu,   ///< the mean HU of the slice's material is in the tissue's range
  kDefault,  ///< none of the above: Scene::tissue
};

struct TissueChoice {
  Tissue tissue;
  TissueReason reason = TissueReason::kDefault;
  std::string name;               ///< NamedTissue::name; empty with kDefault
  std::vector<int> asset_labels;  ///< labels that the asset was made from
  std::optional<double> mean_hu;  ///< mean HU of the slice's material, if the asset has it
};

/// Returns the tissue that the scene's slice `wanted` names. If `wanted` names none, returns the
/// first of Scene::tissues that fits. A tissue fits if one of its labels is among the labels from
/// which the asset was made (parameters.labels), or if its HU range contains the mean HU of the
/// slice's material (measures.mean_hu). If no tissue fits, returns Scene::tissue.
TissueChoice choose_tissue(const Scene& scene, const SceneSlice& wanted, const Asset& asset,
                           const AssetSlice& slice);

}  // namespace trocar::runtime
