// SPDX-License-Identifier: Apache-2.0
// Finds the triangles of a sheet near a box. The time is proportional to the number of these
// triangles, not to the size of the mesh. A triangle is inserted or removed in constant time.
//
// There are several grids of square cells, for triangles of different sizes. From each grid to the
// next coarser grid, the width of the cells doubles; the coarsest grid is a single cell. Each
// triangle is listed in exactly one cell. The cell belongs to the finest grid whose cells are at
// least as large as the triangle's bounding box, and contains the lower left corner of this box.
// Therefore a triangle extends at most into the next cells to the right and above. However long and
// thin a triangle is, it has one list entry. It therefore suffices to allocate one entry for each
// slot of the mesh (a place for a triangle, in use or not), and an edit needs no further memory.
// Such grids are called loose, after Ulrich's loose octree (2000).
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "formats/mesh/lattice.h"
#include "formats/mesh/sheet_mesh.h"

namespace trocar {

/// Returns the bounding box of triangle t, which must be in use.
inline LatticeBox bounding_box(const SheetMesh& mesh, std::uint32_t t) noexcept {
  return box_around(corners(mesh, t));
}

/// The triangles that a grid lists.
enum class GridTriangles : std::uint8_t {
  kAll,       ///< every triangle in use
  kBoundary,  ///< every triangle in use that has an edge on the sheet's boundary
};

/// Contract:
///  1. for_each() visits every listed triangle (GridTriangles) whose bounding box has a point in
///     common with the given box, exactly once, and no other triangle. The order depends only on
///     the mesh given to the constructor and on the edits since then.
///  2. The constructor and add_slots() allocate. A copy of the grid shares its pages of memory
///     (PagedArray) until one of the two is updated. An update() allocates only if it writes to
///     more shared pages than reserve_pages() has reserved.
class TriangleGrid {
 public:
  TriangleGrid() = default;
  /// Builds the grids, with an entry for every slot. Precondition: all vertex indices are in range.
  /// O(slots).
  explicit TriangleGrid(const SheetMesh& mesh, GridTriangles lists = GridTriangles::kAll);

  /// Call this once after each edit of the mesh. `change` lists the triangles that the
  /// edit has written, and `mesh` is the edited mesh. The time is proportional to the
  /// number of these triangles.
  void update(const SheetChange& change, const SheetMesh& mesh) noexcept;

  /// Adds entries for the slots that SheetMesh::add_slots() has added to the mesh.
  void add_slots(const SheetMesh& mesh) { link_.resize(mesh.triangles.size()); }

  /// Calls visit(t) for every triangle t near the box, see contract 1. `mesh`: the mesh that this
  /// grid was made for, after the last update().
  template <typename Visit>
  void for_each(const SheetMesh& mesh, const LatticeBox& box, Visit&& visit) const {
    for (const Level& level : levels_) {
      if (level.triangles == 0) continue;
      const std::int64_t left = std::max<std::int64_t>(level.column(*this, box.low.x) - 1, 0);
      const std::int64_t bottom = std::max<std::int64_t>(level.row(*this, box.low.y) - 1, 0);
      const std::int64_t right = level.column(*this, box.high.x);
      const std::int64_t top = level.row(*this, box.high.y);
      for (std::int64_t r = bottom; r <= top; ++r) {
        for (std::int64_t c = left; c <= right; ++c) {
          for (std::uint32_t t = head_[level.cell(r, c)]; t != kNoSlot; t = link_[t].next) {
            if (!apart(bounding_box(mesh, t), box)) visit(t);
          }
        }
      }
    }
  }

  /// Returns the memory in use in bytes, including memory that copies share.
  std::size_t bytes() const noexcept {
    return levels_.capacity() * sizeof(Level) + head_.bytes() + link_.bytes();
  }
  /// Like SheetMesh::reserve_pages(), for the arrays of the grid.
  void reserve_pages(std::size_t pages) {
    head_.reserve_pages(pages);
    link_.reserve_pages(pages);
  }

 private:
  struct Level {
    int shift = 0;                       ///< cells are 2^shift steps wide
    std::int64_t columns = 1, rows = 1;  ///< points outside the grid belong to the outermost cells
    std::size_t first_cell = 0;          ///< index of the grid's first cell in `head_`
    std::uint32_t triangles = 0;         ///< number of triangles that this grid lists

    std::int64_t column(const TriangleGrid& grid, std::int32_t x) const noexcept {
      return std::clamp<std::int64_t>((std::int64_t{x} - grid.origin_.x) >> shift, 0, columns - 1);
    }
    std::int64_t row(const TriangleGrid& grid, std::int32_t y) const noexcept {
      return std::clamp<std::int64_t>((std::int64_t{y} - grid.origin_.y) >> shift, 0, rows - 1);
    }
    std::size_t cell(std::int64_t r, std::int64_t c) const noexcept {
      return first_cell + static_cast<std::size_t>(r * columns + c);
    }
  };
  struct Link {
    std::uint32_t next = kNoSlot, before = kNoSlot;  ///< neighbours in the list of its cell
    std::uint32_t cell = kNoSlot;                    ///< cell of the triangle; kNoSlot: in no cell
  };

  bool is_listed(const SheetMesh& mesh, std::uint32_t t) const noexcept;
  void insert(const SheetMesh& mesh, std::uint32_t t) noexcept;
  void remove(std::uint32_t t) noexcept;

  GridTriangles lists_ = GridTriangles::kAll;
  LatticePoint origin_;             ///< lower left corner of all grids
  std::vector<Level> levels_;       ///< the grids, the finest first
  PagedArray<std::uint32_t> head_;  ///< first triangle of each cell, level by level
  PagedArray<Link> link_;           ///< list entry of each triangle slot
};

}  // namespace trocar
