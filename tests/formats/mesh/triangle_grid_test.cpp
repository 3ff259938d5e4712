// SPDX-License-Identifier: Apache-2.0
// The contract of formats/mesh/triangle_grid.h compared with a search of all triangles, on
// triangles without any order; the grid does not need a valid mesh.
#include "formats/mesh/triangle_grid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <set>
#include <utility>

#include "tests/support/random_geometry.h"

namespace trocar::runtime {
namespace {

struct Triangles {
  SheetMesh mesh;
  int size = 300;  ///< size of a triangle

  // Slots for triangles, of which about a third are in use.
  Triangles(Random& random, std::uint32_t slots, int triangle_size) : size(triangle_size) {
    mesh.triangles.resize(slots, kFreeSlot);
    mesh.across.resize(slots, {kNoSlot, kNoSlot, kNoSlot});
    mesh.vertices.resize(3 * std::size_t{slots});
    for (std::uint32_t t = slots; t-- > 0;) {
      if (random.between(0, 2) == 0) {
        mesh.triangles[t] = make(random, t);
      } else {
        mesh.free_triangles.push_back(t);
      }
    }
    mesh.reserve_stacks();
  }

  // Each triangle slot has its own vertices, which change with it.
  Triangle make(Random& random, std::uint32_t t) {
    const LatticePoint a = random.point(-10'000, 10'000);
    for (std::uint32_t i = 0; i < 3; ++i) {
      const LatticePoint d = random.point(-size, size);
      mesh.vertices[3 * t + i] = i == 0 ? a : LatticePoint{a.x + d.x, a.y + d.y};
    }
    return {3 * t, 3 * t + 1, 3 * t + 2};
  }
};

// Searches a box at a random place among the triangles that are `wanted`; the number found.
std::size_t expect_same_as_search(
    const TriangleGrid& grid, const SheetMesh& mesh, Random& random,
    const std::function<bool(std::uint32_t)>& wanted = [](std::uint32_t) { return true; }) {
  const LatticePoint p = random.point(-15'000, 15'000);
  const LatticeBox box{p, {p.x + random.between(0, 4000), p.y + random.between(0, 4000)}};
  std::multiset<std::uint32_t> expected, got;
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    if (mesh.in_use(t) && !apart(bounding_box(mesh, t), box) && wanted(t)) expected.insert(t);
  }
  grid.for_each(mesh, box, [&](std::uint32_t t) { got.insert(t); });
  EXPECT_EQ(got, expected);
  return got.size();
}

TEST(TriangleGrid, FindsTheSameAsASearchOfAllTrianglesAfterEdits) {
  Random random(4);
  for (const int size : {300, 10'000, 3}) {
    Triangles some(random, 1200, size);
    TriangleGrid grid(some.mesh);
    SheetEdit edit(some.mesh);
    for (int round = 0; round < 300 && !HasFailure(); ++round) {
      expect_same_as_search(grid, some.mesh, random);
      edit.begin(some.mesh);
      for (int i = random.between(0, 40); i > 0; --i) {
        const auto t = static_cast<std::uint32_t>(random.between(0, 1199));
        if (some.mesh.in_use(t)) {
          if (random.between(0, 3) == 0) {
            edit.touch_triangle(some.mesh, t);  // only its neighbours change
          } else {
            edit.release_triangle(some.mesh, t);
          }
        } else if (const std::uint32_t taken = edit.take_triangle(some.mesh, {0, 1, 2});
                   taken != kNoSlot) {
          some.mesh.triangles[taken] = some.make(random, taken);
        }
      }
      grid.update(edit.change(), some.mesh);
    }
  }
}

// The grid of the boundary follows edits in which triangles come to the boundary or leave it.
TEST(TriangleGrid, TheGridOfTheBoundaryFindsTheTrianglesWithAnOpenEdge) {
  Random random(6);
  Triangles some(random, 1200, 300);
  const auto change_edges = [&](std::uint32_t t) {
    for (std::uint32_t& beyond : some.mesh.across[t])
      beyond = random.between(0, 1) == 0 ? 0 : kNoSlot;
  };
  for (std::uint32_t t = 0; t < 1200; ++t)
    if (some.mesh.in_use(t)) change_edges(t);
  TriangleGrid grid(some.mesh, GridTriangles::kBoundary);
  SheetEdit edit(some.mesh);
  std::size_t found = 0;
  for (int round = 0; round < 300 && !HasFailure(); ++round) {
    found += expect_same_as_search(grid, some.mesh, random, [&](std::uint32_t t) {
      const auto& across = std::as_const(some.mesh).across[t];
      return std::count(across.begin(), across.end(), kNoSlot) > 0;
    });
    edit.begin(some.mesh);
    for (int i = random.between(0, 40); i > 0; --i) {
      const auto t = static_cast<std::uint32_t>(random.between(0, 1199));
      if (!some.mesh.in_use(t)) {
        const std::uint32_t taken = edit.take_triangle(some.mesh, {0, 1, 2});
        if (taken == kNoSlot) continue;
        some.mesh.triangles[taken] = some.make(random, taken);
        change_edges(taken);
      } else if (random.between(0, 1) == 0) {
        edit.release_triangle(some.mesh, t);
      } else {
        edit.touch_triangle(some.mesh, t);
        change_edges(t);
      }
    }
    grid.update(edit.change(), some.mesh);
  }
  EXPECT_GT(found, 1000U);
}

}  // namespace
}  // namespace trocar::runtime
