// SPDX-License-Identifier: Apache-2.0
// A cut: the hole of a puncture in a sheet, its scratch memory, and the last stage, the stitch.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "formats/mesh/cavity.h"
#include "formats/mesh/local_delaunay.h"
#include "formats/mesh/overlay.h"
#include "formats/mesh/sheet_mesh.h"
#include "formats/mesh/slice_mesh.h"
#include "formats/mesh/triangle_grid.h"

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

// Cuts the hole of a puncture into a sheet: stitches the patch into it and records the edit (SheetEdit).

struct StitchSpace {
  /// One corner of a triangle of the sheet.
  struct Corner {
    std::uint32_t triangle, corner;
  };
  /// A sequence of kept triangles around a vertex on the cavity's boundary. Each triangle shares an
  /// edge with the next, and the sequence is as long as possible.
  struct Run {
    std::uint32_t vertex;
    /// The triangles' corners at the vertex are the elements first to end - 1 of `corners`.
    std::uint32_t first, end;
  };
  /// A vertex to be created. All corners in the group (see `parent`) get this vertex.
  struct NewVertex {
    std::uint32_t group;
    LatticePoint point;
  };
  std::vector<Corner> corners;
  std::vector<Run> runs;
  /// Finds a run. Key: the run's vertex, and a triangle at either end of the run; value: index into
  /// `runs`.
  FlatTable run_at;
  /// Union-find structure. Its elements are the runs, followed by the corners of the patch's
  /// triangles. It joins elements to groups; all elements of a group become one vertex.
  std::vector<std::uint32_t> parent;
  std::vector<std::uint32_t> vertex;  ///< vertex slot of each group; index: the group's root
  FlatTable taken;                    ///< vertices on the cavity's boundary that keep their slots
  std::vector<NewVertex> fresh;
  std::vector<std::uint32_t> created;      ///< result: slots of the patch's triangles in the sheet
  std::vector<TriangleEdge> shared_edges;  ///< result: patch edges shared with kept triangles

  void allocate(std::size_t max_triangles, std::size_t max_points);
};

/// Replaces the cavity's triangles by the patch (the new triangles). A fan is a sequence of
/// triangles around a vertex in which each triangle shares an edge with the next. Kept triangles
/// keep their vertices, with one exception: if the triangles around a vertex form several fans
/// after the cut, each fan but the first gets a new vertex, because a valid mesh has only one fan
/// at a vertex. Vertices that no triangle uses any more are released. If the scratch memory or the
/// sheet's free slots do not suffice, the function returns kCapacity and changes nothing.
StageOutcome stitch(SheetMesh& mesh, const Cavity& cavity, const Overlay& overlay,
                    const Patch& patch, StitchSpace& space, SheetEdit& edit) noexcept;

// The scratch memory that a cut needs. It is allocated before the first cut, so that cuts
// need not allocate.

/// The largest numbers of triangles, points and edges for which the scratch memory of a
/// cut has space.
struct CutCapacity {
  std::size_t triangles = 0;  ///< triangles in a cavity; also triangles that are tested for flips
  std::size_t points = 0;     ///< points of the overlay: vertices, tool corners, bends
  std::size_t edges = 0;      ///< edges of the overlay, including edges that were split
};

/// Returns a capacity that suffices for a sheet with these numbers of slots (sheet_mesh.h), for a
/// tool of any size, and for about 2000 bends. (A bend is the point through which two crossing
/// edges are bent, overlay.h.)
inline CutCapacity capacity_for(std::size_t vertex_slots, std::size_t triangle_slots) noexcept {
  return {triangle_slots, vertex_slots + 2048, triangle_slots + 8192};
}

/// The scratch memory of all stages of a cut. One workspace can serve many sheets, but only
/// one thread at a time. The header of each stage describes what the stage's member contains
/// after a cut.
struct CutWorkspace {
  Cavity cavity;
  Overlay overlay;
  Patch patch;
  HoleOutline hole;
  ProofSpace proof;
  StitchSpace stitch;
  FlipSpace flips;

  CutWorkspace() { allocate({}); }
  explicit CutWorkspace(const CutCapacity& capacity) { allocate(capacity); }

 private:
  void allocate(const CutCapacity& capacity) {
    cavity.allocate(capacity.triangles);
    overlay.allocate(capacity.triangles, capacity.points, capacity.edges);
    patch.allocate(capacity.points);
    hole.allocate(capacity.points, capacity.edges);
    proof.allocate(capacity.edges);
    stitch.allocate(capacity.triangles, capacity.points);
    flips.allocate(capacity.triangles);
  }
};

// Cuts the hole of a puncture into a sheet: replaces triangles near the tool so that the mesh then
// covers the sheet minus the tool's polygon (paper, Fig. 13).

enum class CutOutcome : std::uint8_t {
  kCut,        ///< the sheet has the hole
  kNoOverlap,  ///< tool and sheet have no area in common
  /// The tool is not a simple counter-clockwise polygon on the lattice with 3 to kMaxToolCorners
  /// different corners.
  kInvalidTool,
  kCapacity,  ///< too little scratch memory, or too few free slots in the sheet
  kBug,       ///< a step of the cut failed, or the result could not be proved valid
};
std::string_view to_string(CutOutcome outcome) noexcept;

struct CutReport {
  CutOutcome outcome = CutOutcome::kNoOverlap;
  const char* bug = nullptr;  ///< the violated condition if the outcome is kBug, else null
  /// Twice the removed area, in steps^2, which is an integer. It is exactly twice the sheet's area
  /// before the cut minus twice the area after the cut.
  std::int64_t doubled_area_removed = 0;
  std::uint32_t triangles_removed = 0;
  std::uint32_t triangles_created = 0;
  /// Number of flips. A flip replaces the edge between two triangles by the other diagonal of the
  /// quadrangle that they form. Flips make all edges locally Delaunay (contract 2).
  std::uint32_t flips = 0;
  /// Number of boundary edges that lie opposite an angle above 90 degrees. The spring of such an
  /// edge has a negative stiffness (runtime/haptics/membrane/network.h). Only edges of triangles that
  /// the cut has written are counted.
  std::uint32_t obtuse_boundary_edges = 0;
};

/// Cuts the polygon `tool` out of `mesh`, in place. Preconditions: `mesh` is valid (invariants of
/// SheetMesh), `grid` indexes its triangles, and `work` and `edit` were made for a sheet with at
/// least as many slots as `mesh` has. A slot is a place for a vertex or a triangle (sheet_mesh.h).
/// Contract:
///  1. The cut replaces the triangles that the tool overlaps or touches. Where rounding requires
///     it, the cut also replaces triangles near them. In the rest of the sheet the cut changes two
///     things. It flips edges that are no longer locally Delaunay (item 2). And if parts of the
///     remaining sheet are joined only by a vertex, each part gets a vertex of its own, because a
///     valid mesh does not join parts in this way.
///  2. An edge between two triangles is locally Delaunay if the two angles opposite the edge add up
///     to at most 180 degrees. If all inner edges are locally Delaunay before the cut, all inner
///     edges are locally Delaunay after the cut. Vertices under the tool are removed. Other
///     vertices of the replaced triangles stay. Exception: a vertex inside the replaced area does
///     not stay if it lies on an edge that was bent by item 3.
///  3. If a tool edge crosses the sheet's boundary, the crossing need not be a lattice point. Both
///     edges are therefore bent through a lattice point less than sqrt(2) steps from the crossing.
///     The lattice point lies on the material's side, so bends do not extend the material.
///     Exception: if the remaining material is thinner than a lattice step, the lattice point may
///     lie outside the material, and the rings of the hole can cross themselves there.
///     doubled_area_removed is exact in any case.
///  4. If the tool has no area in common with the sheet, nothing changes.
///  5. With every outcome other than kCut the sheet is unchanged. With kCut the new sheet was
///     proved valid (above) before the first slot was written.
///  6. The function allocates memory in two cases only. First, the cut writes to more shared pages
///     than SheetMesh::reserve_pages() has reserved. (A shared page is a block of array elements
///     that a copy of the mesh uses too, PagedArray.) Second, the cut frees more than
///     SheetMesh::kReservedFree slots. The time depends on the mesh near the tool, not on the size
///     of the sheet.
/// After the cut, `edit` lists the slots written, work.stitch.created lists the slots of the new
/// triangles, and work.hole contains the rings around the removed material. If the tool lies
/// completely over material, the only ring is the tool's outline. After kCut the caller must update
/// the grid (TriangleGrid::update()).
CutReport cut_in_place(SheetMesh& mesh, const TriangleGrid& grid,
                       std::span<const LatticePoint> tool, CutWorkspace& work,
                       SheetEdit& edit) noexcept;

/// Computes CutReport::obtuse_boundary_edges for the triangles that `edit` lists.
std::uint32_t count_obtuse_boundary_edges(const SheetMesh& mesh, const SheetEdit& edit) noexcept;

}  // namespace trocar
