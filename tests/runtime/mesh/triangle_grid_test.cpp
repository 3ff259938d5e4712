// SPDX-License-Identifier: Apache-2.0
// The laws of runtime/mesh/triangle_grid.h against a look at every triangle, on heaps of
// triangles; the grid asks for no more.
#include "runtime/mesh/triangle_grid.h"

#include <gtest/gtest.h>

#include "tests/support/random_geometry.h"

namespace trocar::runtime {
namespace {

struct Heap {
  SheetMesh mesh;
  int size = 300;  ///< of a triangle

  // Room for `slots` triangles, of which about a third are there.
  Heap(Random& random, std::uint32_t slots, int triangle_size) : size(triangle_size) {
    mesh.triangles.resize(slots, kFreeSlot);
    mesh.across.resize(slots, {kNone, kNone, kNone});
    mesh.vertices.resize(3 * std::size_t{slots});
    for (std::uint32_t t = slots; t-- > 0;) {
      if (random.between(0, 2) == 0) {
        mesh.triangles[t] = some(random, t);
      } else {
        mesh.free_triangles.push_back(t);
      }
    }
    mesh.reserve_stacks();
  }

  // Slot t has vertices of its own, so that they may change with it.
  Triangle some(Random& random, std::uint32_t t) {
    const LatticePoint a = random.point(-10'000, 10'000);
    for (std::uint32_t i = 0; i < 3; ++i) {
      const LatticePoint d = random.point(-size, size);
      mesh.vertices[3 * t + i] = i == 0 ? a : LatticePoint{a.x + d.x, a.y + d.y};
    }
    return {3 * t, 3 * t + 1, 3 * t + 2};
  }
};

void expect_what_a_scan_finds(const TriangleGrid& grid, const SheetMesh& mesh, Random& random) {
  const LatticePoint p = random.point(-15'000, 15'000);
  const LatticeBox box{p, {p.x + random.between(0, 4000), p.y + random.between(0, 4000)}};
  std::multiset<std::uint32_t> expected, got;
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    if (mesh.in_use(t) && !apart(bounding_box(mesh, t), box)) expected.insert(t);
  }
  grid.for_each(box, [&](std::uint32_t t) { got.insert(t); });
  ASSERT_EQ(got, expected);
}

TEST(TriangleGrid, FindsWhatAScanFindsWhileTrianglesComeAndGo) {
  Random random(4);
  for (const int size : {300, 10'000, 3}) {
    Heap heap(random, 1200, size);
    TriangleGrid grid(heap.mesh);
    SheetEdit edit(heap.mesh);
    for (int round = 0; round < 300; ++round) {
      expect_what_a_scan_finds(grid, heap.mesh, random);
      edit.begin(heap.mesh);
      for (int i = random.between(0, 40); i > 0; --i) {
        const auto t = static_cast<std::uint32_t>(random.between(0, 1199));
        if (heap.mesh.in_use(t)) {
          if (random.between(0, 3) == 0) {
            edit.touch_triangle(heap.mesh, t);  // its neighbours alone change
          } else {
            edit.release_triangle(heap.mesh, t);
          }
        } else if (const std::uint32_t taken = edit.take_triangle(heap.mesh, {0, 1, 2});
                   taken != kNone) {
          heap.mesh.triangles[taken] = heap.some(random, taken);
        }
      }
      grid.update(edit, heap.mesh);
    }
  }
}

TEST(TriangleGrid, GivesTheSameOrderWhereTheSameEditsWereMade) {
  Random random(5);
  Heap heap(random, 500, 1000);
  TriangleGrid one(heap.mesh), other(heap.mesh);
  SheetMesh replica = heap.mesh;
  SheetEdit edit(heap.mesh);
  for (int round = 0; round < 100; ++round) {
    edit.begin(heap.mesh);
    for (int i = 0; i < 20; ++i) {
      const auto t = static_cast<std::uint32_t>(random.between(0, 499));
      if (heap.mesh.in_use(t)) {
        edit.release_triangle(heap.mesh, t);
      } else if (const std::uint32_t taken = edit.take_triangle(heap.mesh, {0, 1, 2});
                 taken != kNone) {
        for (std::uint32_t v = 3 * taken; v < 3 * taken + 3; ++v)
          edit.touch_vertex(heap.mesh, v);
        heap.mesh.triangles[taken] = heap.some(random, taken);
      }
    }
    one.update(edit, heap.mesh);
    edit.copy_to(heap.mesh, replica);
    other.update(edit, replica);
    std::vector<std::uint32_t> first, second;
    const LatticeBox all{{-30'000, -30'000}, {30'000, 30'000}};
    one.for_each(all, [&](std::uint32_t t) { first.push_back(t); });
    other.for_each(all, [&](std::uint32_t t) { second.push_back(t); });
    ASSERT_EQ(first, second);
  }
}

TEST(TriangleGrid, EmptyFindsNothing) {
  TriangleGrid().for_each({}, [](std::uint32_t) { FAIL(); });
  TriangleGrid(SheetMesh{}).for_each({}, [](std::uint32_t) { FAIL(); });
}

}  // namespace
}  // namespace trocar::runtime
