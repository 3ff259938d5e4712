// SPDX-License-Identifier: Apache-2.0
// The remesher: replicas are swapped, each hole is cut once, and the haptic thread's version never
// changes while it is in use.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>

#include "runtime/session/remesher.h"
#include "tests/support/check_sheet_mesh.h"
#include "tests/support/remesher_reader.h"
#include "tests/support/sheet_fixture.h"

namespace trocar::runtime {
namespace {

using test::current;

TEST(Remesher, ItsThreadServesAndPublishesRequests) {
  const Scene scene = test::descent_scene({0.12, 0.14}, 0.2, 0.1, 0.015);
  Remesher remesher(*place_slices(scene, test::square_asset(2), "a"));
  const std::int64_t whole = doubled_area(to_slice_mesh(current(remesher, 0)->mesh));
  remesher.start();
  std::int64_t removed = 0;
  for (std::uint32_t i = 0; i < 20; ++i) {
    CutRequest request;
    request.sheet = static_cast<std::int32_t>(i % 2);
    request.cut = i / 2 + 1;
    Pose pose;
    // The holes overlap.
    pose.p_m = {-0.015 + 0.003 * (request.cut - 1), 0.001 * (i % 7), 0.1};
    const Sheet* before = current(remesher, request.sheet);
    request.outline =
        outline_on_lattice(make_tool(scene.tool), pose, before->transform, before->z_m);
    ASSERT_TRUE(remesher.request(request));
    // The haptic thread uses the old version until the new one is published.
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (current(remesher, request.sheet)->cuts < request.cut) {
      ASSERT_LT(std::chrono::steady_clock::now(), until);
      ASSERT_GT(current(remesher, request.sheet)->mesh.triangles_in_use(), 0U);
    }
  }
  remesher.stop();
  for (const CutRecord& record : remesher.records()) {
    ASSERT_FALSE(record.error) << record.error->message;
    if (record.request.sheet == 0) removed += record.cut.doubled_area_removed;
  }
  EXPECT_EQ(remesher.records().size(), 20U);
  EXPECT_EQ(doubled_area(to_slice_mesh(remesher.last_version(0).mesh)), whole - removed);
  EXPECT_EQ(doubled_area(to_slice_mesh(remesher.first_version(0).mesh)), whole);
}

class TwoReplicas : public testing::Test {
 protected:
  TwoReplicas() {
    scene_ = test::descent_scene({0.12, 0.14}, 0.2, 0.1, 0.015);
    remesher_ = std::make_unique<Remesher>(*place_slices(scene_, test::square_asset(2), "a"));
  }
  void ask(std::int32_t sheet, std::uint32_t cut) {
    Pose pose;
    pose.p_m = {-0.015 + 0.002 * cut, 0, 0.1};
    const Sheet& placed = remesher_->first_version(static_cast<std::size_t>(sheet));
    ASSERT_TRUE(remesher_->request(
        {sheet, cut,
         outline_on_lattice(make_tool(scene_.tool), pose, placed.transform, placed.z_m)}));
  }
  Scene scene_;
  std::unique_ptr<Remesher> remesher_;
};

TEST_F(TwoReplicas, TheOlderReplicaIsNotWrittenWhileTheReaderUsesIt) {
  const Sheet* const first = current(*remesher_, 0);
  const SheetMesh before = first->mesh;
  ask(0, 1);
  ask(0, 2);
  remesher_->serve();
  EXPECT_EQ(remesher_->records().size(), 1U) << "at most one unpublished version";
  EXPECT_EQ(current(*remesher_, 0), first);
  EXPECT_TRUE(remesher_->publish_next());
  EXPECT_FALSE(remesher_->publish_next());
  for (int i = 0; i < 3; ++i)
    remesher_->serve();
  EXPECT_EQ(remesher_->records().size(), 1U) << "the reader still uses the first version";
  EXPECT_EQ(first->mesh.triangles, before.triangles);
  EXPECT_EQ(first->mesh.vertices, before.vertices);
  const Sheet* const second = current(*remesher_, 0);
  EXPECT_NE(second, first);
  EXPECT_EQ(second->cuts, 1U);
  remesher_->serve();
  ASSERT_EQ(remesher_->records().size(), 2U);
  EXPECT_TRUE(remesher_->publish_next());
  EXPECT_EQ(current(*remesher_, 0), first) << "two replicas, not more";
  EXPECT_EQ(first->cuts, 2U);
  for (const Sheet* sheet : {first, second})
    EXPECT_TRUE(check_sheet_mesh(sheet->mesh));
  std::int64_t removed = 0;
  for (const CutRecord& record : remesher_->records()) {
    ASSERT_FALSE(record.error);
    removed += record.cut.doubled_area_removed;
    std::int64_t of_hole = 0;
    for (const Ring& ring : remesher_->hole(record))
      of_hole += doubled_area(ring);
    EXPECT_EQ(of_hole, record.cut.doubled_area_removed);
  }
  EXPECT_EQ(doubled_area(to_slice_mesh(before)) - doubled_area(to_slice_mesh(first->mesh)),
            removed);
}

// If versions are published while a tick reads the sheets, it uses none of them, or all that came
// before one that it uses. A replay knows only their number.
TEST_F(TwoReplicas, ATickUsesVersionsInTheOrderOfTheirPublication) {
  const Sheet* const first[] = {current(*remesher_, 0), current(*remesher_, 1)};
  ask(1, 1);
  ask(0, 1);
  remesher_->serve();
  const std::uint64_t before = remesher_->versions_published();
  EXPECT_EQ(remesher_->current(0, before), first[0]);
  ASSERT_TRUE(remesher_->publish_next());
  const std::uint64_t between = remesher_->versions_published();
  ASSERT_TRUE(remesher_->publish_next());
  EXPECT_EQ(remesher_->current(1, before), first[1]) << "published after the tick had begun";
  EXPECT_EQ(remesher_->current(0, between), first[0]);
  EXPECT_EQ(remesher_->current(1, between)->cuts, 1U);
  // The version that sheet 0 still uses is not written.
  ask(0, 2);
  remesher_->serve();
  EXPECT_EQ(first[0]->cuts, 0U);
  EXPECT_EQ(remesher_->versions_published(), 2U);
  EXPECT_EQ(current(*remesher_, 0)->cuts, 1U);
}

TEST_F(TwoReplicas, SheetsDoNotWaitForOneAnotherAndStopServesTheRest) {
  ask(0, 1);
  ask(1, 1);
  remesher_->serve();
  EXPECT_EQ(remesher_->records().size(), 2U);
  ask(1, 2);
  ask(1, 3);
  ask(0, 2);
  remesher_->stop();
  EXPECT_EQ(remesher_->records().size(), 5U);
  EXPECT_EQ(current(*remesher_, 0)->cuts, 2U);
  EXPECT_EQ(current(*remesher_, 1)->cuts, 3U);
}

TEST_F(TwoReplicas, AFailedCutIsRecordedAndTheSheetIsUnchanged) {
  const SheetMesh before = current(*remesher_, 0)->mesh;
  CutRequest not_a_tool;
  not_a_tool.sheet = 0;
  not_a_tool.cut = 1;
  ASSERT_TRUE(remesher_->request(not_a_tool));
  ask(0, 2);
  ask(0, 3);
  remesher_->serve();
  EXPECT_FALSE(remesher_->publish_next());
  ASSERT_EQ(remesher_->records().size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    const std::optional<Error>& error = remesher_->records()[i].error;
    ASSERT_TRUE(error);
    EXPECT_EQ(error->message, i == 0 ? "cut: invalid tool"
                                     : "hole 1 of this slice could not be cut, so no later one is");
  }
  EXPECT_EQ(current(*remesher_, 0)->cuts, 0U);
  EXPECT_EQ(current(*remesher_, 0)->mesh.triangles, before.triangles);
  ask(1, 1);
  remesher_->serve();
  EXPECT_TRUE(remesher_->publish_next()) << "another sheet is cut as before";
  EXPECT_FALSE(remesher_->records().back().error);
}

TEST_F(TwoReplicas, TheQualityPassLeavesNoAngleBelowItsBound) {
  const auto smallest_deg = [](const SheetMesh& sheet) {
    const SliceMesh mesh = to_slice_mesh(sheet);
    double smallest = 90;
    for (const Triangle& t : mesh.triangles) {
      for (int i = 0; i < 3; ++i) {
        const LatticePoint a = mesh.vertices[t[i]], b = mesh.vertices[t[(i + 1) % 3]],
                           c = mesh.vertices[t[(i + 2) % 3]];
        const double cross = static_cast<double>(orient2d(a, b, c));
        const double dot = static_cast<double>(diametral_dot(b, c, a));
        smallest = std::min(smallest, std::atan2(cross, dot) * 180 / 3.14159265358979);
      }
    }
    return smallest;
  };
  const auto sheets = place_slices(scene_, test::square_asset(2), "a");
  const Sheet& placed = *(*sheets)[0];
  Pose pose;
  pose.p_m = {0.0004, 0.0003, 0.1};
  const LatticeOutline outline =
      outline_on_lattice(make_tool(scene_.tool), pose, placed.transform, placed.z_m);
  Remesher remesher(*sheets);
  ASSERT_TRUE(remesher.request({0, 1, outline}));
  remesher.stop();
  EXPECT_GE(smallest_deg(remesher.last_version(0).mesh), kMinHoleAngle_deg);
  EXPECT_GT(remesher.records()[0].quality_vertices, 0U);
}

}  // namespace
}  // namespace trocar::runtime
