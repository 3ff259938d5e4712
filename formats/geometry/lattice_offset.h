// SPDX-License-Identifier: Apache-2.0
// Differences of lattice points as floating-point vectors.
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "formats/geometry/lattice.h"

namespace trocar {

/// The vector from `origin` to `p` in lattice steps. It is exact, because a difference of two
/// 32-bit integers has 33 bits, and a double holds 53.
inline Eigen::Vector2d offset_in_steps(LatticePoint p, LatticePoint origin) noexcept {
  return {static_cast<double>(std::int64_t{p.x} - origin.x),
          static_cast<double>(std::int64_t{p.y} - origin.y)};
}

}  // namespace trocar
