// SPDX-License-Identifier: Apache-2.0
// The invariants of formats/mesh/sheet_mesh.h, and that the check detects each violation.
#include "formats/mesh/sheet_mesh.h"

#include <gtest/gtest.h>

#include "formats/mesh/mesh_validity.h"
#include "tests/support/check_sheet_mesh.h"

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

TEST(SheetMesh, EmptyIsValid) {
  const Result<SheetMesh> mesh = make_sheet_mesh({}, 0, 0);
  ASSERT_TRUE(mesh);
  EXPECT_TRUE(check_sheet_mesh(*mesh));
}

TEST(SheetMesh, RefusesInvalidMeshes) {
  SliceMesh out_of_range = grid();
  out_of_range.triangles[3][1] = 9;
  EXPECT_FALSE(make_sheet_mesh(out_of_range, 0, 0));
  SliceMesh twice = grid();
  twice.triangles.push_back(twice.triangles[0]);
  EXPECT_FALSE(make_sheet_mesh(twice, 0, 0));
}

TEST(SheetMesh, TheCheckDetectsEachViolatedInvariant) {
  SheetMesh mesh = made();
  std::swap(mesh.triangles[0][0], mesh.triangles[0][1]);
  EXPECT_FALSE(check_sheet_mesh(mesh)) << "orientation";
  mesh = made();
  mesh.free_triangles.back() = 0;
  EXPECT_FALSE(check_sheet_mesh(mesh)) << "a free triangle in use";
  mesh = made();
  mesh.free_vertices.pop_back();
  EXPECT_FALSE(check_sheet_mesh(mesh)) << "a lost vertex";
  mesh = made();
  mesh.free_vertices.push_back(4);
  EXPECT_FALSE(check_sheet_mesh(mesh)) << "a free vertex in use";
  mesh = made();
  mesh.across[0][2] = kNoSlot;
  EXPECT_FALSE(check_sheet_mesh(mesh)) << "a neighbour without the link back";
  mesh.across[1][0] = kNoSlot;
  EXPECT_FALSE(check_sheet_mesh(mesh)) << "two neighbours without links";
}

}  // namespace
}  // namespace trocar::runtime
