// SPDX-License-Identifier: Apache-2.0
// The patch of a cut: its triangles, the rings around what is removed, and the proof.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "formats/mesh/local_delaunay.h"
#include "formats/mesh/overlay.h"

namespace trocar {

// Makes the patch, which consists of the new triangles that replace the cavity. This is the third
// stage of a cut.

/// The new triangles; their edges are numbered as in predicates.h.
struct Patch {
  std::vector<Triangle> triangles;  ///< corners are indices into Overlay::points
  /// Triangle of the patch beyond each edge; kNoSlot: there is none.
  std::vector<std::array<std::uint32_t, 3>> across;
  /// Kept triangle of the sheet (a triangle outside the cavity) beyond each edge; kNoSlot:
  /// there is none.
  std::vector<std::array<std::uint32_t, 3>> kept;
  /// If make_patch() returns kAgain: kept triangles that the caller must add to the cavity.
  std::vector<std::uint32_t> absorb;

  /// How many times the boundary of the cavity and the tool's outline wind around a
  /// cell, counted counter-clockwise.
  struct Winding {
    std::int32_t cavity, tool;
  };
  /// Scratch: a triangulation of a box around all points of the overlay. Its triangles
  /// are called cells.
  LocalTriangulation triangulation;
  // The next three members have one entry per cell.
  std::vector<Winding> windings;       ///< winding numbers of the cavity's boundary and of the tool
  std::vector<std::uint8_t> region;    ///< 1: in the patch; 0: not in the patch; 2: undecided yet
  std::vector<std::uint32_t> number;   ///< index in `triangles`; kNoSlot: not in the patch
  std::vector<std::uint32_t> pending;  ///< cells whose neighbours must still be visited

  void allocate(std::size_t max_points);
};

/// Triangulates that part of the overlay which lies inside the cavity and outside the tool. The
/// result is constrained Delaunay (local_delaunay.h). If the function returns kAgain, only
/// `absorb` is valid. kBug means that the overlay is not a PSLG: an edge crosses another one or
/// runs through a point.
StageOutcome make_patch(const Overlay& overlay, Patch& patch) noexcept;

// Finds the rings around the material that a cut removes. This is the fourth stage of a cut.

/// Rings with exactly the removed material on their left. The removed material is the cavity (the
/// replaced triangles) without the patch (the new triangles). Two rings may touch at vertices. No
/// ring touches or crosses itself, except where cut.h, contract 3, permits it. Each ring starts at
/// its smallest vertex (by x, then y), and the rings are in ascending order.
struct HoleOutline {
  std::vector<LatticePoint> points;     ///< the points of all rings, ring by ring
  std::vector<std::uint32_t> ring_end;  ///< index after the last point of each ring

  std::size_t rings() const noexcept { return ring_end.size(); }
  std::span<const LatticePoint> ring(std::size_t r) const noexcept {
    const std::uint32_t start = r == 0 ? 0 : ring_end[r - 1];
    return std::span(points).subspan(start, ring_end[r] - start);
  }

  // The remaining members are scratch memory.
  /// All edges between two points a and b. An edge from a to b and an edge from b to a cancel.
  struct CountedEdge {
    std::uint32_t a, b;  ///< indices into Overlay::points, a < b
    std::int32_t count;  ///< number of edges from a to b minus the number from b to a
  };
  /// An element of a linked list of all edges that start at the same point.
  struct Out {
    std::uint32_t to, next;  ///< end point of the edge; index of the list's next element in `out`
  };
  std::vector<CountedEdge> edges;
  FlatTable edge_at;  ///< key: a and b of a CountedEdge; value: index into `edges`
  std::vector<Out> out;
  /// One entry per point of the overlay. `first_out`: the first element of the point's list, as an
  /// index in `out`; kNoSlot if no edge starts at the point. `path_index`: the index of the point
  /// in `path`; kNoSlot if the point is not in `path`.
  std::vector<std::uint32_t> first_out, path_index;
  /// Points, as indices into Overlay::points. `starts`: points at which edges start. `path`: points
  /// of the current walk along the edges. `stops`: the overlay's points on one edge of the cavity's
  /// boundary. `unsorted`: points of the rings found so far, before the rings are sorted.
  std::vector<std::uint32_t> starts, path, stops, unsorted;
  /// Begin and end of each ring in `unsorted`.
  std::vector<std::pair<std::uint32_t, std::uint32_t>> unsorted_rings;

  void allocate(std::size_t max_points, std::size_t max_edges);
};

/// Finds the rings and writes them to `hole`. Returns kBug if the edges around the removed material
/// do not form closed rings.
StageOutcome outline_hole(const Cavity& cavity, const Overlay& overlay, const Patch& patch,
                          HoleOutline& hole) noexcept;

// Proves that a valid sheet stays valid when the patch replaces the cavity. The cavity is the set
// of triangles that the tool overlaps or touches, and the patch is the set of new triangles. This
// is the fifth stage of a cut. Triangles outside the cavity are kept. The proof uses only the
// cavity and its neighbourhood.
//
// The following statements are proved exactly. Together with the way in which stitch() numbers
// vertices, they imply that the mesh is valid (formats/mesh/mesh_validity.h):
//  1. Every new triangle is strictly counter-clockwise.
//  2. Each edge of a new triangle becomes a boundary edge of the sheet, or exactly one other
//     triangle has the same edge. The other triangle is new, or it is a kept triangle on the other
//     side of the cavity's boundary. Each edge of a kept triangle is used by at most one new
//     triangle. So at most two triangles share an edge. The proof checks that they have the edge in
//     opposite directions, so no directed edge occurs twice. (In a valid mesh the triangles of each
//     vertex also form one fan, in which each triangle shares an edge with the next. This is not
//     proved here, because stitch() ensures it: it gives each fan a vertex of its own.)
//  3. Edges between two new triangles are locally Delaunay: the two angles opposite the edge add up
//     to at most 180 degrees.
//  4. Boundary edges that the cut creates cross neither each other nor any old boundary edge near
//     them. (Old boundary edges were edges of the valid sheet before the cut, so they do not cross
//     each other.)
//  5. The cavity's area minus the patch's area equals the area of the hole's rings.

/// The scratch memory of the proof.
struct ProofSpace {
  struct Segment {
    LatticePoint a, b;
  };
  /// Boundary edges of the sheet after the cut. The cut creates the `fresh` ones. The `old` ones
  /// were edges of the sheet before the cut.
  std::vector<Segment> fresh, old;
  /// Edges that cavity and kept triangles have in common. Key: kept triangle and number of its
  /// edge; value: 1 if a new triangle has the same edge, else 0.
  FlatTable kept_edge_at;
  /// Edges of the cavity that are boundary edges of the sheet. Key: the edge's two ends, as indices
  /// into Overlay::points.
  FlatTable boundary_at;

  void allocate(std::size_t max_edges);
};

struct Proof {
  const char* bug = nullptr;              ///< the violated statement; null if all are proved
  bool capacity_exceeded = false;         ///< the scratch memory is too small for the proof
  std::int64_t doubled_area_removed = 0;  ///< twice the area of (cavity minus patch), if proved
};
/// Checks the statements 1 to 5. If the result has neither `bug` nor `capacity_exceeded`, all five
/// are proved.
Proof prove(const SheetMesh& mesh, const TriangleGrid& grid, const Cavity& cavity,
            const Overlay& overlay, const Patch& patch, const HoleOutline& hole,
            ProofSpace& space) noexcept;

}  // namespace trocar
