// SPDX-License-Identifier: Apache-2.0
#include "formats/mesh/local_delaunay.h"

namespace trocar {
namespace {

// Returns the number that edge i of t has in the triangle beyond it.
std::uint32_t edge_beyond(const SheetMesh& mesh, std::uint32_t t, std::uint32_t i) {
  return corner_of(mesh.triangles[mesh.across[t][i]], mesh.triangles[t][next_corner(i)]);
}

bool is_delaunay(const SheetMesh& mesh, std::uint32_t t, std::uint32_t i) {
  const Triangle &v = mesh.triangles[t], &u = mesh.triangles[mesh.across[t][i]];
  return is_locally_delaunay(mesh.vertices[v[previous_corner(i)]], mesh.vertices[v[i]],
                             mesh.vertices[v[next_corner(i)]],
                             mesh.vertices[u[previous_corner(edge_beyond(mesh, t, i))]]);
}

// Replaces the neighbour's link to the triangle `before` by one to `now`.
void relink(SheetMesh& mesh, std::uint32_t neighbour, std::uint32_t before, std::uint32_t now,
            SheetEdit& edit) {
  if (neighbour == kNoSlot) return;
  edit.touch_triangle(mesh, neighbour);
  for (std::uint32_t& beyond : mesh.across[neighbour]) {
    if (beyond == before) beyond = now;
  }
}

// Replaces the edge (a, b) between (a, b, p) and (b, a, q) by (p, q).
void flip(SheetMesh& mesh, std::uint32_t t, std::uint32_t i, SheetEdit& edit) {
  const std::uint32_t u = mesh.across[t][i], j = edge_beyond(mesh, t, i);
  edit.touch_triangle(mesh, t);
  edit.touch_triangle(mesh, u);
  const Triangle old_t = mesh.triangles[t], old_u = mesh.triangles[u];
  const std::array<std::uint32_t, 3> beyond_t = mesh.across[t], beyond_u = mesh.across[u];
  const std::uint32_t a = old_t[i], b = old_t[next_corner(i)], p = old_t[previous_corner(i)],
                      q = old_u[previous_corner(j)];
  const std::uint32_t bp = beyond_t[next_corner(i)], pa = beyond_t[previous_corner(i)],
                      aq = beyond_u[next_corner(j)], qb = beyond_u[previous_corner(j)];
  mesh.triangles[t] = {p, a, q};
  mesh.across[t] = {pa, aq, u};
  mesh.triangles[u] = {q, b, p};
  mesh.across[u] = {qb, bp, t};
  relink(mesh, aq, u, t, edit);
  relink(mesh, bp, t, u, edit);
}

}  // namespace

void FlipSpace::allocate(std::size_t max_triangles) {
  reserve_touched(waiting, max_triangles);
  waits.allocate(max_triangles);
}

StageOutcome restore_delaunay(SheetMesh& mesh, std::span<const TriangleEdge> edges,
                              FlipSpace& space, SheetEdit& edit, std::uint32_t& flips) noexcept {
  space.waiting.clear();
  space.waits.clear();
  flips = 0;
  bool fits = true;
  const auto suspect = [&](std::uint32_t t) {
    std::uint32_t* waits = space.waits.insert(t, 0);
    if (waits == nullptr) {
      fits = false;
    } else if (*waits == 0) {
      *waits = 1;
      space.waiting.push_back(t);
    }
  };
  for (const auto& [t, i] : edges) {
    if (!is_delaunay(mesh, t, i)) suspect(t);
  }
  while (!space.waiting.empty() && fits) {
    const std::uint32_t t = space.waiting.back();
    space.waiting.pop_back();
    *space.waits.insert(t, 0) = 0;
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t u = mesh.across[t][i];
      if (u == kNoSlot || is_delaunay(mesh, t, i)) continue;
      flip(mesh, t, i, edit);
      ++flips;
      suspect(u);
      suspect(t);
      break;
    }
  }
  return fits ? StageOutcome::kDone : StageOutcome::kCapacity;
}

void LocalTriangulation::allocate(std::size_t max_points) {
  const std::size_t points = max_points + 4, cells = 2 * points;  // 2 n + 2 for n without the box
  reserve_touched(points_, points);
  reserve_touched(cells_, cells);
  reserve_touched(cell_at_, points);
  reserve_touched(suspects_, 3 * cells);
  reserve_touched(waits_, cells);
  reserve_touched(crossing_, 3 * cells);
}

LocalTriangulation::Status LocalTriangulation::triangulate(std::span<const LatticePoint> points,
                                                           int first_corner) noexcept {
  points_.clear();
  cells_.clear();
  last_ = 0;
  if (points.size() + 4 > points_.capacity()) return Status::kCapacity;
  points_.insert(points_.end(), points.begin(), points.end());
  enclose(first_corner);
  for (std::uint32_t v = 0; v < points.size(); ++v) {
    if (!insert(v)) return Status::kNotPlanar;
  }
  return Status::kDone;
}

// Makes two cells from the box of the points, enlarged by one step. The predicates are still exact
// there.
void LocalTriangulation::enclose(int first_corner) noexcept {
  LatticeBox box;
  if (!points_.empty()) box = box_around(points_);
  const auto n = static_cast<std::uint32_t>(points_.size());
  const std::array<LatticePoint, 4> around = {{{box.low.x - 1, box.low.y - 1},
                                               {box.high.x + 1, box.low.y - 1},
                                               {box.high.x + 1, box.high.y + 1},
                                               {box.low.x - 1, box.high.y + 1}}};
  for (int k = 0; k < 4; ++k)
    points_.push_back(around[static_cast<std::size_t>((first_corner + k) % 4)]);
  constexpr std::array<std::uint32_t, 3> kFree{kNoSlot, kNoSlot, kNoSlot};
  cells_.push_back({{n, n + 1, n + 2}, {kNoSlot, kNoSlot, 1}, kFree});
  cells_.push_back({{n, n + 2, n + 3}, {0, kNoSlot, kNoSlot}, kFree});
  cell_at_.assign(points_.size(), 0);
  cell_at_[n + 3] = 1;
}

// Inserts a point. Returns false if there is already a point at the same position.
bool LocalTriangulation::insert(std::uint32_t v) noexcept {
  const LatticePoint p = points_[v];
  // A visibility walk, which terminates because the cells are Delaunay.
  std::uint32_t c = last_;
  for (bool moved = true; moved;) {
    moved = false;
    for (std::uint32_t i = 0; i < 3; ++i) {
      if (orientation(c, i, p) < 0) {
        c = cells_[c].across[i];
        moved = true;
        break;
      }
    }
  }
  last_ = c;
  for (std::uint32_t i = 0; i < 3; ++i) {
    if (points_[cells_[c].vertex[i]] == p) return false;
  }
  std::uint32_t on_edge = kNoSlot;
  for (std::uint32_t i = 0; i < 3; ++i) {
    if (orientation(c, i, p) == 0) on_edge = i;
  }
  suspects_.clear();
  if (on_edge != kNoSlot)
    split_edge(c, on_edge, v);
  else
    split_cell(c, v);
  legalise();
  return true;
}

LocalTriangulation::Status LocalTriangulation::constrain(std::uint32_t a, std::uint32_t b,
                                                         std::uint32_t name) noexcept {
  crossing_.clear();
  CellEdge s = find(a, b);
  if (s.cell == kNoSlot) {
    if (!find_crossing(a, b)) return Status::kNotPlanar;
    // Sloan's method: flip the edges that cross ab, first in, first out, until no edge crosses it.
    // Valid input does not exhaust the budget.
    const std::size_t n = crossing_.size();
    std::size_t waiting = n, first = 0;
    for (std::size_t budget = 64 + 64 * n * n; waiting > 0; --budget) {
      if (budget == 0) return Status::kNotPlanar;
      const auto [v, w] = crossing_[first];
      first = first + 1 == n ? 0 : first + 1;
      --waiting;
      const auto put_back = [&](std::uint32_t from, std::uint32_t to) {
        const std::size_t at = first + waiting;
        crossing_[at >= n ? at - n : at] = {from, to};
        ++waiting;
      };
      const CellEdge between = find(v, w);
      if (between.cell == kNoSlot || cells_[between.cell].constraint[between.edge] != kNoSlot)
        return Status::kNotPlanar;
      const std::uint32_t c = apex(between), d = apex(opposite(between));
      const std::int64_t at_v = orient2d(points_[c], points_[d], points_[v]);
      const std::int64_t at_w = orient2d(points_[c], points_[d], points_[w]);
      if (!((at_v > 0 && at_w < 0) || (at_v < 0 && at_w > 0))) {
        put_back(v, w);
        continue;
      }
      flip(between);
      if (crosses(a, b, c, d)) put_back(c, d);
    }
    s = find(a, b);
    if (s.cell == kNoSlot) return Status::kNotPlanar;
  }
  const CellEdge o = opposite(s);
  cells_[s.cell].constraint[s.edge] = name;
  cells_[o.cell].constraint[o.edge] = name;
  return Status::kDone;
}

void LocalTriangulation::restore_delaunay(std::span<const std::uint8_t> region) noexcept {
  // Each cell is in the list at most once.
  suspects_.clear();
  waits_.assign(cells_.size(), 0);
  const auto suspect = [this](std::uint32_t c) {
    if (waits_[c] != 0) return;
    waits_[c] = 1;
    suspects_.push_back({c, 0});
  };
  for (auto c = static_cast<std::uint32_t>(cells_.size()); c-- > 0;) {
    if (region[c] != 0) suspect(c);
  }
  while (!suspects_.empty()) {
    const std::uint32_t c = suspects_.back().cell;
    suspects_.pop_back();
    waits_[c] = 0;
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t o = cells_[c].across[i];
      if (o == kNoSlot || region[o] != region[c] || is_delaunay({c, i})) continue;
      flip({c, i});
      suspect(o);
      suspect(c);
      break;
    }
  }
}

std::int64_t LocalTriangulation::orientation(std::uint32_t c, std::uint32_t i,
                                             LatticePoint p) const noexcept {
  return orient2d(points_[cells_[c].vertex[i]], points_[cells_[c].vertex[next_corner(i)]], p);
}
std::uint32_t LocalTriangulation::apex(CellEdge s) const noexcept {
  return cells_[s.cell].vertex[previous_corner(s.edge)];
}

// Returns the same edge as an edge of the cell beyond it. That cell must exist.
LocalTriangulation::CellEdge LocalTriangulation::opposite(CellEdge s) const noexcept {
  const std::uint32_t u = cells_[s.cell].across[s.edge];
  const std::uint32_t to = cells_[s.cell].vertex[next_corner(s.edge)];
  return {u, corner_of(cells_[u].vertex, to)};
}

void LocalTriangulation::link(CellEdge s, std::uint32_t other, std::uint32_t constraint) noexcept {
  cells_[s.cell].across[s.edge] = other;
  cells_[s.cell].constraint[s.edge] = constraint;
}

// Makes `s` the former edge i of the cell `old`, and updates the neighbour.
void LocalTriangulation::adopt(CellEdge s, const Cell& old, std::uint32_t i) noexcept {
  link(s, old.across[i], old.constraint[i]);
  if (old.across[i] == kNoSlot) return;
  Cell& beyond = cells_[old.across[i]];
  const std::uint32_t to = old.vertex[next_corner(i)];
  for (std::uint32_t j = 0; j < 3; ++j) {
    if (beyond.vertex[j] == to) beyond.across[j] = s.cell;
  }
}

void LocalTriangulation::set(std::uint32_t c, std::uint32_t v0, std::uint32_t v1,
                             std::uint32_t v2) noexcept {
  cells_[c].vertex = {v0, v1, v2};
  for (std::uint32_t v : cells_[c].vertex)
    cell_at_[v] = c;
}

std::uint32_t LocalTriangulation::new_cell() noexcept {
  cells_.push_back({{}, {kNoSlot, kNoSlot, kNoSlot}, {kNoSlot, kNoSlot, kNoSlot}});
  return static_cast<std::uint32_t>(cells_.size() - 1);
}

void LocalTriangulation::split_cell(std::uint32_t c, std::uint32_t v) noexcept {
  const Cell old = cells_[c];
  const std::array<std::uint32_t, 3> part = {c, new_cell(), new_cell()};
  for (std::uint32_t i = 0; i < 3; ++i)
    set(part[i], old.vertex[i], old.vertex[next_corner(i)], v);
  for (std::uint32_t i = 0; i < 3; ++i) {
    adopt({part[i], 0}, old, i);
    link({part[i], 1}, part[next_corner(i)], kNoSlot);
    link({part[i], 2}, part[previous_corner(i)], kNoSlot);
    suspects_.push_back({part[i], 0});
  }
}

// Splits edge i of cell c at v, which lies inside the edge. The edge is never an edge of the box.
void LocalTriangulation::split_edge(std::uint32_t c, std::uint32_t i, std::uint32_t v) noexcept {
  const CellEdge o = opposite({c, i});
  const std::uint32_t u = o.cell, j = o.edge;
  const Cell oc = cells_[c], ou = cells_[u];
  const std::uint32_t a = oc.vertex[i], b = oc.vertex[next_corner(i)];
  const std::uint32_t p = oc.vertex[previous_corner(i)], q = ou.vertex[previous_corner(j)];
  const std::uint32_t c2 = new_cell(), u2 = new_cell();
  const std::uint32_t constraint = oc.constraint[i];
  set(c, p, a, v);   // edges: pa (old), av, vp
  set(c2, b, p, v);  // bp (old), pv, vb
  set(u, q, b, v);   // qb (old), bv, vq
  set(u2, a, q, v);  // aq (old), qv, va
  adopt({c, 0}, oc, previous_corner(i));
  adopt({c2, 0}, oc, next_corner(i));
  adopt({u, 0}, ou, previous_corner(j));
  adopt({u2, 0}, ou, next_corner(j));
  link({c, 1}, u2, constraint);
  link({u2, 2}, c, constraint);
  link({c, 2}, c2, kNoSlot);
  link({c2, 1}, c, kNoSlot);
  link({c2, 2}, u, constraint);
  link({u, 1}, c2, constraint);
  link({u, 2}, u2, kNoSlot);
  link({u2, 1}, u, kNoSlot);
  for (std::uint32_t k : {c, c2, u, u2})
    suspects_.push_back({k, 0});
}

// Exchanges the diagonal of the two cells at s. Afterwards s.cell is (p, a, q).
void LocalTriangulation::flip(CellEdge s) noexcept {
  const CellEdge o = opposite(s);
  const Cell oc = cells_[s.cell], ou = cells_[o.cell];
  const std::uint32_t a = oc.vertex[s.edge], b = oc.vertex[next_corner(s.edge)];
  const std::uint32_t p = oc.vertex[previous_corner(s.edge)],
                      q = ou.vertex[previous_corner(o.edge)];
  set(s.cell, p, a, q);
  set(o.cell, q, b, p);
  adopt({s.cell, 0}, oc, previous_corner(s.edge));
  adopt({s.cell, 1}, ou, next_corner(o.edge));
  adopt({o.cell, 0}, ou, previous_corner(o.edge));
  adopt({o.cell, 1}, oc, next_corner(s.edge));
  link({s.cell, 2}, o.cell, kNoSlot);
  link({o.cell, 2}, s.cell, kNoSlot);
}

bool LocalTriangulation::is_delaunay(CellEdge s) const noexcept {
  const Cell& c = cells_[s.cell];
  return is_locally_delaunay(points_[apex(s)], points_[c.vertex[s.edge]],
                             points_[c.vertex[next_corner(s.edge)]], points_[apex(opposite(s))]);
}

// Checks the edges opposite the new point and flips them if necessary.
void LocalTriangulation::legalise() noexcept {
  while (!suspects_.empty()) {
    const CellEdge s = suspects_.back();
    suspects_.pop_back();
    if (cells_[s.cell].across[s.edge] == kNoSlot || is_delaunay(s)) continue;
    const std::uint32_t u = cells_[s.cell].across[s.edge];
    // After the flip the point is the first corner of s.cell and the last corner of u.
    flip(s);
    suspects_.push_back({s.cell, 1});
    suspects_.push_back({u, 0});
  }
}

// Returns the edge from v to w in the cell on its left. If there is no such edge, the
// cell is kNoSlot.
LocalTriangulation::CellEdge LocalTriangulation::find(std::uint32_t v,
                                                      std::uint32_t w) const noexcept {
  CellEdge found{kNoSlot, 0};
  around(v, [&](std::uint32_t c, std::uint32_t i) {
    if (cells_[c].vertex[next_corner(i)] == w) found = {c, i};
    return found.cell == kNoSlot;
  });
  return found;
}

// Calls visit(cell, corner of v) for every cell at v until it returns false. At a corner of the box
// the cells do not form a closed fan; then the walk continues from the start in the other
// direction.
template <typename Visit>
void LocalTriangulation::around(std::uint32_t v, Visit visit) const noexcept {
  const std::uint32_t start = cell_at_[v];
  for (const bool counter_clockwise : {true, false}) {
    std::uint32_t c = start;
    do {
      const Cell& cell = cells_[c];
      const std::uint32_t i = corner_of(cell.vertex, v);
      if (!visit(c, i)) return;
      c = cell.across[counter_clockwise ? previous_corner(i) : i];
    } while (c != start && c != kNoSlot);
    if (c == start) return;
  }
}

bool LocalTriangulation::crosses(std::uint32_t a, std::uint32_t b, std::uint32_t c,
                                 std::uint32_t d) const noexcept {
  if (c == a || c == b || d == a || d == b) return false;
  const std::int64_t at_c = orient2d(points_[a], points_[b], points_[c]);
  const std::int64_t at_d = orient2d(points_[a], points_[b], points_[d]);
  return (at_c < 0) != (at_d < 0);
}

// Walks from a to b and lists the edges that it crosses, each with its right end first. Returns
// false if a point on the segment, or the capacity, stops the walk.
bool LocalTriangulation::find_crossing(std::uint32_t a, std::uint32_t b) noexcept {
  CellEdge at{kNoSlot, 0};
  around(a, [&](std::uint32_t c, std::uint32_t i) {
    const LatticePoint right = points_[cells_[c].vertex[next_corner(i)]];
    const LatticePoint left = points_[cells_[c].vertex[previous_corner(i)]];
    if (orient2d(points_[a], points_[b], right) < 0 && orient2d(points_[a], points_[b], left) > 0)
      at = {c, next_corner(i)};
    return at.cell == kNoSlot;
  });
  while (at.cell != kNoSlot) {
    if (!push_within(crossing_, {cells_[at.cell].vertex[at.edge],
                                 cells_[at.cell].vertex[next_corner(at.edge)]}))
      return false;
    const CellEdge o = opposite(at);
    const std::uint32_t ahead = apex(o);
    if (ahead == b) return true;
    const std::int64_t side = orient2d(points_[a], points_[b], points_[ahead]);
    if (side == 0) return false;  // the point lies on the constraint
    // o runs from the left end to the right end; continue through the edge between `ahead` and the
    // end on the other side of ab.
    at = CellEdge{o.cell, side > 0 ? next_corner(o.edge) : previous_corner(o.edge)};
    if (cells_[at.cell].across[at.edge] == kNoSlot) return false;
  }
  return false;
}

}  // namespace trocar
