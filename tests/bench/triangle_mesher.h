// SPDX-License-Identifier: GPL-3.0-or-later
// Shewchuk's Triangle (1996) on our outlines. Its licence does not allow us to ship it, so it is
// compiled only if CMake is given a folder with its source (TROCAR_TRIANGLE).
#pragma once

#include <cstddef>
#include <vector>

#include "tests/bench/cgal_mesher.h"

namespace trocar::bench {

/// Was the program built with Triangle?
bool has_triangle();

/// An outline in Triangle's own input arrays: coordinates in lattice steps, each point once, and
/// the same points in holes that CGAL starts from.
struct TriangleInput {
  explicit TriangleInput(const CgalInput& input);
  std::vector<double> points, holes;
  std::vector<int> segments;
};

/// Triangulates and, if the angle is not 0, refines to the angle and the area in squared lattice
/// steps: Triangle's defaults (divide and conquer, exact arithmetic) without its optional outputs.
/// Returns the number of triangles; their corners go to `corners` if it is given, as coordinates
/// x, y. The number is 0 without Triangle.
std::size_t triangle_mesh(TriangleInput& input, double min_angle_deg, double max_area_steps2,
                          std::vector<double>* corners = nullptr);

}  // namespace trocar::bench
