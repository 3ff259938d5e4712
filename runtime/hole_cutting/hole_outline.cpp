// SPDX-License-Identifier: Apache-2.0
#include "runtime/hole_cutting/hole_outline.h"

#include <algorithm>

#include "formats/geometry/edge_predicates.h"

namespace trocar::runtime {
namespace {

// Returns true if p comes before q when turning clockwise around v from the direction of u. Neither
// may lie in the direction of u.
bool sooner_clockwise(LatticePoint v, LatticePoint u, LatticePoint p, LatticePoint q) {
  const bool p_first = orient2d(v, u, p) <= 0, q_first = orient2d(v, u, q) <= 0;  // (0, 180] deg
  if (p_first != q_first) return p_first;
  return orient2d(v, p, q) < 0;
}

bool add(HoleOutline& hole, std::uint32_t from, std::uint32_t to) noexcept {
  const auto [a, b] = std::minmax(from, to);
  const auto fresh = static_cast<std::uint32_t>(hole.edges.size());
  const std::uint32_t* at = hole.edge_at.insert(pair_key(a, b), fresh);
  if (at == nullptr) return false;
  if (*at == fresh && !push_within(hole.edges, {a, b, 0})) return false;
  hole.edges[*at].count += from < to ? 1 : -1;
  return true;
}

// Adds an edge of the cavity's boundary that was bent, divided at the points of the overlay
// that lie on it.
bool add_divided(const Overlay& overlay, std::uint32_t from, std::uint32_t to,
                 HoleOutline& hole) noexcept {
  const std::vector<LatticePoint>& points = overlay.points;
  const LatticePoint a = points[from], b = points[to];
  hole.stops.clear();
  hole.stops.push_back(from);
  for (std::uint32_t p = 0; p < points.size(); ++p) {
    if (is_inside_segment(a, b, points[p])) hole.stops.push_back(p);
  }
  hole.stops.push_back(to);
  std::sort(hole.stops.begin(), hole.stops.end(), [&](std::uint32_t p, std::uint32_t q) {
    return a < b ? points[p] < points[q] : points[q] < points[p];
  });
  bool fits = true;
  for (std::size_t i = 0; i + 1 < hole.stops.size(); ++i)
    fits = fits && add(hole, hole.stops[i], hole.stops[i + 1]);
  return fits;
}

// Collects the edges of the cavity's boundary minus those of the patch's boundary.
bool collect_edges(const Cavity& cavity, const Overlay& overlay, const Patch& patch,
                   HoleOutline& hole) noexcept {
  hole.edges.clear();
  hole.edge_at.clear();
  bool fits = true;
  for (std::size_t e = 0; e < cavity.boundary.size(); ++e) {
    const std::uint32_t from = overlay.boundary_point[cavity.boundary[e].from];
    const std::uint32_t to = overlay.boundary_point[cavity.boundary[e].to];
    const bool whole = !overlay.strands[overlay.boundary_strand[e]].gone;
    fits = fits && (whole ? add(hole, from, to) : add_divided(overlay, from, to, hole));
  }
  for (std::size_t t = 0; t < patch.triangles.size(); ++t) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      if (patch.across[t][i] == kNoSlot)
        fits = fits && add(hole, patch.triangles[t][next_corner(i)], patch.triangles[t][i]);
    }
  }
  return fits;
}

// Lists the remaining edges by their start points, and the start points in ascending order.
bool list_by_point(const std::vector<LatticePoint>& points, HoleOutline& hole) noexcept {
  hole.out.clear();
  hole.starts.clear();
  hole.first_out.assign(points.size(), kNoSlot);
  hole.path_index.assign(points.size(), kNoSlot);
  for (const HoleOutline::CountedEdge& e : hole.edges) {
    const std::uint32_t from = e.count > 0 ? e.a : e.b, to = e.count > 0 ? e.b : e.a;
    for (std::int32_t n = std::abs(e.count); n > 0; --n) {
      if (hole.first_out[from] == kNoSlot) hole.starts.push_back(from);
      if (!push_within(hole.out, {to, hole.first_out[from]})) return false;
      hole.first_out[from] = static_cast<std::uint32_t>(hole.out.size() - 1);
    }
  }
  std::sort(hole.starts.begin(), hole.starts.end(),
            [&points](std::uint32_t p, std::uint32_t q) { return points[p] < points[q]; });
  return true;
}

// Removes the next edge of the walk from the list at v and returns its end. The walk comes from u;
// u is kNoSlot at the start of the walk.
std::uint32_t take_next(const std::vector<LatticePoint>& points, std::uint32_t u, std::uint32_t v,
                        HoleOutline& hole) noexcept {
  std::uint32_t* chosen = &hole.first_out[v];
  for (std::uint32_t* at = chosen; *at != kNoSlot; at = &hole.out[*at].next) {
    const LatticePoint p = points[hole.out[*at].to], best = points[hole.out[*chosen].to];
    if (u == kNoSlot ? p < best : sooner_clockwise(points[v], points[u], p, best)) chosen = at;
  }
  const HoleOutline::Out taken = hole.out[*chosen];
  *chosen = taken.next;
  return taken.to;
}

// Walks along the edges, always around the same connected area, and cuts off a ring wherever the
// walk returns to a point.
bool walk(const std::vector<LatticePoint>& points, HoleOutline& hole) noexcept {
  hole.unsorted.clear();
  hole.unsorted_rings.clear();
  for (const std::uint32_t start : hole.starts) {
    while (hole.first_out[start] != kNoSlot) {
      hole.path.clear();
      hole.path.push_back(start);
      hole.path_index[start] = 0;
      while (true) {
        const std::uint32_t v = hole.path.back();
        if (hole.first_out[v] == kNoSlot) {
          if (hole.path.size() > 1) return false;  // the walk does not close
          break;
        }
        const std::uint32_t u = hole.path.size() > 1 ? hole.path[hole.path.size() - 2] : kNoSlot;
        const std::uint32_t to = take_next(points, u, v, hole);
        if (hole.path_index[to] == kNoSlot) {
          hole.path_index[to] = static_cast<std::uint32_t>(hole.path.size());
          hole.path.push_back(to);
          continue;
        }
        const auto ring = static_cast<std::uint32_t>(hole.unsorted.size());
        const std::uint32_t from = hole.path_index[to];
        for (std::size_t i = from; i < hole.path.size(); ++i) {
          hole.unsorted.push_back(hole.path[i]);
          if (i > from) hole.path_index[hole.path[i]] = kNoSlot;
        }
        hole.path.resize(from + 1);
        hole.unsorted_rings.emplace_back(ring, hole.unsorted.size());
      }
      hole.path_index[start] = kNoSlot;
    }
  }
  return true;
}

void write_sorted(const std::vector<LatticePoint>& points, HoleOutline& hole) noexcept {
  const auto less = [&points](std::uint32_t p, std::uint32_t q) { return points[p] < points[q]; };
  for (const auto& [start, end] : hole.unsorted_rings) {
    const auto first = hole.unsorted.begin() + start, last = hole.unsorted.begin() + end;
    std::rotate(first, std::min_element(first, last, less), last);
  }
  std::sort(hole.unsorted_rings.begin(), hole.unsorted_rings.end(),
            [&](const auto& r, const auto& s) {
              return std::lexicographical_compare(
                  hole.unsorted.begin() + r.first, hole.unsorted.begin() + r.second,
                  hole.unsorted.begin() + s.first, hole.unsorted.begin() + s.second, less);
            });
  for (const auto& [start, end] : hole.unsorted_rings) {
    for (std::uint32_t i = start; i < end; ++i)
      hole.points.push_back(points[hole.unsorted[i]]);
    hole.ring_end.push_back(static_cast<std::uint32_t>(hole.points.size()));
  }
}

}  // namespace

void HoleOutline::allocate(std::size_t max_points, std::size_t max_edges) {
  reserve_touched(points, max_edges);
  reserve_touched(ring_end, max_edges);
  reserve_touched(edges, max_edges);
  edge_at.allocate(max_edges);
  reserve_touched(out, max_edges);
  reserve_touched(first_out, max_points);
  reserve_touched(path_index, max_points);
  reserve_touched(starts, max_points);
  reserve_touched(path, max_points);
  reserve_touched(stops, max_points);
  reserve_touched(unsorted, max_edges);
  reserve_touched(unsorted_rings, max_edges);
}

StageOutcome outline_hole(const Cavity& cavity, const Overlay& overlay, const Patch& patch,
                          HoleOutline& hole) noexcept {
  hole.points.clear();
  hole.ring_end.clear();
  if (!collect_edges(cavity, overlay, patch, hole)) return StageOutcome::kCapacity;
  if (!list_by_point(overlay.points, hole)) return StageOutcome::kCapacity;
  if (!walk(overlay.points, hole)) return StageOutcome::kBug;
  write_sorted(overlay.points, hole);
  return StageOutcome::kDone;
}

}  // namespace trocar::runtime
