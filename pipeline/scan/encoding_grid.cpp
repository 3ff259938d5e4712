// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/scan/encoding_grid.h"

#include <Eigen/Geometry>
#include <algorithm>

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
  Eigen::AlignedBox2d box;  // mm
  for (int k = first; k <= last; ++k) {
    const SlicePlane& plane = stack.plane(k);
    const double u = plane.spacing_u_mm, v = plane.spacing_v_mm;
    const Eigen::Vector2d margin(0.5 * u + std::max(0.5 * u, beyond),
                                 0.5 * v + std::max(0.5 * v, beyond));
    box.extend(Eigen::Vector2d(c.x0 * u, c.y0 * v) - margin);
    box.extend(Eigen::Vector2d(c.x1 * u, c.y1 * v) + margin);
  }
  LatticeBox lattice_box;
  const auto snapped = [&](double mm) {
    const double farthest = options.lattice.to_mm(kMaxCoordinate);
    return options.lattice.snap_mm(std::clamp(mm, -farthest, farthest));
  };
  lattice_box.low = {snapped(box.min().x()), snapped(box.min().y())};
  lattice_box.high = {snapped(box.max().x()), snapped(box.max().y())};
  return asset_grid(options.lattice, lattice_box);
}

}  // namespace trocar::pipeline
