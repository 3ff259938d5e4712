// SPDX-License-Identifier: Apache-2.0
// Every outcome of a cut in place and the sheet afterwards, with every capacity from zero to
// sufficient; and that no outcome allocates.
#include <gtest/gtest.h>

#include "formats/mesh/cut.h"
#include "runtime/realtime/realtime_thread.h"
#include "runtime/session/remesher.h"
#include "tests/support/check_sheet_mesh.h"
#include "tests/support/counted_allocations.h"
#include "tests/support/random_geometry.h"
#include "tests/support/remesher_reader.h"
#include "tests/support/same_sheet_mesh.h"
#include "tests/support/sheet_fixture.h"
#include "tests/support/whole_cut.h"

namespace trocar::runtime {
namespace {

using test::current;

using trocar::test::same;

// A square of 20 x 20 cells of 100 steps, with a hole in it already.
SheetMesh sheet(std::size_t spare_vertices, std::size_t spare_triangles) {
  const SliceMesh square = test::square_mesh({0, 0}, 100, 20);
  const Result<CutResult> holed = cut(square, {{1000, 1000}, {1400, 1010}, {1210, 1390}});
  EXPECT_TRUE(holed);
  return *make_sheet_mesh(holed->mesh, spare_vertices, spare_triangles);
}

const Ring kInside = {{310, 290}, {520, 300}, {610, 480}, {500, 650}, {290, 640}, {205, 470}};
// Over the hole and the sheet's boundary.
const Ring kAcross = {{900, 950},   {1150, 880},  {2100, 1010},
                      {2050, 1290}, {1300, 1150}, {950, 1230}};

class Outcomes : public testing::Test {
 protected:
  CutReport cut_with(const CutCapacity& capacity, const SheetMesh& start, const Ring& tool) {
    mesh_ = start;
    const TriangleGrid grid(mesh_);
    edit_ = SheetEdit(mesh_);
    CutWorkspace work(capacity);
    return cut_in_place(mesh_, grid, tool, work, edit_);
  }
  SheetMesh mesh_;
  SheetEdit edit_;
};

TEST_F(Outcomes, TooSmallACapacityIsReportedAndLeavesTheSheetUnchanged) {
  const SheetMesh start = sheet(60, 120);
  for (const Ring& tool : {kInside, kAcross}) {
    const CutCapacity enough = capacity_for(start.vertices.size(), start.triangles.size());
    ASSERT_EQ(cut_with(enough, start, tool).outcome, CutOutcome::kCut);
    const SheetMesh cut_through = mesh_;
    ASSERT_TRUE(check_sheet_mesh(cut_through));
    for (std::size_t CutCapacity::*what :
         {&CutCapacity::triangles, &CutCapacity::points, &CutCapacity::edges}) {
      int too_little = 0;
      for (std::size_t size = 0; size < 200; ++size) {
        CutCapacity capacity = enough;
        capacity.*what = size;
        const CutReport report = cut_with(capacity, start, tool);
        if (report.outcome == CutOutcome::kCapacity) {
          ++too_little;
          ASSERT_TRUE(same(mesh_, start)) << size;
          ASSERT_TRUE(edit_.triangles().empty() && edit_.vertices().empty());
        } else {
          ASSERT_EQ(report.outcome, CutOutcome::kCut) << size;
          ASSERT_TRUE(same(mesh_, cut_through)) << size;
        }
      }
      EXPECT_GT(too_little, 10);
      EXPECT_LT(too_little, 190);
    }
  }
}

TEST_F(Outcomes, TooFewFreeSlotsAreReportedAndLeaveTheSheetUnchanged) {
  for (const Ring& tool : {kInside, kAcross}) {
    int too_few = 0;
    for (std::size_t spare = 0; spare < 40; ++spare) {
      for (const bool of_vertices : {false, true}) {
        const SheetMesh start = sheet(of_vertices ? spare : 60, of_vertices ? 120 : spare);
        const CutReport report =
            cut_with(capacity_for(start.vertices.size(), start.triangles.size()), start, tool);
        if (report.outcome == CutOutcome::kCapacity) {
          ++too_few;
          ASSERT_TRUE(same(mesh_, start)) << spare;
        } else {
          ASSERT_EQ(report.outcome, CutOutcome::kCut);
          ASSERT_TRUE(check_sheet_mesh(mesh_)) << spare;
        }
      }
    }
    EXPECT_TRUE(tool != kInside || too_few == 0) << "more triangles are removed than created";
  }
  // A small hole in a single triangle: six vertices and eight triangles more.
  const SliceMesh one{{{0, 0}, {1000, 0}, {0, 1000}}, {{0, 1, 2}}};
  const Ring small = {{310, 290}, {320, 300}, {320, 310}, {310, 320}, {300, 310}, {300, 300}};
  for (std::size_t vertices = 0; vertices < 9; ++vertices) {
    for (std::size_t triangles = 0; triangles < 12; ++triangles) {
      const SheetMesh start = *make_sheet_mesh(one, vertices, triangles);
      const CutReport report = cut_with({100, 100, 100}, start, small);
      const bool fits = vertices >= 6 && triangles >= 8;
      ASSERT_EQ(report.outcome, fits ? CutOutcome::kCut : CutOutcome::kCapacity);
      ASSERT_EQ(same(mesh_, start), !fits);
    }
  }
}

// --- allocations ---

TEST(CutAllocations, NoOutcomeAllocates) {
  TROCAR_NEEDS_COUNTED_ALLOCATIONS();
  SheetMesh mesh = sheet(2000, 4000), replica = mesh;
  TriangleGrid grid(mesh), replica_grid = grid;
  for (SheetMesh* each : {&mesh, &replica})
    each->reserve_pages(each->triangles.pages());
  for (TriangleGrid* each : {&grid, &replica_grid})
    each->reserve_pages(each->bytes());
  SheetEdit edit(mesh);
  CutWorkspace work(capacity_for(mesh.vertices.size(), mesh.triangles.size())), small({40, 60, 60});
  LocalRefinementWorkspace refinement(mesh);
  Random random(8);
  int cuts = 0, too_little = 0;
  for (int i = 0; i < 400; ++i) {
    const Ring tool = any_tool(random, random.point(-100, 2100), random.between(5, 400));
    bool small_failed = false;
    EXPECT_EQ(allocations_of([&] {
                CutReport report = cut_in_place(mesh, grid, tool, small, edit);
                small_failed = report.outcome == CutOutcome::kCapacity;
                if (small_failed) report = cut_in_place(mesh, grid, tool, work, edit);
                if (report.outcome != CutOutcome::kCut) return;
                ++cuts;
                refine_locally(mesh, edit, work.stitch.created, {}, refinement);
                grid.update(edit.change(), mesh);
                edit.change().copy_to(mesh, replica);
                replica_grid.update(edit.change(), replica);
              }),
              0U);
    too_little += small_failed ? 1 : 0;
    ASSERT_TRUE(same(mesh, replica));
  }
  EXPECT_TRUE(check_sheet_mesh(mesh));
  EXPECT_GT(cuts, 100);
  EXPECT_GT(too_little, 20);
}

TEST(CutAllocations, TheRemesherDoesNotAllocate) {
  TROCAR_NEEDS_COUNTED_ALLOCATIONS();
  const Scene scene = test::descent_scene({0.12}, 0.2, 0.1, 0.015);
  Remesher remesher(*place_slices(scene, test::square_asset(1), "a"));
  const Tool tool = make_tool(scene.tool);
  for (std::uint32_t i = 1; i <= 60; ++i) {
    Pose pose;
    pose.p_m = {-0.02 + 0.0005 * i, 0.001 * (i % 7), 0.1};
    const Sheet* sheet = current(remesher, 0);
    CutRequest request{0, i, outline_on_lattice(tool, pose, sheet->transform, sheet->z_m)};
    EXPECT_EQ(allocations_of([&] {
                remesher.request(request);
                remesher.serve();
                remesher.publish_next();
                current(remesher, 0);
              }),
              0U);
    ASSERT_EQ(current(remesher, 0)->cuts, i);
  }
  EXPECT_TRUE(check_sheet_mesh(remesher.last_version(0).mesh));
}

TEST(Remeshing, ASheetGetsMoreSlotsBeforeTheyAreUsedUp) {
  Scene scene = test::descent_scene({0.12}, 0.2, 0.1, 0.015);
  scene.tool.radius_m = 0.0004;
  Remesher remesher(*place_slices(scene, test::square_asset(1), "a"));
  const Tool tool = make_tool(scene.tool);
  const std::size_t slots = remesher.last_version(0).mesh.triangles.size();
  std::int64_t removed = 0;
  std::uint32_t cut = 0;
  for (int i = 0; i < 26; ++i) {
    for (int j = 0; j < 26; ++j) {
      Pose pose;
      pose.p_m = {-0.0187 + 0.0015 * i, -0.0186 + 0.0015 * j, 0.1};
      const Sheet* sheet = current(remesher, 0);
      remesher.request({0, ++cut, outline_on_lattice(tool, pose, sheet->transform, sheet->z_m)});
      remesher.serve();
      const CutRecord& record = remesher.records().back();
      ASSERT_FALSE(record.error) << cut << ": " << record.error->message;
      ASSERT_EQ(record.cut.outcome, CutOutcome::kCut);
      removed += record.cut.doubled_area_removed;
      ASSERT_EQ(current(remesher, 0)->cuts, cut - 1) << "the version that is read must not change";
      ASSERT_TRUE(remesher.publish_next());
      ASSERT_EQ(current(remesher, 0)->cuts, cut);
    }
  }
  const SheetMesh last = remesher.last_version(0).mesh;
  EXPECT_GT(last.triangles.size(), slots) << "the test must need more slots";
  EXPECT_TRUE(check_sheet_mesh(last));
  EXPECT_EQ(doubled_area(to_slice_mesh(remesher.first_version(0).mesh)),
            doubled_area(to_slice_mesh(last)) + removed);
  // One more cut, which is made in the other replica: that has followed all cuts.
  Pose away;
  away.p_m = {0.5, 0.5, 0.1};
  const Sheet* sheet = current(remesher, 0);
  remesher.request({0, ++cut, outline_on_lattice(tool, away, sheet->transform, sheet->z_m)});
  remesher.serve();
  EXPECT_TRUE(same(remesher.last_version(0).mesh, last));
  std::size_t in_grid = 0;
  remesher.last_version(0).grid.for_each(
      last, {{INT32_MIN / 2, INT32_MIN / 2}, {INT32_MAX / 2, INT32_MAX / 2}},
      [&](std::uint32_t) { ++in_grid; });
  EXPECT_EQ(in_grid, last.triangles_in_use());
}

}  // namespace
}  // namespace trocar::runtime
