// SPDX-License-Identifier: GPL-3.0-or-later
// Delaunay refinement to a minimum angle and a largest area: Ruppert (1995) with Uengoer's
// off-centres (2004), concentric shells at small input angles (Ruppert; Shewchuk) and the rule of
// Miller, Pav and Walkington (2003) that a short edge across a small input angle is left alone.
// Steiner points lie on the lattice, so every decision is exact. Each point is inserted at the one
// of several allowed places that leaves the fewest bad triangles (similar to Erten and Uengoer's
// locally optimal Steiner points, 2009). Where the largest area asks for many triangles, a lattice
// of equilateral ones fills the inside first.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "formats/geometry/slice_mesh.h"
#include "pipeline/mesh/triangulation.h"

namespace trocar::pipeline {

/// An input angle that exceeds the wanted one by less than this is treated as if it were below it:
/// in a small triangle at the corner, rounding to the lattice decides the angle.
inline constexpr double kLatticeAllowance_deg = 1.5;

/// Every vertex on the outline is nearer than this, in lattice steps, to the segment that it
/// splits.
inline constexpr double kFarthestFromOutline_steps = 3;

/// Up to this angle refinement ends in practice, for any input.
inline constexpr double kSafeAngle_deg = 33;

/// The area bound is raised where it would ask for more triangles than this in one slice, which has
/// then about 1.5 million vertices and takes half a GB until it is encoded.
inline constexpr double kMostTrianglesByArea = 2e6;

struct RefinementOptions {
  double min_angle_deg = 30;
  double max_area_mm2 = 50;  ///< raised where it asks for more than kMostTrianglesByArea
  /// Refinement stops, and keeps the mesh that it has, when the mesh would grow beyond this many
  /// vertices. 0: a budget from input and area; for angles above kSafeAngle_deg, from the size of
  /// the mesh refined to that angle.
  std::uint32_t max_vertices = 0;
  /// Round the points on boundary edges to either side, so that the area within each closed
  /// boundary stays, and not always to the material's.
  bool keep_area = false;
  /// Split outline edges that coincide in opposite directions together (pipeline/mesh/regions.h).
  bool shared_borders = false;
  /// A split that would lie as far as this, in lattice steps, from the input segment is not made.
  double farthest_steps = kFarthestFromOutline_steps;
  /// Largest area of a triangle by the place of its centroid, mm^2, besides max_area_mm2. Where it
  /// is below least_area_mm2 > 0, that counts: refinement then ends as with that area everywhere.
  std::function<double(LatticePoint)> area_mm2_at = {};
  double least_area_mm2 = 0;
};

enum class RefinementOutcome {
  kRefined,           ///< all within bounds except where small input angles forbid it
  kLatticeTooCoarse,  ///< the same, but bad triangles a few lattice steps wide were left as they
                      ///< are
  kAngleNotReached,   ///< the wanted angle, above kSafeAngle_deg, needs more vertices than allowed:
                      ///< all is within bounds for the smaller one `angle_deg`
  kVertexBudget,      ///< stopped at max_vertices; valid, but not within bounds
};

/// Where a vertex of a refined mesh comes from.
struct VertexOrigin {
  static constexpr std::int32_t kFree = -1;    ///< a Steiner point in the material
  static constexpr std::int32_t kCorner = -2;  ///< a vertex of the input
  std::int32_t segment = kFree;                ///< else the input segment that it splits
};

struct Refined {
  SliceMesh mesh;
  std::vector<VertexOrigin> origins;  ///< by vertex
  /// Input segments by number: end points as vertices of `mesh`, and the material angle between
  /// a segment's predecessor and itself at its start (segment s starts at its vertex `from`).
  struct Segment {
    std::uint32_t from, to;
    std::int32_t previous;     ///< segment that ends where this one starts
    double angle_at_from_deg;  ///< in the material; 360 for all of 90 and more
  };
  std::vector<Segment> segments;
  RefinementOutcome outcome = RefinementOutcome::kRefined;
  double angle_deg = 0;                   ///< the smallest angle that it was refined to
  double max_area_mm2 = 0;                ///< the largest area that it was refined to
  std::uint32_t bad_at_lattice_step = 0;  ///< bad triangles that no lattice point improves
};

/// Is the smallest angle of the triangle below the angle whose squared sine is given? Exact except
/// for rounding in the last digits. Refinement, report and tests share it.
bool is_angle_below(LatticePoint a, LatticePoint b, LatticePoint c, double sine2);

/// The result is valid and constrained Delaunay, like that of triangulate(). Each boundary edge of
/// the input becomes a chain of edges whose inner vertices lie on it or, where no lattice point
/// does, on its material side less than `farthest_steps` away (each split rounds by less than 1.5
/// steps and inherits a part of the deviation of the edge that it splits). With keep_area, points
/// of edges with enough void beside them also lie up to one step on the void's side, so that each
/// loop of the boundary keeps its area but for about one rounding. Moved by lattice steps or
/// rotated by right angles, an outline gives the same mesh, moved and rotated, unless a rotation
/// maps it onto itself.
Refined refine(const Triangulation& from, const Lattice& lattice, const RefinementOptions& options);

}  // namespace trocar::pipeline
