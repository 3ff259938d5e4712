// SPDX-License-Identifier: GPL-3.0-or-later
// Delaunay refinement to a minimum angle and a largest area. The method is Ruppert's (1995) with
// three additions:
//  - off-centres as positions of new points (Uengoer 2004);
//  - concentric shells at small input angles (Ruppert; Shewchuk);
//  - the rule that a triangle's angles are not improved if its shortest edge joins the two segments
//    of a small input angle (Miller, Pav and Walkington 2003).
// A triangle is bad if it violates the bound on the angle or on the area. Steiner points lie on the
// lattice, so every decision is exact. Each point is inserted at the one of several allowed
// positions that leaves the fewest bad triangles (similar to Erten and Uengoer's locally optimal
// Steiner points, 2009). If the bound on the area requires many triangles, a grid of equilateral
// triangles fills the inside first.
// Tests: tests/pipeline/triangulation/meshing_test.cpp
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "formats/geometry/slice_mesh.h"
#include "pipeline/triangulation/triangulation.h"

namespace trocar::pipeline {

/// An input angle (an angle of the outline) that exceeds the wanted angle by less than this is
/// treated as if it were below the wanted angle, because the angle of a small triangle at the
/// corner depends on rounding to the lattice.
inline constexpr double kLatticeAllowance_deg = 1.5;

/// Every vertex on the outline is nearer than this, in lattice steps, to the segment that it
/// splits.
inline constexpr double kMaxDistanceFromOutline_steps = 3;

/// If the wanted angle is at most this one, refinement terminates in practice, for any input.
inline constexpr double kSafeAngle_deg = 33;

/// The area bound is raised if it would require more triangles than this in one slice. At this
/// limit a slice has about 1.5 million vertices and occupies half a GB until it is encoded.
inline constexpr double kMaxTrianglesByArea = 2e6;

struct RefinementOptions {
  double min_angle_deg = 30;
  double max_area_mm2 = 50;  ///< raised if it requires more than kMaxTrianglesByArea triangles
  /// Refinement stops, and keeps the mesh that it has, when the mesh would grow beyond this many
  /// vertices. 0: the limit is derived from the input and the area bound. If the wanted angle is
  /// above kSafeAngle_deg, the mesh is first refined to kSafeAngle_deg within this limit. The limit
  /// for larger angles is then four times the number of vertices of that mesh.
  std::uint32_t max_vertices = 0;
  /// Rounds each point on a boundary edge to the side that better keeps the area within the closed
  /// boundary. If this is false, such points are rounded to the material's side, except on edges
  /// that regions share (regions.h).
  bool keep_area = false;
  /// If two outline edges coincide in opposite directions, splits both at the same points
  /// (regions.h).
  bool shared_borders = false;
  /// A boundary edge is not split at a point whose distance from the input segment, in lattice
  /// steps, is this large or larger.
  double max_distance_steps = kMaxDistanceFromOutline_steps;
  /// Largest area of a triangle with its centroid at the given point, mm^2. It applies in addition
  /// to max_area_mm2. Values below min_area_mm2 are raised to min_area_mm2, which must be positive.
  /// Refinement therefore terminates as it does with the bound min_area_mm2 everywhere.
  std::function<double(LatticePoint)> area_mm2_at = {};
  double min_area_mm2 = 0;
};

enum class RefinementOutcome {
  /// All triangles are within bounds, except where small input angles make this impossible.
  kRefined,
  /// Like kRefined, but bad triangles with a size of a few lattice steps remain.
  kLatticeTooCoarse,
  /// The wanted angle, above kSafeAngle_deg, needs more vertices than allowed. All triangles are
  /// within bounds for the smaller angle Refined::angle_deg.
  kAngleNotReached,
  /// Refinement stopped at max_vertices. The mesh is valid, but not within bounds.
  kVertexBudget,
};

/// The origin of a vertex of a refined mesh.
struct VertexOrigin {
  static constexpr std::int32_t kFree = -1;    ///< a Steiner point in the material
  static constexpr std::int32_t kCorner = -2;  ///< a vertex of the input
  std::int32_t segment = kFree;  ///< the input segment that the vertex splits, kFree or kCorner
};

struct Refined {
  SliceMesh mesh;
  std::vector<VertexOrigin> origins;  ///< origin of each vertex
  /// A segment of the input.
  struct Segment {
    std::uint32_t from, to;  ///< its start and end as vertices of `mesh`
    std::int32_t previous;   ///< the segment that ends at this one's start
    /// Angle between `previous` and this segment in the material; 360 if it is 90 or more.
    double angle_at_from_deg;
  };
  std::vector<Segment> segments;
  RefinementOutcome outcome = RefinementOutcome::kRefined;
  double angle_deg = 0;     ///< the bound that was used for the smallest angle
  double max_area_mm2 = 0;  ///< the bound that was used for the area
  /// Number of bad triangles that no lattice point improves.
  std::uint32_t bad_at_lattice_step = 0;
};

/// Returns true if the smallest angle of the triangle is below the angle whose squared sine is
/// given. The answer is exact except for rounding in the last digits. Refinement, report and tests
/// share this function.
bool is_angle_below(LatticePoint a, LatticePoint b, LatticePoint c, double sine2);

/// Refines a triangulation. The result is valid and constrained Delaunay, like that of
/// triangulate(). Each boundary edge of the input becomes a chain of edges. The inner vertices of
/// the chain lie on the edge or on its material side, less than `max_distance_steps` away. (A split
/// rounds by less than 1.5 steps and inherits a part of the deviation of the edge that is split.)
///
/// The void is the area without material. With keep_area, the inner vertices may also lie up to one
/// step on the void's side if there is enough void next to the edge. In this way each loop of the
/// boundary keeps its area. Only the rounding of about one point remains as an error.
///
/// If the outline is moved by lattice steps or rotated by right angles, the mesh moves and rotates
/// with it, unless a rotation maps the outline onto itself.
Refined refine(const Triangulation& from, const Lattice& lattice, const RefinementOptions& options);

}  // namespace trocar::pipeline
