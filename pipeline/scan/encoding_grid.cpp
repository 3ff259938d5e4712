// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/scan/encoding_grid.h"

#include <algorithm>
#include <array>

namespace trocar::pipeline {
namespace {

// The largest distance of a vertex from the edge of the image's outermost pixels, where contours
// end.
double margin_mm(const MeshOptions& options) {
  const double step_mm = options.lattice.step_mm();  // allows for rounding to the lattice
  return std::max(options.simplification.tolerance_mm, kMaxDistanceFromOutline_steps * step_mm) +
         step_mm;
}

}  // namespace

Result<DracoGrid> encoding_grid(const SliceStack& stack, int first, int last,
                                const MeshOptions& options) {
  const Crop c = options.crop.value_or(Crop{0, stack.width() - 1, 0, stack.height() - 1});
  const double beyond = margin_mm(options);
  std::array<double, 4> box{};  // mm
  for (int k = first; k <= last; ++k) {
    const SlicePlane& plane = stack.plane(k);
    const double u = plane.spacing_u_mm, v = plane.spacing_v_mm;
    const double margin_u = 0.5 * u + std::max(0.5 * u, beyond),
                 margin_v = 0.5 * v + std::max(0.5 * v, beyond);
    const std::array<double, 4> here{c.x0 * u - margin_u, c.y0 * v - margin_v, c.x1 * u + margin_u,
                                     c.y1 * v + margin_v};
    for (std::size_t i = 0; i < 4; ++i)
      box[i] =
          k == first ? here[i] : (i < 2 ? std::min(box[i], here[i]) : std::max(box[i], here[i]));
  }
  LatticeBox lattice_box;
  const auto snapped = [&](double mm) {
    const double farthest = options.lattice.to_mm(kMaxCoordinate);
    return options.lattice.snap_mm(std::clamp(mm, -farthest, farthest));
  };
  lattice_box.low = {snapped(box[0]), snapped(box[1])};
  lattice_box.high = {snapped(box[2]), snapped(box[3])};
  return asset_grid(options.lattice, lattice_box);
}

}  // namespace trocar::pipeline
