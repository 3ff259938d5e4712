// SPDX-License-Identifier: Apache-2.0
// Finds the triangles of a sheet near a box. The time is proportional to the number of these
// triangles, not to the size of the mesh. A triangle is inserted or removed in constant time.
//
// There are several grids, and the cells of each grid are twice as large as those of the grid
// before. A triangle belongs to a single cell. The grid of this cell is the finest one whose cells
// are no smaller than the triangle's bounding box, and the cell is the one that contains the box's
// lower left corner. So a triangle extends at most into the next cell to the right and above. Every
// triangle slot needs one entry, however long and thin its triangle is, so no edit can exceed the
// capacity. (These are "loose" grids, after Ulrich's loose octree, 2000.)
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "formats/geometry/lattice_box.h"
#include "runtime/sheet_mesh/sheet_edit.h"
#include "runtime/sheet_mesh/sheet_mesh.h"

namespace trocar::runtime {

inline LatticeBox bounding_box(const SheetMesh& mesh, std::uint32_t t) noexcept {
  return box_around(corners(mesh, t));
}

/// Contract (tests/runtime/sheet_mesh/triangle_grid_test.cpp compares with a search of all
/// triangles):
///  1. for_each() visits every triangle in use whose bounding box is not apart() from the given
///     box, exactly once, and no other triangle. The order depends only on the mesh given to the
///     constructor and on the edits since then.
///  2. Only the constructor and add_slots() allocate.
class TriangleGrid {
 public:
  TriangleGrid() = default;
  /// Builds the grid for the triangles in use, with an entry for every slot. All indices must be in
  /// range. O(slots).
  explicit TriangleGrid(const SheetMesh& mesh);

  /// Updates the grid after an edit. `mesh`: the edited mesh. Call this once for each edit. The
  /// time is proportional to the edit.
  void update(const SheetEdit& edit, const SheetMesh& mesh) noexcept;

  /// Adds entries after SheetMesh::add_slots().
  void add_slots(const SheetMesh& mesh) { link_.resize(mesh.triangles.size()); }

  /// Calls visit(triangle slot) as in contract 1. No allocation.
  template <typename Visit>
  void for_each(const LatticeBox& box, Visit&& visit) const {
    for (const Level& level : levels_) {
      if (level.triangles == 0) continue;
      const std::int64_t left = std::max<std::int64_t>(level.column(*this, box.low.x) - 1, 0);
      const std::int64_t bottom = std::max<std::int64_t>(level.row(*this, box.low.y) - 1, 0);
      const std::int64_t right = level.column(*this, box.high.x);
      const std::int64_t top = level.row(*this, box.high.y);
      for (std::int64_t r = bottom; r <= top; ++r) {
        for (std::int64_t c = left; c <= right; ++c) {
          for (std::uint32_t t = head_[level.cell(r, c)]; t != kNone; t = link_[t].next) {
            if (!apart(link_[t].box, box)) visit(t);
          }
        }
      }
    }
  }

  /// Memory in use, in bytes.
  std::size_t bytes() const noexcept {
    return levels_.capacity() * sizeof(Level) + head_.capacity() * sizeof(std::uint32_t) +
           link_.capacity() * sizeof(Link);
  }

 private:
  struct Level {
    int shift = 0;                       ///< cells are 2^shift steps wide
    std::int64_t columns = 1, rows = 1;  ///< points outside the grid belong to the outermost cells
    std::size_t first_cell = 0;
    std::uint32_t triangles = 0;

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
    LatticeBox box;                              ///< bounding box of the triangle
    std::uint32_t next = kNone, before = kNone;  ///< neighbours in the list of its cell
    std::uint32_t cell = kNone;                  ///< cell of the triangle; kNone: in no cell
  };

  void insert(const SheetMesh& mesh, std::uint32_t t) noexcept;
  void remove(std::uint32_t t) noexcept;

  LatticePoint origin_;
  std::vector<Level> levels_;        ///< the finest first
  std::vector<std::uint32_t> head_;  ///< first triangle of each cell, level by level
  std::vector<Link> link_;           ///< list entry of each triangle slot
};

}  // namespace trocar::runtime
