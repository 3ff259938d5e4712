// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>
#include <vector>

#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/slice_mesh.h"

namespace trocar::test {

using DirectedEdges = std::vector<std::pair<LatticePoint, LatticePoint>>;

/// Simple rings from directed edges with the material on their left. Where several edges leave a
/// point, the one that bounds the same connected component.
inline Pslg rings_of(const DirectedEdges& edges) {
  std::map<LatticePoint, std::vector<LatticePoint>> out;
  for (const auto& [from, to] : edges)
    out[from].push_back(to);
  Pslg pslg;
  for (auto& [start, leaving] : out) {
    while (!leaving.empty()) {
      Ring path;
      LatticePoint from = start, at = leaving.back();
      leaving.pop_back();
      path.push_back(start);
      while (at != start) {
        path.push_back(at);
        std::vector<LatticePoint>& next = out[at];
        const auto clockwise = [&](LatticePoint q) {
          const double angle =
              std::atan2(from.y - at.y, from.x - at.x) - std::atan2(q.y - at.y, q.x - at.x);
          return angle <= 0 ? angle + 2 * std::numbers::pi : angle;
        };
        const auto best = std::min_element(
            next.begin(), next.end(),
            [&](LatticePoint p, LatticePoint q) { return clockwise(p) < clockwise(q); });
        from = at;
        at = *best;
        next.erase(best);
      }
      split_at_pinches(path, pslg.rings);
    }
  }
  return pslg;
}

}  // namespace trocar::test
