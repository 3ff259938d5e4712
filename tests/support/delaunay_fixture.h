// SPDX-License-Identifier: Apache-2.0
// Constrained Delaunay sheets for tests: any mesh after flips, and random meshes with holes, needles
// and features of the lattice's size.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "formats/mesh/cut.h"
#include "formats/mesh/sheet_mesh.h"
#include "tests/support/motions.h"
#include "tests/support/random_geometry.h"
#include "tests/support/same_sheet_mesh.h"
#include "tests/support/sheet_fixture.h"
#include "tests/support/whole_cut.h"

namespace trocar::runtime {

/// Flips edges (Lawson, 1977) until every inner one is locally Delaunay.
inline void flip_all(SheetMesh& mesh) {
  const auto replace = [&mesh](std::uint32_t t, std::uint32_t from, std::uint32_t to) {
    if (t != kNoSlot) std::replace(mesh.across[t].begin(), mesh.across[t].end(), from, to);
  };
  for (bool again = true; again;) {
    again = false;
    for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
      for (std::uint32_t i = 0; mesh.in_use(t) && i < 3; ++i) {
        const std::uint32_t u = mesh.across[t][i];
        if (u == kNoSlot) continue;
        std::uint32_t j = 0;
        while (mesh.across[u][j] != t)
          ++j;
        const std::uint32_t a = mesh.triangles[t][i], b = mesh.triangles[t][(i + 1) % 3],
                            c = mesh.triangles[t][(i + 2) % 3], d = mesh.triangles[u][(j + 2) % 3];
        if (in_circle(mesh.vertices[a], mesh.vertices[b], mesh.vertices[c], mesh.vertices[d]) <= 0)
          continue;
        const std::uint32_t bc = mesh.across[t][(i + 1) % 3], ca = mesh.across[t][(i + 2) % 3],
                            ad = mesh.across[u][(j + 1) % 3], db = mesh.across[u][(j + 2) % 3];
        mesh.triangles[t] = {a, d, c};
        mesh.across[t] = {ad, u, ca};
        mesh.triangles[u] = {d, b, c};
        mesh.across[u] = {db, bc, t};
        replace(ad, u, t);
        replace(bc, t, u);
        again = true;
        break;
      }
    }
  }
}

/// A square sheet with up to four random polygons cut out, and so many free slots.
inline SheetMesh random_sheet(Random& random, std::size_t spare_vertices,
                              std::size_t spare_triangles) {
  const int cells = random.between(1, 8), cell = random.between(30, 800);
  SliceMesh mesh = test::square_mesh({-cells * cell / 2, -cells * cell / 2}, cell, cells);
  const int extent = cells * cell;
  for (int cuts = random.between(0, 4); cuts > 0; --cuts) {
    const int radius = random.between(3, std::max(extent / 3, 4));
    const Result<CutResult> result =
        cut(mesh, any_tool(random, random.point(-extent / 2, extent / 2), radius));
    EXPECT_TRUE(result);
    if (result && !result->mesh.triangles.empty()) mesh = result->mesh;
  }
  SheetMesh sheet = *make_sheet_mesh(mesh, spare_vertices, spare_triangles);
  flip_all(sheet);
  return sheet;
}

inline std::vector<std::uint32_t> all_triangles(const SheetMesh& mesh) {
  std::vector<std::uint32_t> out;
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    if (mesh.in_use(t)) out.push_back(t);
  }
  return out;
}

/// A triangle by its points, the smallest first, independent of slots.
using Points = std::array<LatticePoint, 3>;
inline Points points_of(const SheetMesh& mesh, std::uint32_t t) {
  Points p = corners(mesh, t);
  std::rotate(p.begin(), std::min_element(p.begin(), p.end()), p.end());
  return p;
}
/// All of them, in ascending order.
inline std::vector<Points> points_of(const SheetMesh& mesh) {
  return test::canonical(to_slice_mesh(mesh));
}

/// A regular hexagon, rounded to the lattice.
inline Ring hexagon(LatticePoint centre, double radius, double turn_rad) {
  Ring ring;
  for (int i = 0; i < 6; ++i) {
    const double angle = turn_rad + i * std::numbers::pi / 3;
    ring.push_back({centre.x + static_cast<int>(std::lround(radius * std::cos(angle))),
                    centre.y + static_cast<int>(std::lround(radius * std::sin(angle)))});
  }
  return ring;
}

using trocar::test::same;

}  // namespace trocar::runtime
