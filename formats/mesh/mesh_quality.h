// SPDX-License-Identifier: Apache-2.0
// Measures the angles and areas of a refined mesh. An input angle is the angle in the material
// between two neighbouring segments of the outline; refinement cannot change it.
#pragma once

#include <vector>

#include "formats/mesh/refinement.h"

namespace trocar {

/// A triangle with an angle below the wanted one. Such triangles are often unavoidable at an input
/// angle below 60 degrees. A triangle counts as lying at an input angle if the vertex of the input
/// angle is a corner of the triangle, or if the triangle's shortest edge joins the two segments
/// that form the input angle.
struct SharpTriangle {
  std::uint32_t triangle = 0;  ///< index in the mesh's list of triangles
  double angle_deg = 0;        ///< smallest angle of the triangle
  /// The smallest input angle below 60 degrees at which the triangle lies; 360 stands for none.
  double input_angle_deg = 360;
  LatticePoint input_corner;  ///< the vertex of that input angle, if there is one
};

struct MeshQuality {
  double min_angle_deg = 0;  ///< smallest angle of all triangles; 0 for an empty mesh
  double max_area_mm2 = 0;
  std::uint32_t below_min_angle = 0;  ///< number of triangles with an angle below the wanted one
  /// Number of triangles below the wanted angle that lie at an input angle below 60
  /// degrees (see SharpTriangle). To avoid these triangles, refinement would have to
  /// create more of them elsewhere.
  std::uint32_t below_at_small_input_angle = 0;
  /// Number of triangles below the wanted angle for which the outline is not the reason. They lie
  /// at no input angle that is smaller than the wanted angle plus kLatticeAllowance_deg (an
  /// allowance for rounding to the lattice). The number is zero unless refinement stopped at its
  /// largest number of vertices or was limited by the lattice step.
  std::uint32_t below_unexplained = 0;
  std::vector<SharpTriangle> sharp;  ///< all triangles below the wanted angle
  /// Number of edges that would have a negative stiffness in a spring network. The stiffness of an
  /// edge is the sum of the cotangents of the angles opposite to it; its sign is computed exactly.
  /// The mesh is Delaunay (triangulation.h), so no edge inside the material is counted. An edge on
  /// the outline is counted if the angle opposite to it is obtuse. Such an edge remains where an
  /// input angle of a few degrees, or an edge of a few steps, leaves no lattice point at which
  /// refinement could insert a further vertex. It may also remain if refinement stopped at its
  /// largest number of vertices.
  std::uint32_t negative_stiffness_edges = 0;
};

/// Counts MeshQuality::negative_stiffness_edges of a valid mesh. O(n).
std::uint32_t count_negative_stiffness_edges(const SliceMesh& mesh);

/// Measures the mesh. `min_angle_deg` is the wanted angle.
MeshQuality measure_quality(const Refined& refined, const Lattice& lattice, double min_angle_deg);

}  // namespace trocar
