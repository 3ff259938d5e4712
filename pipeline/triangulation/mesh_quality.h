// SPDX-License-Identifier: GPL-3.0-or-later
// Angles and areas of a refined mesh, measured on the result. An input angle is an angle in the
// material between two neighbouring segments of the outline.
// Tests: tests/pipeline/triangulation/meshing_test.cpp
#pragma once

#include <vector>

#include "pipeline/triangulation/refinement.h"

namespace trocar::pipeline {

/// A triangle with an angle below the wanted one, and the small input angle at which it lies.
struct SharpTriangle {
  std::uint32_t triangle = 0;
  double angle_deg = 0;
  double input_angle_deg = 360;  ///< smallest input angle below 60 at which it lies, or 360
  LatticePoint input_corner;     ///< the vertex of that input angle, if there is one
};

struct MeshQuality {
  double min_angle_deg = 0;  ///< 0 for an empty mesh
  double max_area_mm2 = 0;
  std::uint32_t below_min_angle = 0;  ///< triangles with an angle below the wanted one
  /// Number of triangles below the wanted angle that lie at an input angle below 60 degrees. This
  /// means that a corner of the triangle is an input vertex with such an angle, or that the
  /// shortest edge of the triangle joins two input segments that meet at such an angle. No mesh can
  /// avoid such triangles there, except by having more of them elsewhere.
  std::uint32_t below_at_small_input_angle = 0;
  /// Number of triangles below the wanted angle that do not lie at an input angle below the wanted
  /// angle plus kLatticeAllowance_deg. The input allows the wanted angle there, but refinement did
  /// not reach it. Zero unless refinement stopped at its vertex budget or was limited by the
  /// lattice step.
  std::uint32_t below_unexplained = 0;
  std::vector<SharpTriangle> sharp;  ///< all triangles below the wanted angle
  /// Number of edges whose membrane stiffness (the sum of the cotangents of the opposite angles) is
  /// negative, decided in exact integers. Inside the material, a Delaunay mesh has no such edges.
  /// On the outline, they are the edges that the apex of their triangle encroaches upon. They
  /// remain where an input angle of a few degrees, or an edge of a few steps, leaves no other
  /// lattice point.
  std::uint32_t negative_stiffness_edges = 0;
};

/// Counts MeshQuality::negative_stiffness_edges of a valid mesh. O(n).
std::uint32_t count_negative_stiffness_edges(const SliceMesh& mesh);

/// Measures the mesh. `min_angle_deg` is the wanted angle.
MeshQuality measure_quality(const Refined& refined, const Lattice& lattice, double min_angle_deg);

}  // namespace trocar::pipeline
