// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>

#include "runtime/remesh/patch.h"

namespace trocar::runtime {
namespace {

// Directed edges with multiplicities, in which opposite ones cancel.
class Chain {
 public:
  void add(LatticePoint from, LatticePoint to) {
    if (from < to) {
      ++count_[{from, to}];
    } else {
      --count_[{to, from}];
    }
  }

  /// The ends of the edges that start at each point.
  std::map<LatticePoint, std::vector<LatticePoint>> outgoing() const {
    std::map<LatticePoint, std::vector<LatticePoint>> out;
    for (const auto& [edge, n] : count_) {
      for (int i = 0; i < n; ++i)
        out[edge.first].push_back(edge.second);
      for (int i = 0; i > n; --i)
        out[edge.second].push_back(edge.first);
    }
    return out;
  }

 private:
  std::map<std::pair<LatticePoint, LatticePoint>, int> count_;
};

// Turning clockwise at v from the direction of u, does p come before q? Neither
// lies in the direction of u.
bool sooner_clockwise(LatticePoint v, LatticePoint u, LatticePoint p, LatticePoint q) {
  auto in_first_half = [v, u](LatticePoint r) {  // (0, 180] degrees clockwise
    const std::int64_t side = orient2d(v, u, r);
    return side < 0 || side == 0;
  };
  const bool p_first = in_first_half(p), q_first = in_first_half(q);
  if (p_first != q_first) return p_first;
  return orient2d(v, p, q) < 0;
}

}  // namespace

Result<std::vector<Ring>> removed_outline(const SliceMesh& sheet, const Cavity& cavity,
                                          const Patch& patch) {
  Chain chain;
  for (const RimEdge& e : cavity.rim) {
    const LatticePoint a = sheet.vertices[e.from], b = sheet.vertices[e.to];
    // The patch may have points on the edge: the same pieces here, so that they cancel.
    std::vector<LatticePoint> stops = {a, b};
    for (LatticePoint p : patch.points) {
      if (orient2d(a, b, p) == 0 && diametral_dot(a, b, p) < 0) stops.push_back(p);
    }
    std::sort(stops.begin(), stops.end());
    for (std::size_t i = 0; i + 1 < stops.size(); ++i) {
      if (a < b) {
        chain.add(stops[i], stops[i + 1]);
      } else {
        chain.add(stops[i + 1], stops[i]);
      }
    }
  }
  for (std::size_t t = 0; t < patch.triangles.size(); ++t) {
    for (std::size_t i = 0; i < 3; ++i) {
      if (patch.across[t][i] != kNone) continue;
      chain.add(patch.points[patch.triangles[t][(i + 1) % 3]], patch.points[patch.triangles[t][i]]);
    }
  }

  // Walk along what is left, always round the same piece of area, and take off
  // a ring wherever the walk comes back to a point.
  std::map<LatticePoint, std::vector<LatticePoint>> outgoing = chain.outgoing();
  std::vector<Ring> rings;
  while (!outgoing.empty()) {
    Ring path = {outgoing.begin()->first};
    while (true) {
      const auto at = outgoing.find(path.back());
      if (at == outgoing.end()) {
        if (path.size() == 1) break;
        return bug("cut: the outline of the hole does not close");
      }
      std::vector<LatticePoint>& ends = at->second;
      auto chosen = ends.begin();
      if (path.size() > 1) {
        const LatticePoint v = path.back(), u = path[path.size() - 2];
        for (auto end = ends.begin(); end != ends.end(); ++end) {
          if (sooner_clockwise(v, u, *end, *chosen)) chosen = end;
        }
      }
      const LatticePoint to = *chosen;
      ends.erase(chosen);
      if (ends.empty()) outgoing.erase(at);
      const auto seen = std::find(path.begin(), path.end(), to);
      if (seen == path.end()) {
        path.push_back(to);
        continue;
      }
      Ring ring(seen, path.end());
      path.erase(seen + 1, path.end());
      std::rotate(ring.begin(), std::min_element(ring.begin(), ring.end()), ring.end());
      rings.push_back(std::move(ring));
    }
  }
  std::sort(rings.begin(), rings.end());
  return rings;
}

}  // namespace trocar::runtime
