// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/triangulation/refined_borders.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace trocar::pipeline {

LabelBorders refined_borders(const LabelBorders& borders, std::span<const Pslg> outlines,
                             std::span<const Pslg> stored) {
  // An outline's edge, and the edges that it became.
  struct Divided {
    std::pair<LatticePoint, LatticePoint> ends;
    const Ring* ring;
    std::size_t first, edges;
    LatticePoint point(std::size_t i) const { return (*ring)[(first + i) % ring->size()]; }
  };
  std::vector<Divided> divided;
  for (std::size_t k = 0; k < outlines.size(); ++k) {
    for (std::size_t r = 0; r < outlines[k].rings.size(); ++r) {
      const Ring &ring = outlines[k].rings[r], &fine = stored[k].rings[r];
      std::size_t at = 0;
      for (std::size_t i = 0; i < ring.size(); ++i) {
        const LatticePoint to = ring[(i + 1) % ring.size()];
        const std::size_t first = at++;
        while (at < fine.size() && (i + 1 == ring.size() || fine[at] != to))
          ++at;
        divided.push_back({{ring[i], to}, &fine, first, at - first});
      }
    }
  }
  std::sort(divided.begin(), divided.end(),
            [](const Divided& a, const Divided& b) { return a.ends < b.ends; });
  LabelBorders out = borders;
  for (BorderChain& chain : out.chains) {
    const std::vector<LatticePoint> coarse = std::exchange(chain.points, {});
    const std::size_t edges = coarse.size() - (chain.is_closed ? 0 : 1);
    // The outline of the material on the left has the edge; if there is none, the outline of the
    // material on the right has its reverse.
    const bool is_forward = chain.left != kNoMaterial;
    for (std::size_t i = 0; i < edges; ++i) {
      std::pair ends{coarse[i], coarse[(i + 1) % coarse.size()]};
      if (!is_forward) std::swap(ends.first, ends.second);
      const auto found =
          std::lower_bound(divided.begin(), divided.end(), ends,
                           [](const Divided& a, const auto& b) { return a.ends < b; });
      for (std::size_t j = 0; j < found->edges; ++j)
        chain.points.push_back(found->point(is_forward ? j : found->edges - j));
    }
    if (!chain.is_closed) chain.points.push_back(coarse.back());
  }
  return out;
}

}  // namespace trocar::pipeline
