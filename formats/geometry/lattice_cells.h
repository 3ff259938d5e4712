// SPDX-License-Identifier: Apache-2.0
// A grid of square cells over a box on the lattice.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "formats/geometry/lattice_box.h"

namespace trocar {

struct LatticeCells {
  LatticePoint low{};  ///< lower left corner of the grid
  double size = 1;     ///< side length of a cell, lattice steps
  std::int32_t columns = 1, rows = 1;

  LatticeCells() = default;
  /// Divides the box into about `count` cells. The box may have no area. Precondition: `count` is
  /// at least 1.
  LatticeCells(const LatticeBox& box, double count) : low(box.low) {
    const double width = 1.0 + static_cast<double>(box.high.x) - box.low.x,
                 height = 1.0 + static_cast<double>(box.high.y) - box.low.y;
    size = std::max({1.0, std::sqrt(width * height / count), width / count, height / count});
    columns = 1 + static_cast<std::int32_t>(width / size);
    rows = 1 + static_cast<std::int32_t>(height / size);
  }
  std::size_t count() const {
    return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows);
  }
};

}  // namespace trocar
