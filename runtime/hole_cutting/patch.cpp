// SPDX-License-Identifier: Apache-2.0
#include "runtime/hole_cutting/patch.h"

namespace trocar::runtime {
namespace {

using Status = LocalTriangulation::Status;

StageOutcome triangulate(const Overlay& overlay, LocalTriangulation& triangulation) noexcept {
  Status status = triangulation.triangulate(overlay.points, overlay.rotation.lower_left());
  for (std::uint32_t s = 0; s < overlay.strands.size() && status == Status::kDone; ++s) {
    const Strand& strand = overlay.strands[s];
    if (strand.gone) continue;
    // Constraints start at the end that comes first after the overlay's rotation.
    const bool as_it_is = overlay.rotation(strand.first) < overlay.rotation(strand.second);
    status = as_it_is ? triangulation.constrain(strand.a, strand.b, s)
                      : triangulation.constrain(strand.b, strand.a, s);
  }
  return status == Status::kDone       ? StageOutcome::kDone
         : status == Status::kCapacity ? StageOutcome::kCapacity
                                       : StageOutcome::kBug;
}

// Finds the cells that are material from the winding numbers of cavity and tool, which are
// propagated from the box's corner, where both are zero.
void find_regions(const Overlay& overlay, Patch& patch) noexcept {
  const LocalTriangulation& t = patch.triangulation;
  constexpr std::uint8_t kNotYet = 2;
  patch.windings.assign(t.cells().size(), {0, 0});
  patch.region.assign(t.cells().size(), kNotYet);
  patch.pending.clear();
  const std::uint32_t start = t.cell_at(static_cast<std::uint32_t>(t.points().size() - 1));
  patch.region[start] = 0;
  patch.pending.push_back(start);
  while (!patch.pending.empty()) {
    const std::uint32_t c = patch.pending.back();
    patch.pending.pop_back();
    const Cell& cell = t.cells()[c];
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t beyond = cell.across[i];
      if (beyond == kNoSlot || patch.region[beyond] != kNotYet) continue;
      Patch::Winding w = patch.windings[c];
      if (cell.constraint[i] != kNoSlot) {
        // This cell is on the left of edge i. On the right the winding number is lower by
        // one per edge.
        const Strand& strand = overlay.strands[cell.constraint[i]];
        const std::int32_t sign = cell.vertex[i] == strand.a ? -1 : 1;
        w.cavity += sign * strand.cavity;
        w.tool += sign * strand.tool;
      }
      patch.windings[beyond] = w;
      patch.region[beyond] = w.cavity >= 1 && w.tool <= 0 ? 1 : 0;
      patch.pending.push_back(beyond);
    }
  }
}

// Lists the cells of region 1 as triangles, with the triangle beyond each of their edges.
void collect(const Overlay& overlay, Patch& patch) noexcept {
  const std::span<const Cell> cells = patch.triangulation.cells();
  patch.triangles.clear();
  patch.across.clear();
  patch.kept.clear();
  patch.absorb.clear();
  patch.number.assign(cells.size(), kNoSlot);
  for (std::uint32_t c = 0; c < cells.size(); ++c) {
    if (patch.region[c] == 0) continue;
    patch.number[c] = static_cast<std::uint32_t>(patch.triangles.size());
    patch.triangles.push_back(cells[c].vertex);
  }
  for (std::uint32_t c = 0; c < cells.size(); ++c) {
    if (patch.region[c] == 0) continue;
    std::array<std::uint32_t, 3> across{kNoSlot, kNoSlot, kNoSlot}, kept{kNoSlot, kNoSlot, kNoSlot};
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t beyond = cells[c].across[i];
      if (beyond != kNoSlot) across[i] = patch.number[beyond];
      if (cells[c].constraint[i] == kNoSlot) continue;
      const Strand& strand = overlay.strands[cells[c].constraint[i]];
      if (strand.kept == kNoSlot) continue;
      if (strand.kept_right == (cells[c].vertex[i] == strand.a)) {
        kept[i] = strand.kept;
      } else {
        patch.absorb.push_back(strand.kept);
      }
    }
    patch.across.push_back(across);
    patch.kept.push_back(kept);
  }
}

}  // namespace

void Patch::allocate(std::size_t max_points) {
  triangulation.allocate(max_points);
  const std::size_t cells = 2 * (max_points + 4);
  reserve_touched(triangles, cells);
  reserve_touched(across, cells);
  reserve_touched(kept, cells);
  reserve_touched(absorb, 3 * cells);
  reserve_touched(windings, cells);
  reserve_touched(region, cells);
  reserve_touched(number, cells);
  reserve_touched(pending, cells);
}

StageOutcome make_patch(const Overlay& overlay, Patch& patch) noexcept {
  if (const StageOutcome stage = triangulate(overlay, patch.triangulation);
      stage != StageOutcome::kDone)
    return stage;
  find_regions(overlay, patch);
  patch.triangulation.restore_delaunay(patch.region);
  collect(overlay, patch);
  return patch.absorb.empty() ? StageOutcome::kDone : StageOutcome::kAgain;
}

}  // namespace trocar::runtime
