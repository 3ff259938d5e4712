// SPDX-License-Identifier: Apache-2.0
// A uniform grid over a mesh's triangles: those near a box in time proportional
// to what is there, not to the mesh.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "formats/slice_mesh.h"
#include "runtime/remesh/lattice_box.h"

namespace trocar::runtime {

LatticeBox bounding_box(const SliceMesh& mesh, const Triangle& triangle) noexcept;

/// Holds indices only; the mesh must not change meanwhile. O(n) to build: at most
/// kEntriesPerTriangle n + 1 entries, however thin and long the triangles are.
class TriangleGrid {
 public:
  TriangleGrid() = default;
  /// All indices must be in range.
  explicit TriangleGrid(const SliceMesh& mesh);

  /// Calls visit(triangle index) once for every triangle whose bounding box meets
  /// `box`, cell by cell. No allocation.
  template <typename Visit>
  void for_each(const SliceMesh& mesh, const LatticeBox& box, Visit&& visit) const {
    if (columns_ == 0 || box.highest.x < origin_.x || box.highest.y < origin_.y) return;
    const std::int64_t left = column(box.lowest.x), right = column(box.highest.x);
    const std::int64_t bottom = row(box.lowest.y), top = row(box.highest.y);
    for (std::int64_t r = bottom; r <= top; ++r) {
      for (std::int64_t c = left; c <= right; ++c) {
        const std::size_t cell = static_cast<std::size_t>(r * columns_ + c);
        for (std::uint32_t k = start_[cell]; k < start_[cell + 1]; ++k) {
          const LatticeBox own = bounding_box(mesh, mesh.triangles[entry_[k]]);
          // A triangle stands in several cells: only the first of those looked at counts.
          if (std::max(column(own.lowest.x), left) != c || std::max(row(own.lowest.y), bottom) != r)
            continue;
          if (own.lowest.x > box.highest.x || own.highest.x < box.lowest.x ||
              own.lowest.y > box.highest.y || own.highest.y < box.lowest.y)
            continue;
          visit(entry_[k]);
        }
      }
    }
  }

 private:
  std::int64_t column(std::int32_t x) const noexcept {
    return std::clamp<std::int64_t>((std::int64_t{x} - origin_.x) / cell_, 0, columns_ - 1);
  }
  std::int64_t row(std::int32_t y) const noexcept {
    return std::clamp<std::int64_t>((std::int64_t{y} - origin_.y) / cell_, 0, rows_ - 1);
  }

  LatticePoint origin_;
  std::int64_t cell_ = 1;  ///< edge in steps
  std::int64_t columns_ = 0, rows_ = 0;
  std::vector<std::uint32_t> start_;  ///< of each cell's entries; one more at the end
  std::vector<std::uint32_t> entry_;  ///< triangle indices
};

}  // namespace trocar::runtime
