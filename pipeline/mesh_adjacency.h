// SPDX-License-Identifier: GPL-3.0-or-later
// Which triangle lies beyond which side.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "formats/slice_mesh.h"

namespace trocar::pipeline {

inline constexpr std::uint32_t kNoTriangle = 0xffffffff;

/// By triangle: side i is opposite vertex i; kNoTriangle at the boundary.
using Neighbours = std::vector<std::array<std::uint32_t, 3>>;

/// Of a valid mesh. O(n): sides are matched among those that start at one vertex.
Neighbours neighbours(const SliceMesh& mesh);

}  // namespace trocar::pipeline
