// SPDX-License-Identifier: Apache-2.0
#include "runtime/remesh/patch.h"

#include <algorithm>
#include <map>

#include "runtime/remesh/local_delaunay.h"

namespace trocar::runtime {
namespace {

struct Winding {
  int rim = 0;
  int tool = 0;
  bool known = false;
};

// The edges by their ends, to be asked in either direction.
class EdgeTable {
 public:
  explicit EdgeTable(const Overlay& overlay) : edges_(overlay.edges) {
    for (std::uint32_t i = 0; i < edges_.size(); ++i)
      index_[{edges_[i].a, edges_[i].b}] = i;
  }
  /// Null where no edge runs.
  const PlanarEdge* find(std::uint32_t a, std::uint32_t b) const {
    const auto at = index_.find({std::min(a, b), std::max(a, b)});
    return at == index_.end() ? nullptr : &edges_[at->second];
  }

 private:
  const std::vector<PlanarEdge>& edges_;
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> index_;
};

// Windings of rim and tool around every cell, spread from the box's corner,
// around which nothing winds.
std::vector<Winding> windings(const Triangulation& t, const EdgeTable& edges) {
  std::vector<Winding> out(t.cells.size());
  const auto corner = static_cast<std::uint32_t>(t.points.size() - 1);
  std::vector<std::uint32_t> pending;
  for (std::uint32_t c = 0; c < t.cells.size() && pending.empty(); ++c) {
    const std::array<std::uint32_t, 3>& v = t.cells[c].vertex;
    if (std::find(v.begin(), v.end(), corner) != v.end()) pending.push_back(c);
  }
  out[pending[0]].known = true;
  while (!pending.empty()) {
    const std::uint32_t c = pending.back();
    pending.pop_back();
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t beyond = t.cells[c].across[i];
      if (beyond == kNone || out[beyond].known) continue;
      Winding w = out[c];
      const std::uint32_t from = t.cells[c].vertex[i], to = t.cells[c].vertex[(i + 1) % 3];
      if (const PlanarEdge* e = edges.find(from, to)) {
        // This cell is on the left of from -> to; the right has one winding less.
        const int sign = from < to ? -1 : 1;
        w.rim += sign * e->rim;
        w.tool += sign * e->tool;
      }
      out[beyond] = w;
      pending.push_back(beyond);
    }
  }
  return out;
}

}  // namespace

Result<Patch> make_patch(const Overlay& overlay) {
  std::vector<std::array<std::uint32_t, 2>> constraints;
  for (const PlanarEdge& e : overlay.edges)
    constraints.push_back({e.a, e.b});
  Result<Triangulation> made = constrained_triangulation(overlay.points, constraints);
  if (!made) return made.error();
  Triangulation& t = *made;

  const EdgeTable edges(overlay);
  const std::vector<Winding> winding = windings(t, edges);
  std::vector<std::uint8_t> part(t.cells.size());
  for (std::size_t c = 0; c < part.size(); ++c) {
    part[c] = winding[c].rim >= 1 && winding[c].tool <= 0 ? 1 : 0;
  }
  restore_delaunay(t, part);

  Patch patch;
  patch.points = overlay.points;
  std::vector<std::uint32_t> number(t.cells.size(), kNone);
  for (std::uint32_t c = 0; c < t.cells.size(); ++c) {
    if (part[c] == 0) continue;
    number[c] = static_cast<std::uint32_t>(patch.triangles.size());
    patch.triangles.push_back(t.cells[c].vertex);
  }
  for (std::uint32_t c = 0; c < t.cells.size(); ++c) {
    if (part[c] == 0) continue;
    std::array<std::uint32_t, 3> across{kNone, kNone, kNone}, kept{kNone, kNone, kNone};
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t beyond = t.cells[c].across[i];
      if (beyond != kNone) across[i] = number[beyond];
      const std::uint32_t from = t.cells[c].vertex[i], to = t.cells[c].vertex[(i + 1) % 3];
      const PlanarEdge* e = edges.find(from, to);
      if (e == nullptr || e->kept == kNone) continue;
      if (e->kept_right == (from < to)) {
        kept[i] = e->kept;
      } else {
        patch.absorb.push_back(e->kept);
      }
    }
    patch.across.push_back(across);
    patch.kept.push_back(kept);
  }
  return patch;
}

}  // namespace trocar::runtime
