// SPDX-License-Identifier: GPL-3.0-or-later
// CGAL's constrained Delaunay triangulation and Delaunay_mesher_2 on our outlines.
#pragma once

#include <array>
#include <utility>
#include <vector>

#include "formats/mesh/slice_mesh.h"

namespace trocar::bench {

struct CgalInput {
  std::vector<LatticePoint> points;  ///< each once
  std::vector<std::pair<std::size_t, std::size_t>> edges;
  std::vector<std::array<double, 2>>
      hole_seeds;  ///< a point in each bounded region outside the material
};

/// Not timed: finds the seeds by flooding a triangulation.
CgalInput prepare(const Pslg& pslg);

struct CgalCounts {
  std::size_t triangles = 0, below_angle = 0;
};

/// Triangulates and refines to an angle and an area in squared lattice steps; counts triangles.
CgalCounts cgal_mesh(const CgalInput& input, double min_angle_deg, double max_area_steps2);

/// The triangulation alone: number of faces.
std::size_t cgal_triangulate(const CgalInput& input);

}  // namespace trocar::bench
