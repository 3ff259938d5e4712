// SPDX-License-Identifier: Apache-2.0
// The invariants of formats/mesh/sheet_mesh.h, that the check detects each violation, and the
// contract of edits on random slots.
#include "formats/mesh/sheet_mesh.h"

#include <gtest/gtest.h>

#include "formats/mesh/mesh_validity.h"
#include "tests/support/check_sheet_mesh.h"
#include "tests/support/random_geometry.h"
#include "tests/support/same_sheet_mesh.h"
#include "tests/support/sheet_fixture.h"

namespace trocar::runtime {
namespace {

// A 3 x 3 square grid of vertices, eight triangles.
SliceMesh grid() {
  SliceMesh mesh;
  for (std::int32_t y = 0; y < 3; ++y) {
    for (std::int32_t x = 0; x < 3; ++x)
      mesh.vertices.push_back({100 * x, 100 * y});
  }
  for (std::uint32_t y = 0; y < 2; ++y) {
    for (std::uint32_t x = 0; x < 2; ++x) {
      const std::uint32_t a = 3 * y + x;
      mesh.triangles.push_back({a, a + 1, a + 4});
      mesh.triangles.push_back({a, a + 4, a + 3});
    }
  }
  return mesh;
}

SheetMesh made() {
  Result<SheetMesh> mesh = make_sheet_mesh(grid(), 5, 7);
  EXPECT_TRUE(mesh);
  return *mesh;
}

TEST(SheetMesh, ConvertsToASliceMeshAndBackUnchanged) {
  const SheetMesh mesh = made();
  EXPECT_TRUE(check_sheet_mesh(mesh));
  EXPECT_EQ(mesh.triangles_in_use(), 8U);
  EXPECT_EQ(mesh.vertices_in_use(), 9U);
  EXPECT_EQ(mesh.free_triangles.size(), 7U);
  EXPECT_EQ(mesh.free_triangles.back(), 8U);
  EXPECT_EQ(mesh.free_vertices.back(), 9U);
  const SliceMesh back = to_slice_mesh(mesh);
  EXPECT_EQ(back.vertices, grid().vertices);
  EXPECT_EQ(back.triangles, grid().triangles);
}

TEST(SheetMesh, RefusesInvalidMeshes) {
  SliceMesh out_of_range = grid();
  out_of_range.triangles[3][1] = 9;
  EXPECT_FALSE(make_sheet_mesh(out_of_range, 0, 0));
  SliceMesh twice = grid();
  twice.triangles.push_back(twice.triangles[0]);
  EXPECT_FALSE(make_sheet_mesh(twice, 0, 0));
}

TEST(SheetMesh, TheCheckDetectsViolatedInvariants) {
  SheetMesh mesh = made();
  mesh.free_triangles.back() = 0;
  EXPECT_FALSE(check_sheet_mesh(mesh)) << "a free triangle in use";
  mesh = made();
  mesh.across[0][2] = kNoSlot;
  EXPECT_FALSE(check_sheet_mesh(mesh)) << "a neighbour without the link back";
}

using trocar::test::same;

// Everything that an edit can do to slots; the result is not a valid mesh.
void scramble(Random& random, SheetMesh& mesh, SheetEdit& edit) {
  const auto below = [&random](std::size_t n) {
    return static_cast<std::uint32_t>(random.between(0, static_cast<int>(n) - 1));
  };
  for (int i = random.between(0, 60); i > 0; --i) {
    switch (random.between(0, 4)) {
      case 0:
        edit.take_triangle(mesh, {0, 1, 2});
        break;
      case 1:
        edit.take_vertex(mesh, random.point(-9, 9));
        break;
      case 2:
        if (const std::uint32_t t = below(mesh.triangles.size()); mesh.in_use(t))
          edit.release_triangle(mesh, t);
        break;
      case 3:
        if (const std::uint32_t v = below(mesh.vertices.size());
            std::find(mesh.free_vertices.begin(), mesh.free_vertices.end(), v) ==
            mesh.free_vertices.end())
          edit.release_vertex(mesh, v);
        break;
      default:
        const std::uint32_t t = below(mesh.triangles.size());
        edit.touch_triangle(mesh, t);
        if (mesh.in_use(t)) mesh.across[t][1] = below(99);
    }
  }
}

TEST(SheetEdit, UndoRestoresTheMeshAndCopyToMakesTheReplicaEqual) {
  Random random(11);
  SheetMesh mesh = *make_sheet_mesh(test::square_mesh({0, 0}, 10, 4), 9, 13);
  SheetMesh replica = mesh;
  SheetEdit edit(mesh);
  std::size_t written = 0;
  for (int round = 0; round < 3000; ++round) {
    const SheetMesh before = mesh;
    ASSERT_TRUE(same(before, replica));
    edit.begin(mesh);
    scramble(random, mesh, edit);
    written += edit.triangles().size() + edit.vertices().size();
    if (random.between(0, 1) == 0) {
      edit.undo(mesh);
      ASSERT_TRUE(same(mesh, before)) << "round " << round;
      ASSERT_TRUE(edit.triangles().empty());
      edit.begin(mesh);
      scramble(random, mesh, edit);
    }
    edit.change().copy_to(mesh, replica);
    ASSERT_TRUE(same(mesh, replica)) << "round " << round;
    // Slots that are not listed are unchanged.
    std::set<std::uint32_t> listed;
    for (const SheetEdit::OldTriangle& old : edit.triangles()) {
      ASSERT_TRUE(listed.insert(old.slot).second) << "listed twice";
      ASSERT_EQ(old.corners, before.triangles[old.slot]);
    }
    for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
      ASSERT_TRUE(listed.contains(t) || mesh.triangles[t] == before.triangles[t]);
    }
  }
  EXPECT_GT(written, 10'000U);
}

TEST(SheetEdit, GivesNoneWhenNoSlotIsFree) {
  SheetMesh mesh = *make_sheet_mesh(test::square_mesh({0, 0}, 10, 1), 1, 0);
  SheetEdit edit(mesh);
  edit.begin(mesh);
  EXPECT_EQ(edit.take_triangle(mesh, {0, 1, 2}), kNoSlot);
  EXPECT_EQ(edit.take_vertex(mesh, {3, 3}), 4U);
  EXPECT_EQ(edit.take_vertex(mesh, {3, 3}), kNoSlot);
  edit.undo(mesh);
  EXPECT_EQ(mesh.free_vertices, std::vector<std::uint32_t>{4});
}

TEST(SheetEdit, ACopyOfAMeshHasCapacityForEveryFreeSlot) {
  const SheetMesh mesh = *make_sheet_mesh(test::square_mesh({0, 0}, 10, 3), 2, 2);
  const SheetMesh copy = mesh;  // NOLINT(performance-unnecessary-copy-initialization)
  EXPECT_GE(copy.free_triangles.capacity(), mesh.triangles.size());
  EXPECT_GE(copy.free_vertices.capacity(), mesh.vertices.size());
}

}  // namespace
}  // namespace trocar::runtime
