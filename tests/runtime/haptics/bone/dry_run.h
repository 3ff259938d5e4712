// SPDX-License-Identifier: Apache-2.0
// A body, a plate that is put anywhere, what a session does with the holes, and a scene, for the
// tests of bone_contact.h.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "formats/mesh/cut.h"
#include "runtime/haptics/bone/bone_contact.h"
#include "tests/support/body_fixture.h"
#include "tests/support/whole_cut.h"

namespace trocar::runtime {

inline constexpr double kTick_s = 1e-3;

/// Ten slices of 1 mm whose walls yield at 0.5 mm.
inline Scene walled() {
  Scene scene = test::body_scene(0, 9, 0.12);
  scene.tissue.cut = CutTissue{0.2, std::nullopt, 0, 1, 0, 0, 0, 10, 5};
  scene.tissue.stiffness_N_per_m = 50'000;
  scene.force_law.tip_friction = 0;
  return scene;
}

/// A body, a plate that is put anywhere, and what a session does with the holes.
class DryRun {
 public:
  DryRun(Scene scene, const Asset& asset, bool is_rigid = true)
      : placed_(scene, asset), bone_(*make_bone_volume(scene, placed_.sheets)) {
    bone_.options.coupling = {
        .is_rigid = is_rigid, .translation_N_per_m = 10'000, .rotation_Nm_per_rad = 25};
    state_ = make_bone_contact_state(bone_);
  }

  const ContactOutput& tick(double x_m, double z_m, double interval_s = kTick_s) {
    Pose T;
    T.p_m = {x_m, 0, z_m};
    update_bone_contact(bone_, placed_.sheets, T, T, interval_s, tracks_.tracks, state_, out_);
    EXPECT_FALSE(out_.backlog);
    for (const CutRequest& cut : out_.cuts()) {
      requests_.push_back(cut);
      (cut.is_puncture ? fronts_ : sides_) += 1;
    }
    peak_N_ = std::max(peak_N_, state_.result.tip_N);
    most_in_a_tick_ = std::max(most_in_a_tick_, out_.cuts().size());
    return out_;
  }
  /// In steps of 20 um.
  void move(double x0_m, double z0_m, double x1_m, double z1_m) {
    const int steps = std::max(1, static_cast<int>(std::hypot(x1_m - x0_m, z1_m - z0_m) / 20e-6));
    for (int k = 0; k <= steps; ++k) {
      const double part = static_cast<double>(k) / steps;
      tick(x0_m + part * (x1_m - x0_m), z0_m + part * (z1_m - z0_m));
    }
  }
  /// Cuts all holes that were requested and puts the meshes in use.
  void publish() {
    for (const CutRequest& request : requests_) {
      const auto i = static_cast<std::size_t>(request.sheet);
      const Sheet& before = *placed_.sheets[i];
      EXPECT_EQ(request.cut, before.cuts + 1) << "in order";
      auto after = std::make_unique<Sheet>(before);
      auto result = cut(to_slice_mesh(before.mesh), to_ring(request.outline));
      ASSERT_TRUE(result) << result.error().message;
      after->mesh = *make_sheet_mesh(result->mesh, kSpareVertices, kSpareTriangles);
      after->index_mesh();
      ++after->cuts;
      placed_.owned.push_back(std::move(after));
      placed_.sheets[i] = placed_.owned.back().get();
    }
    requests_.clear();
  }
  double force_N() const { return state_.wrench_device[2]; }
  double side_N() const { return state_.wrench_device[0]; }

  test::Placed placed_;
  BoneVolume bone_;
  BoneContactState state_;
  ContactState tracks_;
  ContactOutput out_;
  std::vector<CutRequest> requests_;
  int fronts_ = 0, sides_ = 0;
  double peak_N_ = 0;
  std::size_t most_in_a_tick_ = 0;
};

}  // namespace trocar::runtime
