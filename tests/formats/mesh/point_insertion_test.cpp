// SPDX-License-Identifier: Apache-2.0
// Inserting points into sheets and removing them again: the sheet stays valid and constrained
// Delaunay, and is the same as before.
#include "formats/mesh/local_refinement.h"

#include <gtest/gtest.h>

#include <array>
#include <vector>

#include "formats/mesh/mesh_validity.h"
#include "tests/support/check_sheet_mesh.h"
#include "tests/support/delaunay_fixture.h"

namespace trocar::runtime {
namespace {

// Four points on a circle have several Delaunay triangulations.
bool is_unique(const SheetMesh& mesh) {
  for (const std::uint32_t t : all_triangles(mesh)) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      const std::uint32_t u = mesh.across[t][i];
      if (u == kNoSlot) continue;
      const auto [a, b, c] = corners(mesh, t);
      for (const LatticePoint d : corners(mesh, u)) {
        if (d != a && d != b && d != c && in_circle(a, b, c, d) == 0) return false;
      }
    }
  }
  return true;
}

LatticePoint inside(Random& random, const SheetMesh& mesh, std::uint32_t t) {
  const auto [a, b, c] = corners(mesh, t);
  const double u = random.unit(), v = random.unit() * (1 - u);
  return {static_cast<std::int32_t>(std::lround(a.x + u * (b.x - a.x) + v * (c.x - a.x))),
          static_cast<std::int32_t>(std::lround(a.y + u * (b.y - a.y) + v * (c.y - a.y)))};
}

bool is_inside(const SheetMesh& mesh, std::uint32_t t, LatticePoint p) {
  const auto [a, b, c] = corners(mesh, t);
  return orient2d(a, b, p) > 0 && orient2d(b, c, p) > 0 && orient2d(c, a, p) > 0;
}

TEST(PointInsertion, InsertionAndRemovalRestoreTheSheet) {
  int inserted = 0, compared = 0;
  for (int seed = 1; seed <= cases(300); ++seed) {
    Random random(static_cast<std::uint64_t>(seed));
    SheetMesh mesh = random_sheet(random, 40, 80);
    SheetEdit edit(mesh);
    PointInsertion insertion(mesh.vertices.size(), mesh.triangles.size());
    VertexRemoval removal;
    for (int round = 0; round < 10; ++round) {
      const std::vector<std::uint32_t> slots = all_triangles(mesh);
      const std::uint32_t t = random.pick(slots);
      const LatticePoint p = inside(random, mesh, t);
      if (!is_inside(mesh, t, p)) continue;
      const std::vector<Points> before = points_of(mesh);
      const bool was_unique = is_unique(mesh);
      const std::int64_t area = doubled_area(to_slice_mesh(mesh));

      edit.begin(mesh);
      ASSERT_TRUE(insertion.find(mesh, t, p));
      ASSERT_EQ(insertion.insert(mesh, edit, p, kNoSlot), InsertionOutcome::kDone)
          << "seed " << seed;
      ++inserted;
      ASSERT_TRUE(check_sheet_mesh(mesh)) << "seed " << seed;
      ASSERT_TRUE(is_constrained_delaunay(to_slice_mesh(mesh))) << "seed " << seed;
      ASSERT_EQ(doubled_area(to_slice_mesh(mesh)), area);
      ASSERT_EQ(mesh.vertices[insertion.vertex()], p);
      for (const std::uint32_t s : insertion.star())
        ASSERT_EQ(mesh.triangles[s][2], insertion.vertex());

      if (random.between(0, 1) == 0) continue;
      if (!removal.plan(mesh, insertion.star()[0], 2)) continue;
      removal.remove(mesh, edit);
      ASSERT_TRUE(check_sheet_mesh(mesh)) << "seed " << seed;
      ASSERT_TRUE(is_constrained_delaunay(to_slice_mesh(mesh))) << "seed " << seed;
      if (!was_unique) continue;
      ASSERT_EQ(points_of(mesh), before) << "seed " << seed;
      ++compared;
    }
  }
  EXPECT_GT(inserted, cases(300) / 2);
  EXPECT_GT(compared, cases(300) / 10);
}

TEST(PointInsertion, WithoutFreeSlotsNothingChanges) {
  Random random(5);
  for (const auto& [vertices, triangles] : {std::array<std::size_t, 2>{0, 9}, {9, 1}}) {
    SheetMesh mesh = *make_sheet_mesh(test::square_mesh({0, 0}, 100, 2), vertices, triangles);
    flip_all(mesh);
    const SheetMesh before = mesh;
    SheetEdit edit(mesh);
    edit.begin(mesh);
    PointInsertion insertion(mesh.vertices.size(), mesh.triangles.size());
    ASSERT_TRUE(insertion.find(mesh, 0, {60, 20}));
    EXPECT_EQ(insertion.insert(mesh, edit, {60, 20}, kNoSlot), InsertionOutcome::kCapacity);
    EXPECT_TRUE(same(mesh, before));
  }
}

TEST(PointInsertion, PointsOnOrBeyondTheOutlineAreNotVisible) {
  SheetMesh mesh = *make_sheet_mesh({{{0, 0}, {100, 0}, {50, 30}}, {{0, 1, 2}}}, 3, 3);
  const SheetMesh before = mesh;
  SheetEdit edit(mesh);
  edit.begin(mesh);
  PointInsertion insertion(mesh.vertices.size(), mesh.triangles.size());
  EXPECT_FALSE(insertion.find(mesh, 0, {50, 40})) << "not in the circumcircle";
  ASSERT_TRUE(insertion.find(mesh, 0, {50, -10}));
  EXPECT_EQ(insertion.insert(mesh, edit, {50, -10}, kNoSlot), InsertionOutcome::kNotVisible);
  ASSERT_TRUE(insertion.find(mesh, 0, {50, 0}));
  EXPECT_EQ(insertion.insert(mesh, edit, {50, 0}, kNoSlot), InsertionOutcome::kNotVisible);
  EXPECT_TRUE(same(mesh, before));
  // But the edge can be split there.
  ASSERT_EQ(insertion.boundary()[0].from, 0U);
  EXPECT_EQ(insertion.insert(mesh, edit, {50, 0}, 0), InsertionOutcome::kDone);
  EXPECT_TRUE(check_sheet_mesh(mesh));
  EXPECT_EQ(mesh.triangles_in_use(), 2U);
}

TEST(VertexRemoval, RefusesVerticesOnTheOutline) {
  SheetMesh mesh = *make_sheet_mesh(test::square_mesh({0, 0}, 100, 2), 0, 0);
  VertexRemoval removal;
  int inner = 0;
  for (const std::uint32_t t : all_triangles(mesh)) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      const bool is_inner = mesh.vertices[mesh.triangles[t][i]] == LatticePoint{100, 100};
      EXPECT_EQ(removal.plan(mesh, t, i), is_inner);
      inner += is_inner ? 1 : 0;
    }
  }
  EXPECT_GT(inner, 0);
}

TEST(TriangleQueue, GivesTheLeastKeyAfterAnyChange) {
  Random random(9);
  constexpr int kSlots = 60;
  TriangleQueue queue(kSlots);
  std::vector<std::int64_t> keys(kSlots, -1);  // -1: not in the queue
  for (int round = 0; round < 20'000; ++round) {
    const auto slot = static_cast<std::size_t>(random.between(0, kSlots - 1));
    if (random.between(0, 2) == 0) {
      queue.remove(static_cast<std::uint32_t>(slot));
      keys[slot] = -1;
    } else {
      keys[slot] = random.between(0, 40);
      queue.put(static_cast<std::uint32_t>(slot), keys[slot]);
    }
    if (round % 1000 == 999) {
      queue.clear();
      std::fill(keys.begin(), keys.end(), -1);
    }
    std::size_t least = kSlots;
    for (std::size_t s = 0; s < kSlots; ++s) {
      if (keys[s] >= 0 && (least == kSlots || keys[s] < keys[least])) least = s;
    }
    ASSERT_EQ(queue.empty(), least == kSlots);
    if (queue.empty()) continue;
    ASSERT_EQ(queue.top(), least);
    ASSERT_EQ(queue.top_key(), keys[least]);
  }
}

}  // namespace
}  // namespace trocar::runtime
