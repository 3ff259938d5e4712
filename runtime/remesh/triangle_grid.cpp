// SPDX-License-Identifier: Apache-2.0
#include "runtime/remesh/triangle_grid.h"

#include <cmath>

namespace trocar::runtime {
namespace {

constexpr std::uint64_t kEntriesPerTriangle = 16;

}  // namespace

LatticeBox bounding_box(const SliceMesh& mesh, const Triangle& triangle) noexcept {
  const LatticePoint a = mesh.vertices[triangle[0]];
  const LatticePoint b = mesh.vertices[triangle[1]];
  const LatticePoint c = mesh.vertices[triangle[2]];
  return {{std::min({a.x, b.x, c.x}), std::min({a.y, b.y, c.y})},
          {std::max({a.x, b.x, c.x}), std::max({a.y, b.y, c.y})}};
}

TriangleGrid::TriangleGrid(const SliceMesh& mesh) {
  if (mesh.triangles.empty()) return;
  LatticeBox all = bounding_box(mesh, mesh.triangles.front());
  for (const Triangle& triangle : mesh.triangles) {
    const LatticeBox own = bounding_box(mesh, triangle);
    all.lowest = {std::min(all.lowest.x, own.lowest.x), std::min(all.lowest.y, own.lowest.y)};
    all.highest = {std::max(all.highest.x, own.highest.x), std::max(all.highest.y, own.highest.y)};
  }
  origin_ = all.lowest;
  const std::int64_t width = std::int64_t{all.highest.x} - all.lowest.x + 1;
  const std::int64_t height = std::int64_t{all.highest.y} - all.lowest.y + 1;

  // About two triangles a cell; larger cells where triangles are so thin and long
  // that their boxes would fill the grid. One cell in all always fits.
  const double wanted = std::sqrt(2.0 * static_cast<double>(width) * static_cast<double>(height) /
                                  static_cast<double>(mesh.triangles.size()));
  const std::int64_t longest = std::max(width, height);
  cell_ = std::clamp(static_cast<std::int64_t>(wanted), std::max<std::int64_t>(1, longest / 4096),
                     longest);
  const std::uint64_t limit = kEntriesPerTriangle * mesh.triangles.size() + 1;
  for (;; cell_ = std::min(2 * cell_, longest)) {
    columns_ = (width + cell_ - 1) / cell_;
    rows_ = (height + cell_ - 1) / cell_;
    std::uint64_t entries = 0;
    for (const Triangle& triangle : mesh.triangles) {
      const LatticeBox own = bounding_box(mesh, triangle);
      entries += static_cast<std::uint64_t>((column(own.highest.x) - column(own.lowest.x) + 1) *
                                            (row(own.highest.y) - row(own.lowest.y) + 1));
    }
    const std::uint64_t cells = static_cast<std::uint64_t>(columns_ * rows_);
    if ((entries <= limit && cells <= limit) || cells == 1) {
      start_.assign(cells + 1, 0);
      entry_.resize(entries);
      break;
    }
  }

  // Counting sort by cell: count, sum, place (from the back, so that a cell's
  // triangles end up in descending and then, by the reversal, ascending order).
  const auto for_each_cell = [&](std::size_t triangle, auto&& act) {
    const LatticeBox own = bounding_box(mesh, mesh.triangles[triangle]);
    for (std::int64_t r = row(own.lowest.y); r <= row(own.highest.y); ++r) {
      for (std::int64_t c = column(own.lowest.x); c <= column(own.highest.x); ++c) {
        act(static_cast<std::size_t>(r * columns_ + c));
      }
    }
  };
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    for_each_cell(t, [&](std::size_t cell) { ++start_[cell]; });
  }
  std::uint32_t sum = 0;
  for (std::uint32_t& start : start_)
    start = sum += start;
  for (std::size_t t = mesh.triangles.size(); t-- > 0;) {
    for_each_cell(
        t, [&](std::size_t cell) { entry_[--start_[cell]] = static_cast<std::uint32_t>(t); });
  }
}

}  // namespace trocar::runtime
