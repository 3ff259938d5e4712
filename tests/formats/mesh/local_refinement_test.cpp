// SPDX-License-Identifier: Apache-2.0
// The contract of formats/mesh/local_refinement.h. Inserting points into sheets and removing them
// again: the sheet stays valid and constrained Delaunay, and is the same as before.
#include "formats/mesh/local_refinement.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <numbers>
#include <set>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/mesh/mesh_validity.h"
#include "runtime/realtime/realtime_thread.h"
#include "tests/formats/mesh/refinement_checks.h"
#include "tests/support/check_sheet_mesh.h"
#include "tests/support/counted_allocations.h"
#include "tests/support/delaunay_fixture.h"
#include "tests/support/whole_cut.h"

namespace trocar::runtime {
namespace {

constexpr double kStepsPerMm = 256;

TEST(LocalRefinement, ContractHoldsOnRandomSheets) {
  for (int seed = 1; seed <= cases(250) && !testing::Test::HasFailure(); ++seed) {
    Random random(static_cast<std::uint64_t>(seed));
    for (const bool split_outline : {false, true}) {
      SheetMesh mesh = random_sheet(random, 400, 800);
      GradedSize size;
      size.centre = random.point(-1000, 1000);
      size.radius = random.between(0, 500);
      size.at_radius = random.between(5, 300);
      size.growth = random.unit();
      LocalRefinementOptions options;
      options.split_outline = split_outline;
      options.min_angle_deg = random.between(0, 30);
      options.max_new_vertices = 300;
      if (random.between(0, 2) == 0) options.size = size;
      refine_all_and_check(mesh, options, "seed " + std::to_string(seed));
    }
  }
}

TEST(LocalRefinement, WritesOnlyTheNeighbourhoodOfTheSeeds) {
  // The same hole in a small and in a large sheet takes the same work.
  std::array<std::uint32_t, 2> added{};
  std::array<std::size_t, 2> written{};
  for (const std::size_t i : {0U, 1U}) {
    const int cells = i == 0 ? 10 : 60;
    const Result<CutResult> hole = cut(test::square_mesh({-100 * cells, -100 * cells}, 200, cells),
                                       hexagon({20, 31}, 330, 0.1));
    ASSERT_TRUE(hole);
    SheetMesh mesh = *make_sheet_mesh(hole->mesh, 300, 600);
    flip_all(mesh);
    std::vector<std::uint32_t> seeds;
    for (const std::uint32_t t : all_triangles(mesh)) {
      const std::array<LatticePoint, 3> v = corners(mesh, t);
      if (std::all_of(v.begin(), v.end(),
                      [](LatticePoint p) { return std::hypot(p.x, p.y) < 700; }))
        seeds.push_back(t);
    }
    SheetEdit edit(mesh);
    edit.begin(mesh);
    LocalRefinementWorkspace workspace(mesh);
    LocalRefinementOptions options;
    options.split_outline = true;
    options.min_angle_deg = 25;
    added[i] = refine_locally(mesh, edit, seeds, options, workspace).vertices_added;
    written[i] = edit.triangles().size();
    ASSERT_TRUE(check_sheet_mesh(mesh));
  }
  EXPECT_GT(added[0], 3U);
  EXPECT_EQ(added[0], added[1]);
  EXPECT_EQ(written[0], written[1]);
}

// ---- a graded region around a hole ----

// ---- stress cases ----

TEST(LocalRefinement, EndsOnFansOfNeedles) {
  // Seven needles around one point.
  for (const double needle_deg : {2.0, 5.0, 12.0, 25.0}) {
    for (const bool split_outline : {false, true}) {
      SliceMesh mesh{{{0, 0}}, {}};
      for (int i = 0; i < 7; ++i) {
        const double from = i * 50 * std::numbers::pi / 180,
                     to = from + needle_deg * std::numbers::pi / 180;
        const auto v = static_cast<std::uint32_t>(mesh.vertices.size());
        // Each has its own vertex at the common point: a pinch.
        mesh.vertices.push_back({0, 0});
        for (const double angle : {from, to})
          mesh.vertices.push_back({static_cast<int>(std::lround(3000 * std::cos(angle))),
                                   static_cast<int>(std::lround(3000 * std::sin(angle)))});
        mesh.triangles.push_back({v, v + 1, v + 2});
      }
      mesh.vertices.erase(mesh.vertices.begin());
      for (Triangle& t : mesh.triangles) {
        for (std::uint32_t& c : t)
          --c;
      }
      SheetMesh sheet = *make_sheet_mesh(mesh, 2000, 4000);
      LocalRefinementOptions options;
      options.split_outline = split_outline;
      options.max_new_vertices = 2000;
      const std::string where =
          std::to_string(needle_deg) + " degrees, " + (split_outline ? "split" : "whole");
      refine_all_and_check(sheet, options, where);
      EXPECT_LT(sheet.vertices_in_use(), 1500U) << where << ": did not end by itself";
    }
  }
}

TEST(LocalRefinement, AcuteCornersTakeFewPoints) {
  // Two long edges of different lengths meet; their pieces must not keep encroaching upon each
  // other.
  for (const double corner_deg : {22.0, 30.0, 40.0, 50.0, 58.0, 65.0}) {
    for (const double ratio : {0.55, 0.7, 0.9}) {
      const double angle = corner_deg * std::numbers::pi / 180, leg = 40'000;
      const SliceMesh mesh{{{0, 0},
                            {static_cast<int>(leg), 0},
                            {static_cast<int>(std::lround(ratio * leg * std::cos(angle))),
                             static_cast<int>(std::lround(ratio * leg * std::sin(angle)))}},
                           {{0, 1, 2}}};
      SheetMesh sheet = *make_sheet_mesh(mesh, 500, 1000);
      LocalRefinementOptions options;
      options.split_outline = true;
      const std::string where = std::to_string(corner_deg) + " degrees, " + std::to_string(ratio);
      refine_all_and_check(sheet, options, where);
      EXPECT_EQ(counts(sheet, 20).obtuse, 0U) << where;
      EXPECT_EQ(counts(sheet, 20).sharp, 0U) << where;
      EXPECT_LE(sheet.vertices_in_use(), 12U) << where;
    }
  }
}

TEST(LocalRefinement, KeptEdgesStay) {
  for (int seed = 1; seed <= cases(60); ++seed) {
    Random random(static_cast<std::uint64_t>(seed));
    SheetMesh mesh = random_sheet(random, 400, 800);
    // About every third boundary edge of the start.
    std::set<std::array<std::uint32_t, 2>> kept;
    for (const std::uint32_t t : all_triangles(mesh)) {
      for (std::uint32_t i = 0; i < 3; ++i) {
        if (mesh.across[t][i] == kNoSlot && random.between(0, 2) == 0)
          kept.insert({mesh.triangles[t][i], mesh.triangles[t][(i + 1) % 3]});
      }
    }
    const auto keep = [&kept](std::uint32_t from, std::uint32_t to) {
      return kept.contains({from, to});
    };
    GradedSize size;
    size.at_radius = 60;
    LocalRefinementOptions options;
    options.split_outline = true;
    options.min_angle_deg = 25;
    options.size = size;
    options.keep_edge = keep;
    const LocalRefinementResult result =
        refine_and_check(mesh, all_triangles(mesh), options, "seed " + std::to_string(seed));
    std::size_t there = 0, obtuse = 0;
    for (const std::uint32_t t : all_triangles(mesh)) {
      for (std::uint32_t i = 0; i < 3; ++i) {
        const std::uint32_t from = mesh.triangles[t][i], to = mesh.triangles[t][(i + 1) % 3];
        if (mesh.across[t][i] != kNoSlot) continue;
        const LatticePoint apex = mesh.vertices[mesh.triangles[t][(i + 2) % 3]];
        const bool is_kept = kept.contains({from, to});
        there += is_kept ? 1 : 0;
        obtuse +=
            !is_kept && diametral_dot(mesh.vertices[from], mesh.vertices[to], apex) < 0 ? 1 : 0;
      }
    }
    EXPECT_EQ(there, kept.size()) << "seed " << seed;
    EXPECT_EQ(obtuse, result.obtuse_edges) << "seed " << seed;
  }
}

TEST(LocalRefinement, ContractHoldsOnTinyAndExtremeTriangles) {
  const std::vector<std::vector<LatticePoint>> shapes{
      {{0, 0}, {1, 0}, {0, 1}},
      {{0, 0}, {2, 0}, {0, 2}},
      {{0, 0}, {1000, 1}, {0, 2}},
      {{0, 0}, {1000, 0}, {999, 1}},
      {{0, 0}, {64, 0}, {32, 1}},
      {{0, 0}, {4000, 0}, {2000, 30}},
      {{0, 0}, {3, 1}, {1, 3}},
      {{0, 0}, {16, 0}, {8, 7}},
      {{0, 0}, {4001, 3}, {17, 2900}},
      {{-(1 << 29), -(1 << 29)}, {1 << 29, -(1 << 29)}, {0, 1 << 29}},
  };
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    for (const bool split_outline : {false, true}) {
      for (const double at_radius : {1.0, 3.0, std::numeric_limits<double>::infinity()}) {
        SheetMesh sheet = *make_sheet_mesh({shapes[i], {{0, 1, 2}}}, 200, 400);
        GradedSize size;
        size.at_radius = at_radius;
        LocalRefinementOptions options;
        options.split_outline = split_outline;
        options.max_new_vertices = 150;
        options.size = size;
        refine_all_and_check(sheet, options, "shape " + std::to_string(i));
      }
    }
  }
}

TEST(LocalRefinement, WithoutBudgetOrCapacityNothingChanges) {
  Random random(17);
  int stopped = 0;
  for (int round = 0; round < 30; ++round) {
    SheetMesh mesh = random_sheet(random, 0, 0);
    const SheetMesh before = mesh;
    LocalRefinementOptions options;
    options.min_angle_deg = 30;
    options.split_outline = true;
    options.max_new_vertices = 0;
    LocalRefinementResult result =
        refine_and_check(mesh, all_triangles(mesh), options, "no budget");
    EXPECT_TRUE(same(mesh, before));
    EXPECT_TRUE(result.outcome == LocalRefinementOutcome::kBudget ||
                result.outcome == LocalRefinementOutcome::kDone);

    // Every small number of free slots.
    for (std::size_t spare = 0; spare < 12; ++spare) {
      SheetMesh small = *make_sheet_mesh(to_slice_mesh(before), spare / 2, spare);
      options.max_new_vertices = 100;
      result = refine_and_check(small, all_triangles(small), options, "few free slots");
      stopped += result.outcome == LocalRefinementOutcome::kCapacity ? 1 : 0;
    }

    SheetEdit edit(mesh);
    edit.begin(mesh);
    const std::size_t vertices = mesh.vertices.size(), triangles = mesh.triangles.size();
    for (const auto& [v, t] : {std::array{vertices - 1, triangles}, {vertices, triangles - 1}}) {
      LocalRefinementWorkspace too_small(v, t);
      result = refine_locally(mesh, edit, all_triangles(mesh), options, too_small);
      EXPECT_EQ(result.outcome, LocalRefinementOutcome::kCapacity);
      EXPECT_TRUE(same(mesh, before));
    }
  }
  EXPECT_GT(stopped, 100);
}

TEST(LocalRefinement, ContractHoldsForInvalidSeedsAndOptions) {
  Random random(23);
  for (int round = 0; round < 20; ++round) {
    SheetMesh mesh = random_sheet(random, 300, 600);
    std::vector<std::uint32_t> seeds = all_triangles(mesh);
    seeds.insert(seeds.end(), seeds.begin(), seeds.end());  // twice
    seeds.push_back(kNoSlot);
    seeds.push_back(static_cast<std::uint32_t>(mesh.triangles.size()));
    seeds.push_back(mesh.free_triangles.front());
    for (const double value : {-1.0, 0.0, 1e300, std::numeric_limits<double>::quiet_NaN()}) {
      const auto size = [value](double, double) { return value; };
      LocalRefinementOptions options;
      options.split_outline = round % 2 == 0;
      options.max_new_vertices = 60;
      options.size = size;
      SheetMesh copy = mesh;
      refine_and_check(copy, seeds, options, "size " + std::to_string(value));
      options.size = {};
      options.min_angle_deg = value;
      copy = mesh;
      refine_and_check(copy, seeds, options, "angle " + std::to_string(value));
    }
  }
  SheetMesh empty = *make_sheet_mesh({}, 4, 4);
  EXPECT_EQ(refine_and_check(empty, {}, {}, "empty").outcome, LocalRefinementOutcome::kDone);
}

TEST(LocalRefinement, ASheetThatIsNotDelaunayStaysValid) {
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    Random random(seed);
    SliceMesh mesh = test::square_mesh({0, 0}, 300, 5);
    for (LatticePoint& p : mesh.vertices) {
      const bool is_inner = p.x > 0 && p.y > 0 && p.x < 1500 && p.y < 1500;
      if (is_inner) p = {p.x + random.between(-70, 70), p.y + random.between(-70, 70)};
    }
    ASSERT_TRUE(check_mesh(mesh));
    SheetMesh sheet = *make_sheet_mesh(mesh, 500, 1000);
    GradedSize size;
    size.at_radius = 60;
    size.growth = 0.2;
    LocalRefinementOptions options;
    options.size = size;
    options.min_angle_deg = 30;
    options.split_outline = seed % 2 == 0;
    refine_and_check(sheet, all_triangles(sheet), options, "seed " + std::to_string(seed));
  }
}

TEST(LocalRefinement, DoesNotAllocate) {
  TROCAR_NEEDS_COUNTED_ALLOCATIONS();
  Random random(29);
  std::uint32_t added = 0;
  for (int round = 0; round < 30; ++round) {
    SheetMesh mesh = random_sheet(random, 300, 600);
    const std::vector<std::uint32_t> seeds = all_triangles(mesh);
    SheetEdit edit(mesh);
    edit.begin(mesh);
    LocalRefinementWorkspace workspace(mesh);
    LocalRefinementOptions options;
    options.split_outline = round % 2 == 0;
    EXPECT_EQ(allocations_of([&] {
                added += refine_locally(mesh, edit, seeds, options, workspace).vertices_added;
              }),
              0U);
  }
  EXPECT_GT(added, 300U);
}

// ---- after cuts in real slices ----

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
