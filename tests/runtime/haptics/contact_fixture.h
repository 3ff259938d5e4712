// SPDX-License-Identifier: Apache-2.0
// Sheets around the z axis under a tool, for the tests of runtime/contact.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <random>
#include <span>
#include <vector>

#include "formats/mesh/cut.h"
#include "formats/mesh/mesh_validity.h"
#include "runtime/haptics/puncture.h"
#include "runtime/haptics/sheet.h"
#include "tests/support/sheet_fixture.h"
#include "tests/support/uniform.h"
#include "tests/support/whole_cut.h"

namespace trocar::runtime {

inline Pose at(double x_m, double y_m, double z_m, double yaw_rad = 0) {
  Pose pose;
  pose.p_m = {x_m, y_m, z_m};
  pose.q = Eigen::Quaterniond(Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()));
  return pose;
}

using trocar::test::uniform;

/// An arrow head: 4 corners, one of them re-entrant.
inline SceneTool arrow() {
  SceneTool shape;
  shape.outline_m = {{0.004, 0}, {-0.003, 0.003}, {-0.001, 0}, {-0.003, -0.003}};
  return shape;
}

/// In steps squared.
inline long double area(const LatticeOutline& outline) {
  return static_cast<long double>(doubled_area(to_ring(outline))) / 2;
}

constexpr double kTop_m = 0.12, kTick_s = 1e-3;

/// One or more square sheets of 40 mm around the z axis, and a hexagon of 3 mm.
class ContactTest : public testing::Test {
 protected:
  void place(const std::vector<double>& heights_m) {
    scene_ = test::descent_scene(heights_m, 0.2, 0.1, 0.015);
    auto placed = place_slices(scene_, test::square_asset(static_cast<int>(heights_m.size())), "a");
    ASSERT_TRUE(placed) << placed.error().message;
    owned_ = std::move(*placed);
    sheets_.clear();
    for (const auto& sheet : owned_)
      sheets_.push_back(sheet.get());
    model_.tool = make_tool(scene_.tool);
    model_.dt_s = kTick_s;
    state_ = ContactState{};
  }
  void SetUp() override { place({kTop_m}); }

  ContactOutput tick(const Pose& pose) {
    ContactOutput output;
    update_contact(model_, sheets_, response_, pose, model_.dt_s, state_, output);
    return output;
  }
  /// Gives all sheets this tissue.
  void set_tissue(const Tissue& tissue) {
    for (const Sheet*& sheet : sheets_) {
      auto changed = std::make_unique<Sheet>(*sheet);
      changed->tissue = tissue;
      owned_.push_back(std::move(changed));
      sheet = owned_.back().get();
    }
  }
  double overlap_at(const LatticeOutline& outline, std::span<const LatticeOutline> holes = {}) {
    return overlap(*sheets_[0], model_.tool, outline, holes).coverage;
  }
  /// Cuts the hole and puts the new mesh in use.
  void publish(const CutRequest& request) {
    ASSERT_GE(request.sheet, 0) << "no puncture";
    const Sheet& before = *sheets_[request.sheet];
    auto result = cut(to_slice_mesh(before.mesh), to_ring(request.outline));
    ASSERT_TRUE(result) << result.error().message;
    auto after = std::make_unique<Sheet>(before);
    after->mesh = *make_sheet_mesh(result->mesh, kSpareVertices, kSpareTriangles);
    after->index_mesh();
    ++after->cuts;
    owned_.push_back(std::move(after));
    sheets_[request.sheet] = owned_.back().get();
  }

  Scene scene_;
  ContactModel model_;
  ContactState state_;
  PrefetchedStiffness response_;
  std::vector<std::unique_ptr<const Sheet>> owned_;
  std::vector<const Sheet*> sheets_;
};

}  // namespace trocar::runtime
