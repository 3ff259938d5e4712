// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/triangle_grid.h"

namespace trocar {

TriangleGrid::TriangleGrid(const SheetMesh& mesh, GridTriangles lists)
    : lists_(lists), link_(mesh.triangles.size()) {
  std::size_t count = 0;
  LatticeBox all;
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    if (!is_listed(mesh, t)) continue;
    const LatticeBox own = bounding_box(mesh, t);
    if (count++ == 0) all = own;
    widen(all, own.low);
    widen(all, own.high);
  }
  if (count == 0) return;
  origin_ = all.low;
  const std::int64_t width = std::int64_t{all.high.x} - all.low.x + 1;
  const std::int64_t height = std::int64_t{all.high.y} - all.low.y + 1;

  // The finest cells hold about two triangles; the coarsest grid has one cell.
  const double wanted = std::sqrt(2.0 * static_cast<double>(width) * static_cast<double>(height) /
                                  static_cast<double>(count));
  int shift = static_cast<int>(std::bit_width(static_cast<std::uint64_t>(wanted) | 1)) - 1;
  const auto cells_along = [](std::int64_t length, int s) { return ((length - 1) >> s) + 1; };
  while (static_cast<std::size_t>(cells_along(width, shift) * cells_along(height, shift)) >
         4 * count + 16)
    ++shift;
  for (std::size_t cells = 0;; ++shift) {
    Level level;
    level.shift = shift;
    level.columns = cells_along(width, shift);
    level.rows = cells_along(height, shift);
    level.first_cell = cells;
    levels_.push_back(level);
    cells += static_cast<std::size_t>(level.columns * level.rows);
    if (level.columns * level.rows == 1) {
      head_ = PagedArray<std::uint32_t>(cells, kNoSlot);
      break;
    }
  }
  // Insert in descending order, so that each cell lists its triangles in ascending order.
  for (auto t = static_cast<std::uint32_t>(mesh.triangles.size()); t-- > 0;) {
    if (is_listed(mesh, t)) insert(mesh, t);
  }
}

void TriangleGrid::update(const SheetChange& change, const SheetMesh& mesh) noexcept {
  for (const SheetChange::OldTriangle& old : change.triangles) {
    // A triangle with the same corners is moved, too, because their slots may hold
    // other points now.
    if (std::as_const(link_)[old.slot].cell != kNoSlot) remove(old.slot);
    if (is_listed(mesh, old.slot)) insert(mesh, old.slot);
  }
}

bool TriangleGrid::is_listed(const SheetMesh& mesh, std::uint32_t t) const noexcept {
  if (!mesh.in_use(t)) return false;
  const std::array<std::uint32_t, 3>& across = mesh.across[t];
  return lists_ == GridTriangles::kAll ||
         std::find(across.begin(), across.end(), kNoSlot) != across.end();
}

void TriangleGrid::insert(const SheetMesh& mesh, std::uint32_t t) noexcept {
  const LatticeBox box = bounding_box(mesh, t);
  const std::int64_t extent =
      std::max(std::int64_t{box.high.x} - box.low.x, std::int64_t{box.high.y} - box.low.y);
  const int fits = static_cast<int>(std::bit_width(static_cast<std::uint64_t>(extent - 1)));
  const int index =
      std::clamp(fits - levels_.front().shift, 0, static_cast<int>(levels_.size()) - 1);
  Level& level = levels_[static_cast<std::size_t>(index)];
  ++level.triangles;
  const std::size_t cell = level.cell(level.row(*this, box.low.y), level.column(*this, box.low.x));
  const std::uint32_t next = head_[cell];
  link_[t] = {next, kNoSlot, static_cast<std::uint32_t>(cell)};
  if (next != kNoSlot) link_[next].before = t;
  head_[cell] = t;
}

void TriangleGrid::remove(std::uint32_t t) noexcept {
  Link& own = link_[t];
  if (own.before != kNoSlot)
    link_[own.before].next = own.next;
  else
    head_[own.cell] = own.next;
  if (own.next != kNoSlot) link_[own.next].before = own.before;
  std::size_t level = levels_.size() - 1;
  while (levels_[level].first_cell > own.cell)
    --level;
  --levels_[level].triangles;
  own = {};
}

}  // namespace trocar
