// SPDX-License-Identifier: Apache-2.0
// Refines a triangulation: inserts vertices until the triangles have a minimum angle and are not
// larger than a largest area. The mesh stays constrained Delaunay (triangulation.h). A triangle is
// bad if it violates the bound on the angle or on the area. An input angle is an angle of the
// outline. The method is Ruppert's (1995) with three additions:
//  - The first candidate for a new point in the material is an off-centre (Uengoer 2004): a point
//    on the perpendicular bisector of a bad triangle's shortest edge, not farther from the edge
//    than the triangle's circumcentre.
//  - Near a small input angle, edges are split on concentric circles around its corner, the
//    shells (Ruppert; Shewchuk).
//  - A triangle's angles are not improved if its shortest edge joins the two segments of a small
//    input angle (Miller, Pav and Walkington 2003).
// Steiner points (the inserted vertices) lie on the lattice, so all tests of orientation and
// circumcircles are exact. Each point is inserted at the one of several allowed positions that
// leaves the fewest bad triangles (similar to Erten and Uengoer's locally optimal Steiner points,
// 2009). If the bound on the area is the same everywhere and requires many triangles, refinement
// first fills the inside with a grid of equilateral triangles.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "formats/mesh/slice_mesh.h"
#include "formats/mesh/triangulation.h"

namespace trocar {

/// Allowance for rounding to the lattice, which changes the angle of a small triangle at a corner.
/// An input angle (an angle of the outline) is treated as if it were below the wanted angle if it
/// is less than the wanted angle plus this allowance.
inline constexpr double kLatticeAllowance_deg = 1.5;

/// Default of RefinementOptions::max_distance_steps. With it, every vertex on the outline is less
/// than three lattice steps away from the input segment that the vertex splits.
inline constexpr double kMaxDistanceFromOutline_steps = 3;

/// If the wanted angle is at most this angle, refinement has terminated for every input that was
/// tried. For larger angles, it depends on the outline whether refinement terminates.
inline constexpr double kSafeAngle_deg = 33;

/// The area bound is raised if it would require more triangles than this in one slice. At this
/// limit a slice has about 1.5 million vertices and occupies half a GB until it is encoded.
inline constexpr double kMaxTrianglesByArea = 2e6;

struct RefinementOptions {
  double min_angle_deg = 30;  ///< the wanted angle: lower bound on the angles of all triangles
  double max_area_mm2 = 50;   ///< raised if it requires more than kMaxTrianglesByArea triangles
  /// Refinement stops, and keeps the mesh that it has, when the mesh would grow beyond this
  /// many vertices. 0: the limit is derived from the input and the area bound. If the wanted
  /// angle is above kSafeAngle_deg, the mesh is first refined to kSafeAngle_deg within this
  /// limit. If max_vertices is 0, the limit for larger angles is then four times the number of
  /// vertices of that mesh.
  std::uint32_t max_vertices = 0;
  /// True: a point that splits a boundary edge is rounded to the side of the edge that brings the
  /// area inside the boundary closer to the original area. False: the point is rounded to the
  /// material's side, except on edges that regions share (regions.h).
  bool keep_area = false;
  /// True: if two outline edges coincide in opposite directions, both are split at the same points.
  /// refine_regions() sets this option for regions that share borders (regions.h).
  bool shared_borders = false;
  /// A boundary edge is split only at points that are nearer to the input segment than this
  /// distance, in lattice steps.
  double max_distance_steps = kMaxDistanceFromOutline_steps;
  /// Largest area, in mm^2, of a triangle whose centroid is at the given point. It applies in
  /// addition to max_area_mm2. If the function is empty, only max_area_mm2 applies. Values below
  /// min_area_mm2 are raised to min_area_mm2. If the function is not empty, min_area_mm2 must be
  /// positive, so that refinement terminates as it does with the bound min_area_mm2 everywhere.
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
    /// Angle between `previous` and this segment in the material. 360 stands for all angles of 90
    /// degrees or more, which refinement does not distinguish.
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
/// given. For angles that differ only in the last digits of a double, the answer may be wrong.
/// Refinement uses the same formula, so that reports and tests agree with it.
bool is_angle_below(LatticePoint a, LatticePoint b, LatticePoint c, double sine2);

/// Refines a triangulation. The result is valid and constrained Delaunay, like that of
/// triangulate(). Each boundary edge of the input becomes a chain of edges. The inner vertices of
/// the chain lie on the edge or on its material side, less than `max_distance_steps` away. (A
/// single split rounds by less than 1.5 steps. If a part of the edge is split again, the distances
/// partly add up.)
///
/// With keep_area, the inner vertices may also lie in the void (the area without material), up to
/// one step from the edge, if there is enough void next to the edge. In this way each loop of the
/// boundary keeps its area up to the rounding of about one point.
///
/// If the outline is moved by lattice steps or rotated by right angles, the mesh moves and rotates
/// with it, unless the outline has no unique canonical orientation (see triangulate()).
Refined refine(const Triangulation& from, const Lattice& lattice, const RefinementOptions& options);

}  // namespace trocar
