// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/triangulation/fill_nodes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

namespace trocar::pipeline {

double fill_edge(double doubled_area) {
  return std::sqrt(2 / std::numbers::sqrt3 * doubled_area);
}

void list_fill_nodes(const RefinementMesh& mesh, double doubled_area, double triangles,
                     std::vector<FillNode>& nodes) {
  nodes.clear();
  const double edge = fill_edge(doubled_area);
  const auto dx = 2 * static_cast<std::int64_t>(edge / 2),
             dy = static_cast<std::int64_t>(doubled_area / static_cast<double>(dx));
  // All points are relative to this one, so that the mesh moves with its outline.
  LatticePoint o = mesh.points[0];
  for (const LatticePoint p : mesh.points)
    o = {std::min(o.x, p.x), std::min(o.y, p.y)};
  // This bounds the running time for any outline; the lattice need not be complete.
  auto rows_left =
      static_cast<std::int64_t>(16 * (triangles + static_cast<double>(mesh.points.size())));
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const std::array<std::uint32_t, 3>& v = mesh.triangles[t].v;
    const LatticePoint a = mesh.points[v[0]], b = mesh.points[v[1]], c = mesh.points[v[2]];
    if (static_cast<double>(orient2d(a, b, c)) <= doubled_area) continue;
    const std::int64_t low = std::min({a.y, b.y, c.y}) - std::int64_t{o.y},
                       high = std::max({a.y, b.y, c.y}) - std::int64_t{o.y};
    for (std::int64_t row = (low + dy - 1) / dy; row * dy <= high; ++row) {
      if (--rows_left < 0) return;
      const std::int64_t y = row * dy, shift = row % 2 * (dx / 2);
      double from = std::numeric_limits<double>::max(), to = -from;
      for (const auto& [p, q] : {std::pair{a, b}, std::pair{b, c}, std::pair{c, a}}) {
        const auto px = static_cast<double>(std::int64_t{p.x} - o.x),
                   py = static_cast<double>(std::int64_t{p.y} - o.y - y),
                   qx = static_cast<double>(std::int64_t{q.x} - o.x),
                   qy = static_cast<double>(std::int64_t{q.y} - o.y - y);
        if ((py < 0) == (qy < 0)) continue;
        const double x = px + (qx - px) * (py / (py - qy));
        from = std::min(from, x), to = std::max(to, x);
      }
      if (from > to) continue;  // the row touches the triangle's highest corner
      const auto step = static_cast<double>(dx), first = static_cast<double>(shift);
      for (auto column = static_cast<std::int64_t>(std::ceil((from - first) / step));
           static_cast<double>(shift + column * dx) <= to; ++column)
        nodes.push_back({t,
                         {static_cast<std::int32_t>(o.x + shift + column * dx),
                          static_cast<std::int32_t>(o.y + y)}});
    }
  }
}

}  // namespace trocar::pipeline
