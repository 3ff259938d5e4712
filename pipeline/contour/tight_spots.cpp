// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/contour/tight_spots.h"

namespace trocar::pipeline {

std::vector<LatticeSegment> edges_of(const Pslg& outline, const std::vector<bool>& is_open) {
  std::vector<LatticeSegment> out;
  for (std::size_t r = 0; r < outline.rings.size(); ++r) {
    const Ring& ring = outline.rings[r];
    for (std::size_t k = 0; k + 1 < ring.size(); ++k)
      out.push_back({ring[k], ring[k + 1]});
    const bool open = !is_open.empty() && is_open[r];
    out.push_back({ring.back(), open ? ring.back() : ring[0]});
  }
  return out;
}

bool has_tight_spots(const std::vector<LatticeSegment>& edges, double clearance) {
  bool any = false;
  for_tight_spots(edges, SegmentGrid(edges, margin_of(clearance)), clearance,
                  [&any](std::uint32_t, std::uint32_t) { any = true; });
  return any;
}

}  // namespace trocar::pipeline
