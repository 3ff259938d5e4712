// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/cut.h"

#include <numeric>

namespace trocar {
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
      if (strand.kept_right == (cells[c].vertex[i] == strand.a))
        kept[i] = strand.kept;
      else
        patch.absorb.push_back(strand.kept);
    }
    patch.across.push_back(across);
    patch.kept.push_back(kept);
  }
}

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

using Segment = ProofSpace::Segment;

// Proves statement 2 if the triangle beyond edge i is a new one. `apex` receives the apex
// of that triangle.
bool mutual(const Patch& patch, std::uint32_t t, std::uint32_t i, std::uint32_t& apex) {
  const std::uint32_t u = patch.across[t][i];
  const std::uint32_t from = patch.triangles[t][i], to = patch.triangles[t][next_corner(i)];
  for (std::uint32_t j = 0; j < 3; ++j) {
    if (patch.triangles[u][j] != to || patch.triangles[u][next_corner(j)] != from) continue;
    apex = patch.triangles[u][previous_corner(j)];
    return patch.across[u][j] == t;
  }
  return false;
}

// Proves statement 2 if the triangle beyond the edge is a kept one.
bool takes_kept_edge(const SheetMesh& mesh, std::uint32_t kept, LatticePoint from, LatticePoint to,
                     ProofSpace& space) {
  for (std::uint32_t j = 0; j < 3; ++j) {
    if (mesh.vertices[mesh.triangles[kept][j]] != to ||
        mesh.vertices[mesh.triangles[kept][next_corner(j)]] != from)
      continue;
    if (!space.kept_edge_at.contains(pair_key(kept, j))) return false;
    std::uint32_t& used = *space.kept_edge_at.insert(pair_key(kept, j), 0);
    return used++ == 0;
  }
  return false;
}

bool list_cavity_boundary(const Cavity& cavity, const Overlay& overlay, ProofSpace& space) {
  space.kept_edge_at.clear();
  space.boundary_at.clear();
  for (const CavityBoundaryEdge& e : cavity.boundary) {
    if (e.kept != kNoSlot) {
      if (space.kept_edge_at.insert(pair_key(e.kept, e.kept_edge), 0) == nullptr) return false;
    } else {
      const std::uint64_t key =
          pair_key(overlay.boundary_point[e.from], overlay.boundary_point[e.to]);
      if (space.boundary_at.insert(key, 0) == nullptr) return false;
    }
  }
  return true;
}

// Lists the boundary edges of kept triangles: edges shared with the cavity beyond which
// there is no new triangle, and the old boundary near the new boundary edges.
bool list_kept_boundary(const SheetMesh& mesh, const TriangleGrid& grid, const Cavity& cavity,
                        ProofSpace& space) {
  bool fits = true;
  for (const CavityBoundaryEdge& e : cavity.boundary) {
    if (e.kept != kNoSlot && space.kept_edge_at.find(pair_key(e.kept, e.kept_edge)) == 0)
      fits = fits && push_within(space.old, {mesh.vertices[cavity.boundary_vertices[e.to]],
                                             mesh.vertices[cavity.boundary_vertices[e.from]]});
  }
  LatticeBox box{space.fresh.front().a, space.fresh.front().a};
  for (const Segment& s : space.fresh)
    box = box_around(std::array<LatticePoint, 4>{box.low, box.high, s.a, s.b});
  const auto list_boundary = [&](std::uint32_t t) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      if (mesh.across[t][i] != kNoSlot || cavity.contains(t)) continue;
      const Triangle& v = mesh.triangles[t];
      fits =
          fits && push_within(space.old, {mesh.vertices[v[i]], mesh.vertices[v[next_corner(i)]]});
    }
  };
  if (contains(cavity.tool_box, box)) {
    for (const std::uint32_t t : cavity.near_tool)
      list_boundary(t);
  } else {
    grid.for_each(mesh, box, list_boundary);
  }
  return fits;
}

bool any_crossing(const ProofSpace& space) {
  for (std::size_t i = 0; i < space.fresh.size(); ++i) {
    const Segment& s = space.fresh[i];
    const LatticeBox box = box_around(s.a, s.b);
    const auto crosses = [&](const Segment& t) {
      return !apart(box, box_around(t.a, t.b)) && segments_cross(s.a, s.b, t.a, t.b);
    };
    for (std::size_t j = i + 1; j < space.fresh.size(); ++j) {
      if (crosses(space.fresh[j])) return true;
    }
    for (const Segment& t : space.old) {
      if (crosses(t)) return true;
    }
  }
  return false;
}

std::int64_t doubled_area_removed(const SheetMesh& mesh, const Cavity& cavity,
                                  const Overlay& overlay, const Patch& patch) {
  std::int64_t sum = 0;
  for (const std::uint32_t t : cavity.triangles) {
    const auto [a, b, c] = corners(mesh, t);
    sum += orient2d(a, b, c);
  }
  for (const Triangle& t : patch.triangles)
    sum -= orient2d(overlay.points[t[0]], overlay.points[t[1]], overlay.points[t[2]]);
  return sum;
}

// Proves statements 1 to 3, and lists the new boundary edges. Returns the violated
// statement, or null.
const char* find_defect(const SheetMesh& mesh, const Overlay& overlay, const Patch& patch,
                        ProofSpace& space, bool& full) {
  for (std::uint32_t t = 0; t < patch.triangles.size() && !full; ++t) {
    const std::array<LatticePoint, 3> p = {overlay.points[patch.triangles[t][0]],
                                           overlay.points[patch.triangles[t][1]],
                                           overlay.points[patch.triangles[t][2]]};
    if (orient2d(p[0], p[1], p[2]) <= 0) return "a new triangle is not counter-clockwise";
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t j = next_corner(i);
      if (patch.across[t][i] != kNoSlot) {
        std::uint32_t apex = 0;
        if (!mutual(patch, t, i, apex)) return "an edge of two new triangles is not mutual";
        if (t < patch.across[t][i] && in_circle(p[0], p[1], p[2], overlay.points[apex]) > 0)
          return "the patch is not constrained Delaunay";
      } else if (patch.kept[t][i] != kNoSlot) {
        if (!takes_kept_edge(mesh, patch.kept[t][i], p[i], p[j], space))
          return "a new triangle does not match the kept triangle at its edge";
      } else {
        const bool was_there =
            space.boundary_at.contains(pair_key(patch.triangles[t][i], patch.triangles[t][j]));
        full = full || !push_within(was_there ? space.old : space.fresh, {p[i], p[j]});
      }
    }
  }
  return nullptr;
}

std::int64_t doubled_area(const HoleOutline& hole) {
  std::int64_t sum = 0;
  for (std::size_t r = 0; r < hole.rings(); ++r) {
    const std::span<const LatticePoint> ring = hole.ring(r);
    for (std::size_t i = 1; i + 1 < ring.size(); ++i)
      sum += orient2d(ring[0], ring[i], ring[i + 1]);
  }
  return sum;
}

constexpr std::uint32_t kPlanned = kNoSlot - 1;  // the group gets a new vertex

// Lists the run around v to which the kept triangle belongs.
bool list_run(const SheetMesh& mesh, const Cavity& cavity, std::uint32_t v, std::uint32_t triangle,
              StitchSpace& space) {
  StitchSpace::Run run{v, static_cast<std::uint32_t>(space.corners.size()), 0};
  const auto number = static_cast<std::uint32_t>(space.runs.size());
  for (const bool counter_clockwise : {true, false}) {
    std::uint32_t t = triangle, last = triangle;
    do {
      const std::uint32_t i = corner_of(mesh.triangles[t], v);
      if ((t != triangle || counter_clockwise) && !push_within(space.corners, {t, i})) return false;
      last = t;
      t = mesh.across[t][counter_clockwise ? previous_corner(i) : i];
    } while (t != kNoSlot && t != triangle && !cavity.contains(t));
    // Only the ends of a run are adjacent to the cavity.
    if (space.run_at.insert(pair_key(last, v), number) == nullptr) return false;
  }
  run.end = static_cast<std::uint32_t>(space.corners.size());
  return push_within(space.runs, run);
}

// Lists the runs of kept triangles around the vertices of shared edges.
bool list_runs(const SheetMesh& mesh, const Cavity& cavity, StitchSpace& space) {
  space.corners.clear();
  space.runs.clear();
  space.run_at.clear();
  for (const CavityBoundaryEdge& e : cavity.boundary) {
    if (e.kept == kNoSlot) continue;
    for (const std::uint32_t v :
         {cavity.boundary_vertices[e.from], cavity.boundary_vertices[e.to]}) {
      if (space.run_at.contains(pair_key(e.kept, v))) continue;
      if (!list_run(mesh, cavity, v, e.kept, space)) return false;
    }
  }
  return true;
}

std::uint32_t find(StitchSpace& space, std::uint32_t i) {
  std::vector<std::uint32_t>& parent = space.parent;
  while (parent[i] != i)
    i = parent[i] = parent[parent[i]];
  return i;
}

void join(StitchSpace& space, std::uint32_t a, std::uint32_t b) {
  a = find(space, a);
  b = find(space, b);
  if (a != b) space.parent[std::max(a, b)] = std::min(a, b);
}

std::uint32_t node(const StitchSpace& space, std::uint32_t t, std::uint32_t i) {
  return static_cast<std::uint32_t>(space.runs.size()) + 3 * t + i;
}

// Groups the corners that are the same vertex because they meet at an edge.
bool group_corners(const SheetMesh& mesh, const Overlay& overlay, const Patch& patch,
                   StitchSpace& space) {
  const std::size_t nodes = space.runs.size() + 3 * patch.triangles.size();
  if (nodes > space.parent.capacity()) return false;
  space.parent.resize(nodes);
  std::iota(space.parent.begin(), space.parent.end(), 0U);
  for (std::uint32_t t = 0; t < patch.triangles.size(); ++t) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t j = next_corner(i);
      if (const std::uint32_t u = patch.across[t][i]; u != kNoSlot) {
        if (u < t) continue;  // these two are already joined
        const Triangle& beyond = patch.triangles[u];
        join(space, node(space, t, i), node(space, u, corner_of(beyond, patch.triangles[t][i])));
        join(space, node(space, t, j), node(space, u, corner_of(beyond, patch.triangles[t][j])));
      } else if (const std::uint32_t k = patch.kept[t][i]; k != kNoSlot) {
        for (const std::uint32_t c : {i, j}) {
          const LatticePoint p = overlay.points[patch.triangles[t][c]];
          for (const std::uint32_t v : mesh.triangles[k]) {
            if (mesh.vertices[v] == p)
              join(space, node(space, t, c), space.run_at.find(pair_key(k, v)));
          }
        }
      }
    }
  }
  return true;
}

// Plans one vertex for each group: the sheet's own vertex if no other group has it, otherwise
// a new one.
bool plan_vertices(const SheetMesh& mesh, const Cavity& cavity, const Overlay& overlay,
                   const Patch& patch, StitchSpace& space) {
  space.vertex.assign(space.parent.size(), kNoSlot);
  space.taken.clear();
  space.fresh.clear();
  bool fits = true;
  const auto plan = [&](std::uint32_t group, LatticePoint p) {
    space.vertex[group] = kPlanned;
    fits = fits && push_within(space.fresh, {group, p});
  };
  for (std::uint32_t r = 0; r < space.runs.size(); ++r) {
    const std::uint32_t group = find(space, r), v = space.runs[r].vertex;
    if (space.vertex[group] != kNoSlot) continue;
    if (space.taken.contains(v)) {
      plan(group, mesh.vertices[v]);
    } else {
      fits = fits && space.taken.insert(v, 1) != nullptr;
      space.vertex[group] = v;
    }
  }
  for (std::uint32_t t = 0; t < patch.triangles.size(); ++t) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t group = find(space, node(space, t, i));
      if (space.vertex[group] == kNoSlot) plan(group, overlay.points[patch.triangles[t][i]]);
    }
  }
  const std::size_t released =
      cavity.boundary_vertices.size() + cavity.inner.size() - space.taken.size();
  return fits && space.fresh.size() <= mesh.free_vertices.size() + released &&
         patch.triangles.size() <= mesh.free_triangles.size() + cavity.triangles.size();
}

void release(SheetMesh& mesh, const Cavity& cavity, const StitchSpace& space, SheetEdit& edit) {
  for (const CavityBoundaryEdge& e : cavity.boundary) {
    if (e.kept == kNoSlot) continue;
    edit.touch_triangle(mesh, e.kept);
    mesh.across[e.kept][e.kept_edge] = kNoSlot;
  }
  // Release in descending order, so that the lowest slots are reused first.
  for (std::size_t i = cavity.triangles.size(); i-- > 0;)
    edit.release_triangle(mesh, cavity.triangles[i]);
  for (std::size_t i = cavity.inner.size(); i-- > 0;)
    edit.release_vertex(mesh, cavity.inner[i]);
  for (std::size_t i = cavity.boundary_vertices.size(); i-- > 0;) {
    if (!space.taken.contains(cavity.boundary_vertices[i]))
      edit.release_vertex(mesh, cavity.boundary_vertices[i]);
  }
}

void number_vertices(SheetMesh& mesh, StitchSpace& space, SheetEdit& edit) {
  for (const StitchSpace::NewVertex& v : space.fresh)
    space.vertex[v.group] = edit.take_vertex(mesh, v.point);
  for (std::uint32_t r = 0; r < space.runs.size(); ++r) {
    const StitchSpace::Run& run = space.runs[r];
    const std::uint32_t v = space.vertex[find(space, r)];
    if (v == run.vertex) continue;
    for (std::uint32_t k = run.first; k < run.end; ++k) {
      const auto [t, c] = space.corners[k];
      edit.touch_triangle(mesh, t);
      mesh.triangles[t][c] = v;
    }
  }
}

void put_in(SheetMesh& mesh, const Patch& patch, StitchSpace& space, SheetEdit& edit) {
  space.created.clear();
  space.shared_edges.clear();
  for (std::uint32_t t = 0; t < patch.triangles.size(); ++t) {
    Triangle v{};
    for (std::uint32_t i = 0; i < 3; ++i)
      v[i] = space.vertex[find(space, node(space, t, i))];
    space.created.push_back(edit.take_triangle(mesh, v));
  }
  for (std::uint32_t t = 0; t < patch.triangles.size(); ++t) {
    const std::uint32_t slot = space.created[t];
    for (std::uint32_t i = 0; i < 3; ++i) {
      if (patch.across[t][i] != kNoSlot) {
        mesh.across[slot][i] = space.created[patch.across[t][i]];
      } else if (const std::uint32_t k = patch.kept[t][i]; k != kNoSlot) {
        mesh.across[slot][i] = k;
        space.shared_edges.push_back({slot, i});
        const std::uint32_t to = mesh.triangles[slot][next_corner(i)];
        mesh.across[k][corner_of(mesh.triangles[k], to)] = slot;
      }
    }
  }
}

bool is_tool(Outline tool) {
  const std::size_t n = tool.size();
  if (n < 3 || n > kMaxToolCorners) return false;
  for (std::size_t i = 0; i < n; ++i) {
    if (!is_on_lattice(tool[i])) return false;
    for (std::size_t j = 0; j < i; ++j) {
      if (tool[i] == tool[j]) return false;
    }
  }
  std::int64_t area = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const LatticePoint a = tool[i], b = tool[(i + 1) % n];
    area += orient2d(tool[0], a, b);
    for (std::size_t j = 0; j < i; ++j) {
      if (segments_cross(a, b, tool[j], tool[j + 1])) return false;
    }
  }
  return area > 0;
}

// Computes cavity, overlay and patch. If rounding affects a kept triangle, this is repeated with
// that triangle in the cavity. Each round adds triangles, so the loop terminates.
StageOutcome plan_patch(const SheetMesh& mesh, const TriangleGrid& grid, Outline tool,
                        CutWorkspace& work) noexcept {
  StageOutcome stage = find_cavity(mesh, grid, tool, work.cavity);
  if (work.cavity.triangles.empty()) return stage;
  while (stage == StageOutcome::kDone) {
    trace_boundary(mesh, work.cavity);
    stage = build_overlay(mesh, grid, work.cavity, work.overlay);
    std::span<const std::uint32_t> absorb = work.overlay.absorb;
    if (stage == StageOutcome::kDone) {
      stage = make_patch(work.overlay, work.patch);
      absorb = work.patch.absorb;
    }
    if (stage != StageOutcome::kAgain) return stage;
    stage = enlarge_cavity(absorb, work.cavity);
  }
  return stage;
}

// Returns the report of a stage that failed. `bug`: the reason if the stage ended with kBug.
CutReport failure(StageOutcome stage, const char* bug) noexcept {
  CutReport report;
  report.outcome = stage == StageOutcome::kCapacity ? CutOutcome::kCapacity : CutOutcome::kBug;
  if (report.outcome == CutOutcome::kBug) report.bug = bug;
  return report;
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

void ProofSpace::allocate(std::size_t max_edges) {
  reserve_touched(fresh, max_edges);
  reserve_touched(old, max_edges);
  kept_edge_at.allocate(max_edges);
  boundary_at.allocate(max_edges);
}

Proof prove(const SheetMesh& mesh, const TriangleGrid& grid, const Cavity& cavity,
            const Overlay& overlay, const Patch& patch, const HoleOutline& hole,
            ProofSpace& space) noexcept {
  Proof proof;
  space.fresh.clear();
  space.old.clear();
  proof.capacity_exceeded = !list_cavity_boundary(cavity, overlay, space);
  if (proof.capacity_exceeded) return proof;
  proof.bug = find_defect(mesh, overlay, patch, space, proof.capacity_exceeded);
  if (proof.capacity_exceeded || proof.bug != nullptr) return proof;
  if (!space.fresh.empty()) {
    proof.capacity_exceeded = !list_kept_boundary(mesh, grid, cavity, space);
    if (proof.capacity_exceeded) return proof;
    if (any_crossing(space)) proof.bug = "edges of the new boundary cross";
  }
  proof.doubled_area_removed = doubled_area_removed(mesh, cavity, overlay, patch);
  if (doubled_area(hole) != proof.doubled_area_removed)
    proof.bug = "the hole's area is not the area that the sheet has lost";
  return proof;
}

void StitchSpace::allocate(std::size_t max_triangles, std::size_t max_points) {
  const std::size_t max_corners = 6 * max_triangles, max_created = 2 * (max_points + 4);
  reserve_touched(corners, max_corners);
  reserve_touched(runs, 3 * max_triangles);
  run_at.allocate(max_corners);
  reserve_touched(parent, 3 * max_triangles + 3 * max_created);
  reserve_touched(vertex, 3 * max_triangles + 3 * max_created);
  taken.allocate(3 * max_triangles);
  reserve_touched(fresh, 3 * max_created);
  reserve_touched(created, max_created);
  reserve_touched(shared_edges, 3 * max_created);
}

StageOutcome stitch(SheetMesh& mesh, const Cavity& cavity, const Overlay& overlay,
                    const Patch& patch, StitchSpace& space, SheetEdit& edit) noexcept {
  if (!list_runs(mesh, cavity, space) || !group_corners(mesh, overlay, patch, space) ||
      !plan_vertices(mesh, cavity, overlay, patch, space))
    return StageOutcome::kCapacity;
  release(mesh, cavity, space, edit);
  number_vertices(mesh, space, edit);
  put_in(mesh, patch, space, edit);
  return StageOutcome::kDone;
}

std::string_view to_string(CutOutcome outcome) noexcept {
  switch (outcome) {
    case CutOutcome::kCut:
      return "cut";
    case CutOutcome::kNoOverlap:
      return "no overlap";
    case CutOutcome::kInvalidTool:
      return "invalid tool";
    case CutOutcome::kCapacity:
      return "capacity";
    case CutOutcome::kBug:
      break;
  }
  return "bug";
}

std::uint32_t count_obtuse_boundary_edges(const SheetMesh& mesh, const SheetEdit& edit) noexcept {
  std::uint32_t count = 0;
  for (const SheetEdit::OldTriangle& written : edit.triangles()) {
    if (!mesh.in_use(written.slot)) continue;
    const std::array<LatticePoint, 3> p = corners(mesh, written.slot);
    for (std::uint32_t i = 0; i < 3; ++i) {
      if (mesh.across[written.slot][i] == kNoSlot &&
          encroaches(p[i], p[next_corner(i)], p[previous_corner(i)]))
        ++count;
    }
  }
  return count;
}

CutReport cut_in_place(SheetMesh& mesh, const TriangleGrid& grid, Outline tool, CutWorkspace& work,
                       SheetEdit& edit) noexcept {
  edit.begin(mesh);
  work.hole.points.clear();
  work.hole.ring_end.clear();
  work.stitch.created.clear();
  CutReport report;
  if (!is_tool(tool)) {
    report.outcome = CutOutcome::kInvalidTool;
    return report;
  }
  StageOutcome stage = plan_patch(mesh, grid, tool, work);
  if (stage != StageOutcome::kDone)
    return failure(stage, "the cavity's boundary and the tool are not planar");
  if (work.cavity.triangles.empty()) return report;

  stage = outline_hole(work.cavity, work.overlay, work.patch, work.hole);
  if (stage != StageOutcome::kDone) return failure(stage, "the outline of the hole does not close");
  const Proof proof =
      prove(mesh, grid, work.cavity, work.overlay, work.patch, work.hole, work.proof);
  if (proof.capacity_exceeded) return failure(StageOutcome::kCapacity, nullptr);
  if (proof.bug != nullptr) return failure(StageOutcome::kBug, proof.bug);

  stage = stitch(mesh, work.cavity, work.overlay, work.patch, work.stitch, edit);
  if (stage == StageOutcome::kDone)
    stage = restore_delaunay(mesh, work.stitch.shared_edges, work.flips, edit, report.flips);
  if (stage != StageOutcome::kDone) {
    edit.undo(mesh);
    return failure(stage, nullptr);
  }
  report.outcome = CutOutcome::kCut;
  report.doubled_area_removed = proof.doubled_area_removed;
  report.triangles_removed = static_cast<std::uint32_t>(work.cavity.triangles.size());
  report.triangles_created = static_cast<std::uint32_t>(work.patch.triangles.size());
  report.obtuse_boundary_edges = count_obtuse_boundary_edges(mesh, edit);
  return report;
}

}  // namespace trocar
