// SPDX-License-Identifier: Apache-2.0
#include "runtime/remesh/local_delaunay.h"

#include <algorithm>
#include <deque>
#include <optional>
#include <string>
#include <utility>

namespace trocar::runtime {
namespace {

constexpr std::uint32_t kOutside = 0xffffffff;

struct Side {
  std::uint32_t cell;
  std::uint32_t side;
};

constexpr std::uint32_t next(std::uint32_t i) {
  return i == 2 ? 0 : i + 1;
}
constexpr std::uint32_t before(std::uint32_t i) {
  return i == 0 ? 2 : i - 1;
}

class Builder {
 public:
  explicit Builder(Triangulation& t)
      : points_(t.points), cells_(t.cells), cell_at_(t.points.size(), 0) {}

  // Two cells over the box of the points, a step wider than they are. That is
  // still within what the predicates take.
  void enclose() {
    LatticePoint low{}, high{};
    if (!points_.empty()) low = high = points_[0];
    for (LatticePoint p : points_) {
      low = {std::min(low.x, p.x), std::min(low.y, p.y)};
      high = {std::max(high.x, p.x), std::max(high.y, p.y)};
    }
    const auto n = static_cast<std::uint32_t>(points_.size());
    points_.push_back({low.x - 1, low.y - 1});
    points_.push_back({high.x + 1, low.y - 1});
    points_.push_back({high.x + 1, high.y + 1});
    points_.push_back({low.x - 1, high.y + 1});
    cells_.push_back({{n, n + 1, n + 2}, {kOutside, kOutside, 1}, {}});
    cells_.push_back({{n, n + 2, n + 3}, {0, kOutside, kOutside}, {}});
    cell_at_.assign(points_.size(), 0);
    cell_at_[n + 3] = 1;
  }

  // False if the point is already there.
  bool insert(std::uint32_t v) {
    const LatticePoint p = points_[v];
    // A visibility walk; it ends because the cells are Delaunay.
    std::uint32_t c = last_;
    for (bool moved = true; moved;) {
      moved = false;
      for (std::uint32_t i = 0; i < 3; ++i) {
        if (turn(c, i, p) < 0) {
          c = cells_[c].across[i];
          moved = true;
          break;
        }
      }
    }
    last_ = c;
    std::vector<Side> suspects;
    for (std::uint32_t i = 0; i < 3; ++i) {
      if (points_[cells_[c].vertex[i]] == p) return false;
    }
    for (std::uint32_t i = 0; i < 3; ++i) {
      if (turn(c, i, p) == 0) {
        split_side(c, i, v, suspects);
        legalise(suspects);
        return true;
      }
    }
    split_cell(c, v, suspects);
    legalise(suspects);
    return true;
  }

  // False if another constraint or a point is in the way.
  bool constrain(std::uint32_t a, std::uint32_t b) {
    std::deque<std::array<std::uint32_t, 2>> crossing;
    if (!find_crossing(a, b, crossing)) return false;
    // Sloan: flip what crosses ab until nothing does. A queue that comes round
    // more often than this has met input that it was not made for.
    const std::size_t n = crossing.size();
    for (std::size_t budget = 64 + 64 * n * n; !crossing.empty(); --budget) {
      if (budget == 0) return false;
      const auto [v, w] = crossing.front();
      crossing.pop_front();
      const std::optional<Side> s = find(v, w);
      if (!s || cells_[s->cell].locked[s->side]) return false;
      const std::uint32_t c = apex(*s), d = apex(opposite(*s));
      const std::int64_t at_v = orient2d(points_[c], points_[d], points_[v]);
      const std::int64_t at_w = orient2d(points_[c], points_[d], points_[w]);
      if (!((at_v > 0 && at_w < 0) || (at_v < 0 && at_w > 0))) {
        crossing.push_back({v, w});
        continue;
      }
      flip(*s);
      if (crosses(a, b, c, d)) crossing.push_back({c, d});
    }
    const std::optional<Side> s = find(a, b);
    if (!s) return false;
    const Side o = opposite(*s);
    cells_[s->cell].locked[s->side] = true;
    cells_[o.cell].locked[o.side] = true;
    return true;
  }

  void restore(const std::vector<std::uint8_t>& part) {
    std::vector<Side> suspects;
    for (std::uint32_t c = 0; c < cells_.size(); ++c) {
      for (std::uint32_t i = 0; i < 3; ++i)
        suspects.push_back({c, i});
    }
    while (!suspects.empty()) {
      const Side s = suspects.back();
      suspects.pop_back();
      const std::uint32_t o = cells_[s.cell].across[s.side];
      if (o == kOutside || part[o] != part[s.cell] || part[o] == 0 || is_delaunay(s)) continue;
      const std::uint32_t c = s.cell;
      flip(s);
      for (std::uint32_t i = 0; i < 3; ++i) {
        suspects.push_back({c, i});
        suspects.push_back({o, i});
      }
    }
  }

 private:
  std::int64_t turn(std::uint32_t c, std::uint32_t i, LatticePoint p) const {
    return orient2d(points_[cells_[c].vertex[i]], points_[cells_[c].vertex[next(i)]], p);
  }
  std::uint32_t apex(Side s) const { return cells_[s.cell].vertex[before(s.side)]; }

  // The same side seen from the cell beyond it, which must exist.
  Side opposite(Side s) const {
    const std::uint32_t u = cells_[s.cell].across[s.side];
    const std::uint32_t to = cells_[s.cell].vertex[next(s.side)];
    for (std::uint32_t j = 0; j < 2; ++j) {
      if (cells_[u].vertex[j] == to) return {u, j};
    }
    return {u, 2};
  }

  void link(Side s, std::uint32_t other, bool locked) {
    cells_[s.cell].across[s.side] = other;
    cells_[s.cell].locked[s.side] = locked;
  }

  // Cell c now has `s`'s old side i; tell the neighbour.
  void adopt(Side s, const Cell& old, std::uint32_t i) {
    link(s, old.across[i], old.locked[i]);
    if (old.across[i] == kOutside) return;
    Cell& beyond = cells_[old.across[i]];
    const std::uint32_t to = old.vertex[next(i)];
    for (std::uint32_t j = 0; j < 3; ++j) {
      if (beyond.vertex[j] == to) beyond.across[j] = s.cell;
    }
  }

  void set(std::uint32_t c, std::uint32_t v0, std::uint32_t v1, std::uint32_t v2) {
    cells_[c].vertex = {v0, v1, v2};
    for (std::uint32_t v : cells_[c].vertex)
      cell_at_[v] = c;
  }

  std::uint32_t new_cell() {
    cells_.push_back({{}, {kOutside, kOutside, kOutside}, {}});
    return static_cast<std::uint32_t>(cells_.size() - 1);
  }

  void split_cell(std::uint32_t c, std::uint32_t v, std::vector<Side>& suspects) {
    const Cell old = cells_[c];
    const std::array<std::uint32_t, 3> part = {c, new_cell(), new_cell()};
    for (std::uint32_t i = 0; i < 3; ++i)
      set(part[i], old.vertex[i], old.vertex[next(i)], v);
    for (std::uint32_t i = 0; i < 3; ++i) {
      adopt({part[i], 0}, old, i);
      link({part[i], 1}, part[next(i)], false);
      link({part[i], 2}, part[before(i)], false);
      suspects.push_back({part[i], 0});
    }
  }

  // v lies inside side i of cell c, which is never a side of the box.
  void split_side(std::uint32_t c, std::uint32_t i, std::uint32_t v, std::vector<Side>& suspects) {
    const Side o = opposite({c, i});
    const std::uint32_t u = o.cell, j = o.side;
    const Cell oc = cells_[c], ou = cells_[u];
    const std::uint32_t a = oc.vertex[i], b = oc.vertex[next(i)];
    const std::uint32_t p = oc.vertex[before(i)], q = ou.vertex[before(j)];
    const std::uint32_t c2 = new_cell(), u2 = new_cell();
    const bool locked = oc.locked[i];
    set(c, p, a, v);   // sides: pa (old), av, vp
    set(c2, b, p, v);  // bp (old), pv, vb
    set(u, q, b, v);   // qb (old), bv, vq
    set(u2, a, q, v);  // aq (old), qv, va
    adopt({c, 0}, oc, before(i));
    adopt({c2, 0}, oc, next(i));
    adopt({u, 0}, ou, before(j));
    adopt({u2, 0}, ou, next(j));
    link({c, 1}, u2, locked);
    link({u2, 2}, c, locked);
    link({c, 2}, c2, false);
    link({c2, 1}, c, false);
    link({c2, 2}, u, locked);
    link({u, 1}, c2, locked);
    link({u, 2}, u2, false);
    link({u2, 1}, u, false);
    for (std::uint32_t k : {c, c2, u, u2})
      suspects.push_back({k, 0});
  }

  // Turns the diagonal of the two cells at s. Afterwards s.cell is (p, a, q).
  void flip(Side s) {
    const Side o = opposite(s);
    const Cell oc = cells_[s.cell], ou = cells_[o.cell];
    const std::uint32_t a = oc.vertex[s.side], b = oc.vertex[next(s.side)];
    const std::uint32_t p = oc.vertex[before(s.side)], q = ou.vertex[before(o.side)];
    set(s.cell, p, a, q);
    set(o.cell, q, b, p);
    adopt({s.cell, 0}, oc, before(s.side));
    adopt({s.cell, 1}, ou, next(o.side));
    adopt({o.cell, 0}, ou, before(o.side));
    adopt({o.cell, 1}, oc, next(s.side));
    link({s.cell, 2}, o.cell, false);
    link({o.cell, 2}, s.cell, false);
  }

  bool is_delaunay(Side s) const {
    const Cell& c = cells_[s.cell];
    return in_circle(points_[c.vertex[0]], points_[c.vertex[1]], points_[c.vertex[2]],
                     points_[apex(opposite(s))]) <= 0;
  }

  // The sides opposite to the new point, which every flip leaves at side 0 of a
  // cell that ends in the point.
  void legalise(std::vector<Side>& suspects) {
    while (!suspects.empty()) {
      const Side s = suspects.back();
      suspects.pop_back();
      if (cells_[s.cell].across[s.side] == kOutside || is_delaunay(s)) continue;
      const std::uint32_t u = cells_[s.cell].across[s.side];
      // The point is the first corner of s.cell and the last of u after the flip.
      flip(s);
      suspects.push_back({s.cell, 1});
      suspects.push_back({u, 0});
    }
  }

  // The side from v to w, of the cell on its left.
  std::optional<Side> find(std::uint32_t v, std::uint32_t w) const {
    std::optional<Side> found;
    around(v, [&](std::uint32_t c, std::uint32_t i) {
      if (cells_[c].vertex[next(i)] == w) found = Side{c, i};
      return !found;
    });
    return found;
  }

  // Calls visit(cell, corner of v) for every cell at v until it says false. At
  // a corner of the box the cells do not close: then on from the start backwards.
  template <typename Visit>
  void around(std::uint32_t v, Visit visit) const {
    const std::uint32_t start = cell_at_[v];
    for (const std::uint32_t turn : {2U, 0U}) {  // counter-clockwise, then clockwise
      std::uint32_t c = start;
      do {
        const Cell& cell = cells_[c];
        const std::uint32_t i = cell.vertex[0] == v ? 0 : cell.vertex[1] == v ? 1 : 2;
        if (!visit(c, i)) return;
        c = cell.across[(i + turn) % 3];
      } while (c != start && c != kOutside);
      if (c == start) return;
    }
  }

  bool crosses(std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d) const {
    if (c == a || c == b || d == a || d == b) return false;
    const std::int64_t at_c = orient2d(points_[a], points_[b], points_[c]);
    const std::int64_t at_d = orient2d(points_[a], points_[b], points_[d]);
    return (at_c < 0) != (at_d < 0);
  }

  // Walks from a to b and lists the sides in between, right end first.
  bool find_crossing(std::uint32_t a, std::uint32_t b,
                     std::deque<std::array<std::uint32_t, 2>>& crossing) const {
    if (find(a, b)) return true;
    std::optional<Side> at;
    around(a, [&](std::uint32_t c, std::uint32_t i) {
      const LatticePoint right = points_[cells_[c].vertex[next(i)]];
      const LatticePoint left = points_[cells_[c].vertex[before(i)]];
      if (orient2d(points_[a], points_[b], right) < 0 &&
          orient2d(points_[a], points_[b], left) > 0) {
        at = Side{c, next(i)};
      }
      return !at;
    });
    while (at) {
      crossing.push_back(
          {cells_[at->cell].vertex[at->side], cells_[at->cell].vertex[next(at->side)]});
      const Side o = opposite(*at);
      const std::uint32_t ahead = apex(o);
      if (ahead == b) return true;
      const std::int64_t side = orient2d(points_[a], points_[b], points_[ahead]);
      if (side == 0) return false;  // a point on the constraint
      // o runs from the left end to the right end; go on through the side that
      // has `ahead` and the end on the other side of ab.
      at = Side{o.cell, side > 0 ? next(o.side) : before(o.side)};
      if (cells_[at->cell].across[at->side] == kOutside) return false;
    }
    return false;
  }

  std::vector<LatticePoint>& points_;
  std::vector<Cell>& cells_;
  std::vector<std::uint32_t> cell_at_;  // one cell at each point
  std::uint32_t last_ = 0;
};

}  // namespace

Result<Triangulation> constrained_triangulation(
    const std::vector<LatticePoint>& points,
    const std::vector<std::array<std::uint32_t, 2>>& constraints) {
  Triangulation out;
  out.points = points;
  Builder builder(out);
  builder.enclose();
  auto place = [&points](std::uint32_t v) {
    std::string text = std::to_string(points[v].x);
    text += ", ";
    text += std::to_string(points[v].y);
    return text;
  };
  for (std::uint32_t v = 0; v < points.size(); ++v) {
    if (!builder.insert(v)) return bug("local triangulation: point twice at " + place(v));
  }
  for (const auto& [a, b] : constraints) {
    if (a >= points.size() || b >= points.size() || a == b) {
      return bug("local triangulation: a constraint without two ends");
    }
    if (!builder.constrain(a, b)) {
      return bug("local triangulation: the constraint from " + place(a) + " to " + place(b) +
                 " crosses another or runs through a point");
    }
  }
  return out;
}

void restore_delaunay(Triangulation& triangulation, const std::vector<std::uint8_t>& part) {
  Builder(triangulation).restore(part);
}

}  // namespace trocar::runtime
