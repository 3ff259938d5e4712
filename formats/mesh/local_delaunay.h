// SPDX-License-Identifier: Apache-2.0
// Flips that make edges locally Delaunay: after a cut, and in a small PSLG.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "formats/mesh/cavity.h"
#include "formats/mesh/flat_table.h"
#include "formats/mesh/lattice.h"
#include "formats/mesh/sheet_mesh.h"
#include "formats/mesh/slice_mesh.h"

namespace trocar {

// Makes all edges of the sheet locally Delaunay again. This is the last stage of a cut. An edge
// between two triangles is locally Delaunay if the two angles opposite the edge add up to at most
// 180 degrees. If it is not, a flip replaces it by the other diagonal of the quadrangle that the
// two triangles form (Lawson 1977). The flips start at the edges that new and kept triangles have
// in common, and continue from there as far as necessary.

struct FlipSpace {
  std::vector<std::uint32_t> waiting;  ///< triangles whose edges must be tested
  FlatTable waits;                     ///< key: triangle; value: 1 if it is in `waiting`, else 0

  void allocate(std::size_t max_triangles);
};

/// Flips edges until all of `edges`, and all inner edges of triangles that the flips change, are
/// locally Delaunay by an exact test. Precondition: `edges` are inner edges of a valid sheet. If
/// all other inner edges of the sheet are locally Delaunay at the start, all inner edges are
/// locally Delaunay at the end. Each flip exchanges the diagonals of a strictly convex quadrangle,
/// so the sheet stays valid. The loop terminates, because no flip is ever undone: if every vertex
/// had the height x^2 + y^2, each flip would lower the surface of the triangles. `flips` receives
/// the number of flips. If more triangles must be tested than `space` can hold, the function stops
/// and returns kCapacity. The caller can then undo the changes with `edit`.
StageOutcome restore_delaunay(SheetMesh& mesh, std::span<const TriangleEdge> edges,
                              FlipSpace& space, SheetEdit& edit, std::uint32_t& flips) noexcept;

// Makes the constrained Delaunay triangulation of a small PSLG (planar straight-line graph): every
// edge of the PSLG is an edge of a triangle, and the other edges are locally Delaunay (the two
// angles opposite the edge add up to at most 180 degrees). All computations are in exact integers.
// A flip replaces the edge between two triangles by the other diagonal of their quadrangle. Points
// are inserted one by one with Lawson's flips (Lawson 1977), and edges of the PSLG (constraints)
// with Sloan's flips (Sloan 1993). The same input always gives the same triangles.

/// A counter-clockwise triangle; its edges are numbered as in predicates.h.
struct Cell {
  std::array<std::uint32_t, 3> vertex;
  std::array<std::uint32_t, 3> across;      ///< cell beyond edge i; kNoSlot: there is no cell
  std::array<std::uint32_t, 3> constraint;  ///< number that constrain() gave edge i; kNoSlot: none
};

/// A triangulation of a box around the given points, so that every point lies in a triangle when it
/// is inserted. Call triangulate(), then constrain() for each edge that must exist, then
/// restore_delaunay(). The box's corners are the last four of points().
class LocalTriangulation {
 public:
  /// kCapacity: there are more points than allocate() has allowed for. kNotPlanar: the input is
  /// not a PSLG.
  enum class Status : std::uint8_t { kDone, kCapacity, kNotPlanar };

  /// Allocates memory for this number of points. No other function allocates.
  void allocate(std::size_t max_points);

  /// Makes the Delaunay triangulation of the points. Precondition: |coordinate| <= kMaxCoordinate
  /// (lattice.h). Returns kNotPlanar if two points are equal. The time is typically O(n^1.5) for n
  /// points, and less if consecutive points are near each other. `first_corner` says with which
  /// corner of the box the last four of points() begin: 0 is the lower left corner, and 1 to 3
  /// follow counter-clockwise. If the caller rotates points and first corner together by right
  /// angles, the cells are the same.
  Status triangulate(std::span<const LatticePoint> points, int first_corner = 0) noexcept;

  /// Makes the segment between the points with the indices a and b (a != b) an edge, and gives it
  /// the number `name`. Afterwards some cells may not be Delaunay; see restore_delaunay(). If
  /// another constraint crosses the segment, or if a point lies on it, the function returns
  /// kNotPlanar, and the triangulation must not be used any more.
  Status constrain(std::uint32_t a, std::uint32_t b, std::uint32_t name) noexcept;

  /// Flips edges until every edge between two cells of the same region is locally Delaunay, except
  /// in region 0, in which no edge is flipped. `region` has one number per cell. A constraint is
  /// preserved if it separates two regions or lies in region 0. Any other constraint may be
  /// flipped, too.
  void restore_delaunay(std::span<const std::uint8_t> region) noexcept;

  std::span<const LatticePoint> points() const noexcept { return points_; }
  std::span<const Cell> cells() const noexcept { return cells_; }
  /// A cell that has the point as a corner.
  std::uint32_t cell_at(std::uint32_t point) const noexcept { return cell_at_[point]; }

 private:
  struct CellEdge {
    std::uint32_t cell, edge;
  };
  void enclose(int first_corner) noexcept;
  bool insert(std::uint32_t v) noexcept;
  bool find_crossing(std::uint32_t a, std::uint32_t b) noexcept;
  CellEdge find(std::uint32_t v, std::uint32_t w) const noexcept;
  template <typename Visit>
  void around(std::uint32_t v, Visit visit) const noexcept;
  bool crosses(std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d) const noexcept;

  std::int64_t orientation(std::uint32_t c, std::uint32_t i, LatticePoint p) const noexcept;
  std::uint32_t apex(CellEdge s) const noexcept;
  CellEdge opposite(CellEdge s) const noexcept;
  bool is_delaunay(CellEdge s) const noexcept;
  void link(CellEdge s, std::uint32_t other, std::uint32_t constraint) noexcept;
  void adopt(CellEdge s, const Cell& old, std::uint32_t i) noexcept;
  void set(std::uint32_t c, std::uint32_t v0, std::uint32_t v1, std::uint32_t v2) noexcept;
  std::uint32_t new_cell() noexcept;
  void split_cell(std::uint32_t c, std::uint32_t v) noexcept;
  void split_edge(std::uint32_t c, std::uint32_t i, std::uint32_t v) noexcept;
  void flip(CellEdge s) noexcept;
  void legalise() noexcept;

  std::vector<LatticePoint> points_;
  std::vector<Cell> cells_;
  std::vector<std::uint32_t> cell_at_;                  ///< a cell that has the point as a corner
  std::vector<CellEdge> suspects_;                      ///< scratch
  std::vector<std::uint8_t> waits_;                     ///< scratch, one entry per cell
  std::vector<std::array<std::uint32_t, 2>> crossing_;  ///< scratch: edges that cross a constraint
  std::uint32_t last_ = 0;
};

}  // namespace trocar
