// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/scan/small_pixels.h"

#include <algorithm>
#include <limits>

#include "formats/asset/asset.h"

namespace trocar::pipeline {
namespace {

constexpr double kSame = 1 - 1e-3;  // headers round the width of pixels
constexpr double kTolerance_px = 0.4, kMinRegion_px2 = 4, kSteps = 64;

}  // namespace

void follow_small_pixels(const SliceStack& stack, StackOptions& options) {
  double narrow_mm = std::numeric_limits<double>::infinity(), pixel_mm2 = narrow_mm, wide_mm = 0;
  for (int k = 0; k < stack.size(); ++k) {
    const SlicePlane& plane = stack.plane(k);
    const double u = plane.spacing_u_mm, v = plane.spacing_v_mm;
    narrow_mm = std::min({narrow_mm, u, v});
    pixel_mm2 = std::min(pixel_mm2, u * v);
    wide_mm = std::max({wide_mm, (stack.width() + 2) * u, (stack.height() + 2) * v});
  }
  if (!(narrow_mm < kSmallPixel_mm * kSame)) return;
  const DefaultOptions& is_default = options.defaults;
  MeshOptions& mesh = options.mesh;
  if (is_default.tolerance) {
    double& mm = mesh.simplification.tolerance_mm;
    mm = std::min(mm, kTolerance_px * narrow_mm);
  }
  if (is_default.min_region)
    mesh.min_region_mm2 = std::min(mesh.min_region_mm2, kMinRegion_px2 * pixel_mm2);
  if (is_default.lattice_bits) {
    const auto fits = [wide_mm](Lattice lattice) { return wide_mm < lattice.to_mm(kMaxAssetSpan); };
    Lattice& lattice = mesh.lattice;
    while (lattice.bits < kMaxLatticeBits && narrow_mm < kSteps * lattice.step_mm() &&
           fits({lattice.bits + 1}))
      ++lattice.bits;
  }
  const double scale = narrow_mm / kSmallPixel_mm;
  if (is_default.close) options.solid.close_mm *= scale;
  if (is_default.min_volume) options.solid.min_volume_mm3 *= scale * scale * scale;
}

}  // namespace trocar::pipeline
