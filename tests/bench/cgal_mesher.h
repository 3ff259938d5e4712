// SPDX-License-Identifier: GPL-3.0-or-later
// CGAL's constrained Delaunay triangulation and Delaunay_mesher_2 on our outlines.
#pragma once

#include <array>
#include <optional>
#include <utility>
#include <vector>

#include "formats/geometry/slice_mesh.h"

namespace trocar::bench {

struct CgalInput {
  const Pslg* pslg = nullptr;
  std::vector<LatticePoint> points;  ///< each once
  std::vector<std::pair<std::size_t, std::size_t>> edges;
  std::vector<std::array<double, 2>>
      hole_seeds;  ///< a point in each bounded region outside the material
};

/// Not timed: finds the seeds by flooding a triangulation.
CgalInput prepare(const Pslg& pslg);

struct CgalCounts {
  std::size_t triangles = 0;
  std::size_t vertices = 0;
  double min_angle_deg = 180;   ///< only with `measure`
  std::size_t below_angle = 0;  ///< only with `measure`
  double max_doubled_area = 0;  ///< only with `measure`
};

/// Triangulates and refines to an angle and, if given, an area in squared lattice steps.
/// `measure`: also measures the result (not for timing).
CgalCounts cgal_mesh(const CgalInput& input, double min_angle_deg,
                     std::optional<double> max_area_steps2, bool measure);

/// The triangulation alone: number of faces.
std::size_t cgal_triangulate(const CgalInput& input);

}  // namespace trocar::bench
