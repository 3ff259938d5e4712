// SPDX-License-Identifier: Apache-2.0
// The law `cutting` on sheets, tick by tick, with holes cut and published as a session does.
#include "runtime/haptics/bone/bone_contact.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "formats/mesh/cut.h"
#include "runtime/haptics/sheet.h"
#include "tests/support/body_fixture.h"
#include "tests/support/counted_allocations.h"
#include "tests/support/random_geometry.h"
#include "tests/support/whole_cut.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;
using test::body_scene;
using test::cutting_scene;
using test::kHexagon_m2;
using test::spaced_asset;
using test::square_asset;
using test::stack;

constexpr double kTick_s = 1e-3;

/// Ten slices of 1 mm whose walls yield at 0.5 mm.
Scene walled() {
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

/// Cancellous bone whose strength follows the HU.
CutTissue bone_by_hu() {
  CutTissue cut;
  cut.bone = BoneByHu{"kopperdahl-linear", "qct", 8e-4, 0, false};
  return cut;
}

/// Ten slices of 150 HU towards -x and of 350 HU towards +x.
Asset of_two_halves() {
  Asset asset = spaced_asset(10, 1, std::vector<double>(10, 0.0));
  for (AssetSlice& slice : asset.slices)
    for (std::size_t v = 0; v < slice.mesh.vertices.size(); ++v)
      slice.hu[v] = slice.mesh.vertices[v].x / 256 < 80 ? 150.F : 350.F;
  return asset;
}

/// Moves slice i along x by this many steps.
void shift(Asset& asset, std::size_t i, int steps) {
  AssetSlice& slice = asset.slices[i];
  for (LatticePoint& p : slice.mesh.vertices)
    p.x += steps;
  for (Ring& ring : slice.pslg.rings)
    for (LatticePoint& p : ring)
      p.x += steps;
}

// The law `cutting` on sheets, tick by tick, with holes cut and published as a session does.

/// The default tool's corners in mm.
Polygon hexagon(double x_mm) {
  Polygon out;
  for (int k = 0; k < 6; ++k) {
    const double angle = std::numbers::pi / 3 * k;
    out.push_back({x_mm + 3 * std::cos(angle), 3 * std::sin(angle)});
  }
  return out;
}

double area_mm2(const Polygon& p) {
  Real doubled = 0;
  for (std::size_t i = 0; i < p.size(); ++i) {
    const auto &a = p[i], &b = p[(i + 1) % p.size()];
    doubled += a[0] * b[1] - a[1] * b[0];
  }
  return static_cast<double>(doubled / 2);
}

/// The part of a hexagon beside another of the same kind, or of the square to x = 20 mm.
double share_beside(double off_mm) {
  Polygon both = hexagon(off_mm);
  const Polygon old = hexagon(0);
  for (std::size_t i = 0; i < 6; ++i) {
    const auto point = [&](std::size_t k) {
      return LatticePoint{static_cast<int>(std::lround(1e6 * static_cast<double>(old[k % 6][0]))),
                          static_cast<int>(std::lround(1e6 * static_cast<double>(old[k % 6][1])))};
    };
    for (auto& p : both)
      p = {p[0] * 1e6L, p[1] * 1e6L};
    both = clip(both, point(i), point(i + 1));
    for (auto& p : both)
      p = {p[0] / 1e6L, p[1] / 1e6L};
  }
  return 1 - area_mm2(both) / area_mm2(hexagon(0));
}

// --- contract 1: share and HU ---

TEST(BodyContact, TheStrengthIsThatOfTheHuUnderTheTool) {
  Scene scene = body_scene(0, 9, 0.12);
  scene.tissue.cut = bone_by_hu();
  scene.tissue.stiffness_N_per_m = 200'000;
  const Asset asset = of_two_halves();
  for (const double x_mm : {-10.0, 10.0}) {
    const double hu = x_mm < 0 ? 150 : 350;
    DryRun trial(scene, asset);
    trial.move(x_mm * 1e-3, 0.122, x_mm * 1e-3, 0.1155);
    EXPECT_NEAR(trial.force_N(), (-0.75 + 24.9 * 8e-4 * hu) * 1e6 * kHexagon_m2, 0.05) << hu;
  }
}

// A surface of 45 degrees: the force has the direction of the friction cone, and a tool that nobody
// holds sideways slides.
TEST(BodyContact, ASlopePushesTheToolSidewaysAndLetsItSlide) {
  for (const double friction : {0.0, 0.3}) {
    const double ratio = (1 - friction) / (1 + friction);
    Scene scene = body_scene(0, 15, 0.12);
    scene.tissue.cut = CutTissue{};
    scene.tissue.cut->strength_MPa = 30;
    scene.tissue.stiffness_N_per_m = 200'000;
    scene.force_law.tip_friction = friction;
    Asset asset = spaced_asset(16, 1);
    for (int i = 0; i < 16; ++i)  // the edge of slice 8 is under the tool's axis
      shift(asset, static_cast<std::size_t>(i), 256 * (i + 12));
    DryRun trial(scene, asset, false);
    int loaded = 0;
    double z_m = 0;
    for (int k = 0; k < 1600; ++k) {
      z_m = 0.118 - 5e-6 * k;
      trial.tick(0, z_m);
      if (trial.force_N() < 5) continue;
      ++loaded;
      // While the front cuts the edge of a slice, friction still has the limit of the tick before.
      const double bound = trial.state_.result.cut_J > 0 ? 0.1 : 0.05;
      ASSERT_NEAR(-trial.side_N() / trial.force_N(), ratio, bound * ratio)
          << friction << ", " << z_m << ", " << trial.force_N() << " N";
    }
    EXPECT_GT(loaded, 500);
    const double x_m = trial.state_.law.T_device_proxy.p_m.x(), force_N = trial.force_N();
    for (int k = 0; k < 300; ++k)
      trial.tick(trial.state_.law.T_device_proxy.p_m.x(), z_m);
    EXPECT_LT(trial.state_.law.T_device_proxy.p_m.x(), x_m - 1e-3);
    EXPECT_LT(trial.force_N(), 0.2 * force_N);
  }
}

// The shaft's friction and a shell without support follow the HU under the tool, not the slice's
// mean.
TEST(BodyContact, FrictionAndAThinShellAreThoseOfTheHuUnderTheTool) {
  Scene scene = body_scene(0, 9, 0.12);
  scene.tissue.cut = bone_by_hu();
  scene.tissue.cut->friction_kPa = 20;
  scene.tissue.cut->friction_coefficient = 0.05;
  scene.body->shell_m = 0.8e-3;
  scene.body->shell_free_radius_m = 5e-3;
  const Asset asset = of_two_halves();
  for (const double x_mm : {-10.0, 10.0}) {
    const double hu = x_mm < 0 ? 150 : 350;
    DryRun trial(scene, asset);
    trial.move(x_mm * 1e-3, 0.122, x_mm * 1e-3, 0.1201);
    const double strength_Pa = (-0.75 + 24.9 * 8e-4 * hu) * 1e6, pi = std::numbers::pi;
    const double flow_Pa = 100e6 * std::pow(8e-4 * hu / 0.598 / 1.9, 2),
                 radius_m = std::sqrt(kHexagon_m2 / pi);
    const double bending_N =
        3 * pi * flow_Pa * 0.8e-3 * 0.8e-3 / 4 / (1 - 2 * radius_m / (3 * 5e-3));
    ASSERT_LT(bending_N, strength_Pa * kHexagon_m2) << "bends before it is crushed";
    EXPECT_NEAR(trial.state_.slabs[0].strength_top_N, bending_N, 1e-3 * bending_N) << hu;
    EXPECT_NEAR(trial.state_.slabs[0].friction_N_per_m, (20e3 + 0.05 * strength_Pa) * 18e-3, 0.5)
        << hu;
  }
}

// A wide shell must not be taken for the body's inside.
TEST(BodyContact, AShellLiesWhereTheToolComesInAndGoesOutOnly) {
  for (const double spacing_mm : {0.5, 1.0, 2.0}) {
    for (const double shell_mm : {0.6, 1.0, 1.5, 4.0, 6.0}) {
      for (const double off_mm : {0.0, 0.3}) {
        const int slices = static_cast<int>(24 / spacing_mm);
        const double top_m = 0.12 - off_mm * 1e-3;
        Scene scene = body_scene(0, slices - 1, top_m);
        scene.body->shell_m = shell_mm * 1e-3;
        scene.body->shell_factor = 3;
        scene.tissue.threshold_N = 10;
        scene.tissue.stiffness_N_per_m = 50'000;
        DryRun trial(scene, spaced_asset(slices, spacing_mm));
        const double top = -trial.bone_.sheets.front().top_m,
                     bottom = -trial.bone_.sheets.back().bottom_m;
        double inside_N = 0, shell_in_m = 0, shell_out_m = 0, last_m = -top;
        for (int step = 0;; ++step) {
          const double z_m = top + 1e-3 - step * 20e-6;
          if (z_m <= bottom - 2e-3) break;
          trial.tick(0, z_m);
          const double front_m = trial.state_.result.front_m;
          if (!std::isfinite(front_m)) break;
          const double into_m = front_m + top, left_m = -bottom - front_m;
          const double step_m = front_m - last_m;
          last_m = front_m;
          if (into_m > (shell_mm + 0.1) * 1e-3 && left_m > (shell_mm + 0.1) * 1e-3)
            inside_N = std::max(inside_N, trial.state_.result.tip_N);
          if (trial.state_.result.tip_N > 29) (into_m < 12e-3 ? shell_in_m : shell_out_m) += step_m;
        }
        const std::string where = std::to_string(spacing_mm) + " mm, shell " +
                                  std::to_string(shell_mm) + ", off " + std::to_string(off_mm);
        EXPECT_NEAR(trial.peak_N_, 30, 1e-6) << where;
        EXPECT_LT(inside_N, 10 + 1e-6) << where;
        // A part that is thinner than the tip's stretch is passed by a jump.
        EXPECT_NEAR(shell_in_m, shell_mm * 1e-3, 0.05e-3) << where;
        EXPECT_NEAR(shell_out_m, shell_mm * 1e-3, 0.05e-3) << where;
        // The front's work is that of both shells and the bone between.
        EXPECT_NEAR(trial.state_.energy.cut_J,
                    2 * 30 * shell_mm * 1e-3 + 10 * (24 - 2 * shell_mm) * 1e-3, 1e-6)
            << where;
      }
    }
  }
}

// --- contract 2: holes ---

TEST(BodyContact, ASnapRequestsAHoleOfEverySheetThatItPasses) {
  // A hard slice over nine soft ones: from 35 N to 5 N at 5 kN/m the front would jump 6 mm, and
  // cuts kMostCut_m in a tick.
  Scene scene = cutting_scene(stack(0.12, 0.3e-3, 10));
  NamedTissue soft;
  soft.name = "soft";
  soft.tissue.threshold_N = 5;
  scene.tissues = {soft};
  for (std::size_t i = 1; i < 10; ++i)
    scene.slices[i].tissue = "soft";
  DryRun trial(scene, square_asset(10));
  // The hard slab's strength falls towards its neighbour.
  trial.move(0, 0.1215, 0, 0.104);
  EXPECT_GE(trial.most_in_a_tick_, 4U);
  ASSERT_EQ(trial.requests_.size(), 10U);
  std::set<int> sheets;
  for (const CutRequest& request : trial.requests_) {
    EXPECT_TRUE(request.is_puncture);
    EXPECT_EQ(request.cut, 1U);
    sheets.insert(request.sheet);
    EXPECT_NEAR(static_cast<double>(doubled_area(to_ring(request.outline))) / 2 / 65536,
                kHexagon_m2 * 1e6, 0.05);
  }
  EXPECT_EQ(sheets.size(), 10U) << "each once";
  // Slab means times 0.3 mm, whatever the jumps.
  EXPECT_NEAR(trial.state_.energy.cut_J, (35 + 9 * 5) * 0.3e-3, 1e-9);
}

TEST(BodyContact, WhatIsCutIsFreeOnReEntryAndElsewhereItIsTheShare) {
  for (const bool published : {false, true}) {
    for (const double off_mm : {0.0, 0.01, 0.5, 1.0, 2.5, 4.0, 6.5}) {
      DryRun trial(cutting_scene({0.12}), square_asset(1));
      trial.move(0, 0.121, 0, 0.111);
      ASSERT_EQ(trial.fronts_, 1);
      if (published) trial.publish();
      trial.move(0, 0.111, 0, 0.121);
      trial.move(0, 0.121, off_mm * 1e-3, 0.121);
      trial.peak_N_ = 0;
      trial.move(off_mm * 1e-3, 0.121, off_mm * 1e-3, 0.111);
      const double share = share_beside(off_mm);
      if (off_mm < 0.05) {
        EXPECT_EQ(trial.peak_N_, 0) << off_mm;
        EXPECT_EQ(trial.fronts_, 1) << off_mm;
        continue;
      }
      EXPECT_EQ(trial.fronts_, 2) << off_mm;
      EXPECT_LE(trial.peak_N_, 35 * share + 0.2) << off_mm;
      EXPECT_GE(trial.peak_N_, 35 * share - 0.2 - 5000 * 20e-6) << off_mm;
    }
  }
}

// --- contract 3: walls ---

TEST(BodyContact, AWallIsCutWhereItYieldedAndNotBefore) {
  DryRun trial(walled(), spaced_asset(10, 1));
  trial.move(0, 0.121, 0, 0.1146);
  trial.publish();
  const int fronts = trial.fronts_;
  trial.move(0, 0.1146, 0.4e-3, 0.1146);
  for (int k = 0; k < 200; ++k)
    trial.tick(0.4e-3, 0.1146);
  EXPECT_EQ(trial.sides_, 0) << "below the strength nothing yields";
  // 10 N/mm^3 over the width and the depth that the shaft fills.
  const double length_m = trial.state_.result.embedded_m;
  EXPECT_NEAR(-trial.side_N(), 10e9 * test::kHexagonWidth_m * length_m * 0.4e-3,
              0.02 * -trial.side_N());
  trial.move(0.4e-3, 0.1146, 0, 0.1146);
  EXPECT_NEAR(trial.side_N(), 0, 1) << "it was elastic";
  trial.move(0, 0.1146, 3e-3, 0.1146);
  for (int k = 0; k < 200; ++k)
    trial.tick(3e-3, 0.1146);
  EXPECT_GT(trial.sides_, 0);
  EXPECT_EQ(trial.fronts_, fronts) << "no front has moved";
  EXPECT_NEAR(-trial.side_N(), 5e6 * test::kHexagonWidth_m * length_m, 0.02 * -trial.side_N())
      << "the lateral strength";
  for (const CutRequest& request : trial.requests_) {
    EXPECT_FALSE(request.is_puncture);
    EXPECT_LT(request.sheet, 6) << "the front is above";
    const LatticeBox box = box_around(request.outline);
    const double middle_mm = (box.low.x + box.high.x) / 512.0 - 80;
    EXPECT_GT(middle_mm, 0.25 * 3 * 0.9) << "a quarter of the radius, at least";
    EXPECT_LT(middle_mm, 2.5 + 0.05) << "what has yielded: 3 mm less the elastic 0.5 mm";
  }
  trial.publish();
}

TEST(BodyContact, BesideMaterialItsEdgeIsTheWall) {
  // The square ends at 20 mm; the tool's disc has a radius of 2.73 mm.
  for (const bool is_rigid : {true, false}) {
    DryRun trial(walled(), spaced_asset(10, 1), is_rigid);
    trial.move(25e-3, 0.121, 25e-3, 0.113);
    EXPECT_EQ(trial.fronts_, 0);
    EXPECT_EQ(trial.out_.phase, ContactPhase::kMissed);
    trial.move(25e-3, 0.113, 22.8e-3, 0.113);
    EXPECT_NEAR(trial.side_N(), 0, 1e-6) << "not touched";
    trial.move(22.8e-3, 0.113, 22.6e-3, 0.113);
    for (int k = 0; k < 50; ++k)
      trial.tick(22.6e-3, 0.113);
    EXPECT_GT(trial.side_N(), 1) << "the wall pushes outwards";
    EXPECT_EQ(trial.sides_, 0);
    trial.move(22.6e-3, 0.113, 25e-3, 0.113);
    EXPECT_NEAR(trial.side_N(), 0, 1e-6);
  }
}

// --- contract 4 ---

TEST(BodyContact, WithoutANewPoseNothingIsDoneTwice) {
  for (const double viscous_N_s_per_m : {0.0, 10.0}) {
    for (const bool is_rigid : {true, false}) {
      Scene scene = walled();
      scene.tissue.cut->friction_kPa = 20;
      scene.tissue.shaft.viscous_friction_N_s_per_m = viscous_N_s_per_m;
      DryRun once(scene, spaced_asset(10, 1), is_rigid),
          twice(scene, spaced_asset(10, 1), is_rigid);
      for (int step = 0; step < 200; ++step) {
        const double z_m = 0.121 - step * 30e-6;
        once.tick(0, z_m);
        twice.tick(0, z_m);
        const Wrench before = twice.state_.wrench_device;
        const BoneEnergyAccount energy = twice.state_.energy;
        for (int k = 0; k < 3; ++k)
          twice.tick(0, z_m, 0);
        EXPECT_LT((twice.state_.wrench_device - before).norm(), 1e-6) << viscous_N_s_per_m;
        EXPECT_EQ(twice.state_.energy.absorbed_J, energy.absorbed_J);
      }
      EXPECT_EQ(once.fronts_, twice.fronts_);
      EXPECT_NEAR(once.state_.energy.cut_J, twice.state_.energy.cut_J, 1e-9);
      EXPECT_NEAR(once.state_.energy.absorbed_J, twice.state_.energy.absorbed_J, 1e-9);
    }
  }
}

TEST(BodyContact, AFaultUnderLoadNeedsLifting) {
  DryRun trial(cutting_scene({0.12}), square_asset(1));
  Pose T;
  T.p_m = {0, 0, 0.121};
  trial.move(0, 0.121, 0, 0.116);
  EXPECT_EQ(retract_distance_m(trial.bone_, trial.placed_.sheets, T, trial.state_), 0)
      << "no fault";
  EXPECT_NEAR(trial.force_N(), 20, 0.01);
  for (int k = 0; k < 3; ++k) {
    reset_motion(trial.state_);
    for (const double z_m : {0.116, 0.118, 0.1199, 0.12, 0.121}) {
      T.p_m.z() = z_m;
      EXPECT_NEAR(retract_distance_m(trial.bone_, trial.placed_.sheets, T, trial.state_),
                  std::max(0.0, 0.12 - z_m), 1e-9);
    }
  }
  // Lifted, and on again: as new.
  trial.tick(0, 0.1201);
  EXPECT_EQ(trial.force_N(), 0);
  trial.move(0, 0.1201, 0, 0.116);
  EXPECT_NEAR(trial.force_N(), 20, 0.01);
  EXPECT_EQ(trial.fronts_, 0);
  trial.move(0, 0.116, 0, 0.111);
  EXPECT_EQ(trial.fronts_, 1);
  reset_motion(trial.state_);
  T.p_m.z() = 0.111;
  EXPECT_EQ(retract_distance_m(trial.bone_, trial.placed_.sheets, T, trial.state_), 0)
      << "nothing bears it";
}

// A tool at rest in its own hole bears nothing. While there are no forces, a hand can take it anywhere.
TEST(BodyContact, ForcesDoNotReturnInBoneThatTheToolHasNotCut) {
  const auto distance = [](const DryRun& trial, double x_m, double z_m, double y_m = 0) {
    Pose T;
    T.p_m = {x_m, y_m, z_m};
    return retract_distance_m(trial.bone_, trial.placed_.sheets, T, trial.state_);
  };
  for (const bool is_rigid : {true, false}) {
    for (const bool is_published : {false, true}) {
      DryRun trial(walled(), spaced_asset(10, 1), is_rigid);
      trial.move(0, 0.121, 0, 0.115);
      trial.move(0, 0.115, 0, 0.118);  // off the front
      EXPECT_LE(trial.state_.law.stretch_m, 0) << "no load";
      ASSERT_GT(trial.fronts_, 2);
      const double front_m = -trial.state_.front_m;
      const int fronts = trial.fronts_;
      if (is_published) trial.publish();
      EXPECT_EQ(distance(trial, 0, 0.118), 0) << "no fault";
      reset_motion(trial.state_);
      EXPECT_EQ(distance(trial, 0, 0.118), 0) << "in its own hole";
      EXPECT_EQ(distance(trial, 0, 0.13), 0) << "out of the bone";
      EXPECT_EQ(distance(trial, 0, front_m), 0) << "at the front";
      EXPECT_NEAR(distance(trial, 0, front_m - 1e-3), 1e-3, 1e-9) << "pushed on";
      const double top_m = -trial.bone_.slabs.front().top_m;
      for (const double x_m : {1e-3, 5e-3, 10e-3, -15e-3})
        EXPECT_NEAR(distance(trial, x_m, 0.1155), top_m - 0.1155, 1e-9) << x_m;
      EXPECT_NEAR(distance(trial, 5e-3, 0.1), top_m - 0.1, 1e-9) << "below the bone, through it";
      EXPECT_EQ(distance(trial, 0.03, 0.1155), 0) << "beside the bone";
      // Forces that return in the hole do not jump.
      trial.tick(0, 0.118);
      EXPECT_NEAR(trial.force_N(), 0, 1e-9);
      EXPECT_EQ(trial.fronts_, fronts);
      EXPECT_EQ(distance(trial, 5e-3, 0.1155), 0) << "with forces there is nothing to lift";
    }
  }
}

// Holes are kept; that the tool is in one is not.
TEST(BodyContact, AfterAFaultTheToolMayGoOnElsewhere) {
  DryRun trial(walled(), spaced_asset(10, 1));
  trial.move(0, 0.121, 0, 0.109);
  EXPECT_EQ(trial.fronts_, 10);
  trial.publish();
  reset_motion(trial.state_);
  // Out of the hole without force, and down beside the square.
  trial.move(0, 0.13, 25e-3, 0.13);
  trial.move(25e-3, 0.13, 25e-3, 0.113);
  EXPECT_EQ(trial.out_.phase, ContactPhase::kMissed);
  trial.move(25e-3, 0.113, 22.6e-3, 0.113);
  EXPECT_GT(trial.side_N(), 1) << "the edge is a wall still";
}

// --- the energy account ---

TEST(BodyContact, TheLedgerIsThatOfTheHeldWrench) {
  Scene scene = walled();
  scene.tissue.cut->friction_kPa = 20;
  DryRun trial(scene, spaced_asset(10, 1));
  double absorbed_J = 0, z_before_m = 0.121, before_N = 0;
  for (int k = 0; k < 500; ++k) {
    const double z_m = 0.121 - 6e-3 * std::sin(k * 0.01);
    absorbed_J += k == 0 ? 0 : before_N * (z_before_m - z_m);
    trial.tick(0, z_m);
    before_N = trial.force_N();
    z_before_m = z_m;
    EXPECT_NEAR(trial.state_.energy.absorbed_J, absorbed_J, 1e-12);
    EXPECT_EQ(trial.state_.energy.stored_J, trial.state_.result.stored_J);
  }
  EXPECT_GT(absorbed_J, 1e-3);
  EXPECT_GE(trial.state_.energy.released_max_J, 0);
}

// --- contract 5 ---

TEST(BodyContact, ATickAllocatesNothing) {
  TROCAR_NEEDS_COUNTED_ALLOCATIONS();
  Scene scene = walled();
  scene.body->shell_m = 1.3e-3;
  scene.body->shell_factor = 2;
  scene.tissue.cut->friction_kPa = 10;
  for (const bool is_rigid : {true, false}) {
    DryRun trial(scene, spaced_asset(10, 1), is_rigid);
    const std::uint64_t before = allocations_in_scopes();
    std::size_t cuts = 0, sides = 0;
    const auto go = [&](double x0_m, double z0_m, double x1_m, double z1_m, int steps) {
      for (int k = 0; k <= steps; ++k) {
        const double part = static_cast<double>(k) / steps;
        Pose T;
        T.p_m = {x0_m + part * (x1_m - x0_m), 0, z0_m + part * (z1_m - z0_m)};
        const NoAllocationScope scope;
        update_bone_contact(trial.bone_, trial.placed_.sheets, T, T, kTick_s, trial.tracks_.tracks,
                            trial.state_, trial.out_);
        cuts += trial.out_.cuts().size();
        for (const CutRequest& cut : trial.out_.cuts())
          sides += cut.is_puncture ? 0 : 1;
      }
    };
    go(17e-3, 0.121, 17e-3, 0.1145, 300);
    go(17e-3, 0.1145, 14.5e-3, 0.1145, 200);
    {
      const NoAllocationScope scope;
      reset_motion(trial.state_);
    }
    go(14.5e-3, 0.121, 25e-3, 0.121, 200);
    go(25e-3, 0.121, 25e-3, 0.112, 200);
    go(25e-3, 0.112, 22.4e-3, 0.112, 200);
    EXPECT_GE(cuts, 5U);
    if (is_rigid) {
      EXPECT_GT(sides, 0U);
    }
    EXPECT_EQ(allocations_in_scopes(), before);
  }
}

// Cortical walls that are thinner than a slice (cortical_wall.h), tick by tick in the law `cutting`.

// The same body in slices of several thicknesses: cancellous bone with a texture, and a wall of cortical bone that
// thick slices average with it.
TEST(WallContact, AWallHasItsStrengthInSlicesThatAreThickerThanTheWall) {
  Scene scene = body_scene(0, 0, 0.12);
  scene.tissue.cut = bone_by_hu();
  scene.tissue.stiffness_N_per_m = 2e6;
  const auto N = [](double hu) { return (-0.75 + 24.9 * 8e-4 * hu) * 1e6 * kHexagon_m2; };
  constexpr double kHeight_mm = 24, kStep_mm = 0.01;
  for (const double wall_mm : {0.5, 0.8, 1.2, 2.0}) {
    const auto hu_at = [&](double depth_mm) {
      return depth_mm < wall_mm || depth_mm > kHeight_mm - wall_mm
                 ? 1200
                 : 250 + 40 * std::sin(2 * std::numbers::pi * depth_mm / 8);
    };
    for (const double spacing_mm : {0.5, 1.0, 2.0}) {
      const int slices = static_cast<int>(kHeight_mm / spacing_mm);
      std::vector<double> hu(static_cast<std::size_t>(slices));
      for (int i = 0; i < slices; ++i) {  // index 0 is the lowest
        const int samples = static_cast<int>(std::lround(spacing_mm / kStep_mm));
        for (int k = 0; k < samples; ++k)
          hu[static_cast<std::size_t>(slices - 1 - i)] +=
              hu_at(i * spacing_mm + (k + 0.5) * kStep_mm) / samples;
      }
      scene.body->to = slices - 1;
      DryRun trial(scene, spaced_asset(slices, spacing_mm, hu));
      const double top_m = -trial.bone_.sheets.front().top_m;
      double entry_N = 0, exit_N = 0, plateau_N = 0, least_N = 1e9;
      int inside = 0;
      for (int step = 0; step < 1350; ++step) {
        const double way_m = -1e-3 + 20e-6 * step;
        trial.tick(0, top_m - way_m);
        const double depth_mm = 1e3 * (trial.state_.result.front_m + top_m),
                     tip_N = trial.state_.result.tip_N;
        if (!std::isfinite(depth_mm) || !(tip_N > 0)) continue;
        if (depth_mm < 3) entry_N = std::max(entry_N, tip_N);
        if (depth_mm > kHeight_mm - 3) exit_N = std::max(exit_N, tip_N);
        if (depth_mm < 4 || depth_mm > kHeight_mm - 4) continue;
        plateau_N += tip_N / N(hu_at(depth_mm));
        least_N = std::min(least_N, tip_N / N(hu_at(depth_mm)));
        ++inside;
      }
      const std::string where =
          std::to_string(wall_mm) + " mm in slices of " + std::to_string(spacing_mm);
      EXPECT_NEAR(entry_N / N(1200), 1, 0.08) << where;
      EXPECT_NEAR(exit_N / N(1200), 1, 0.08) << where;
      EXPECT_NEAR(plateau_N / inside, 1, 0.03) << where;
      EXPECT_GT(least_N, 0.8) << where;
    }
  }
}

// A scene can say that the strength follows the HU of each slice.
TEST(WallContact, WithoutCortexHuTheStrengthIsThatOfTheSlice) {
  Scene scene = body_scene(0, 4, 0.12);
  scene.tissue.cut = bone_by_hu();
  for (const double cortex_HU : {0.0, 1000.0}) {
    scene.body->cortex_HU = cortex_HU;
    DryRun trial(scene, spaced_asset(5, 2, {250, 250, 250, 250, 820}));
    trial.move(0, 0.122, 0, 0.1215);
    const CuttingSlab& first = trial.state_.slabs[0];
    EXPECT_EQ(first.upper_wall_to_m > first.top_m, cortex_HU > 0);
    EXPECT_EQ(first.lower_wall_from_m, std::numeric_limits<double>::infinity());
  }
}

// The coverage that the law `cutting` computes from the outline's distance and the holes, against that of the mesh.

// cut_in_place() moves edges by less than sqrt(2) lattice steps where a hole crosses the boundary of another hole.
constexpr double kBent = std::numbers::sqrt2 / 256e3 * test::kHexagonOutline_m / test::kHexagon_m2;

// Holes anywhere, near the edge (at 20 mm) and far from it, up to more than the law remembers; some are in the mesh
// and some are not yet.
TEST(CoverageContact, TheShareIsThatOfTheMeshAndThePendingHoles) {
  Random random(21);
  int partial = 0, checked = 0;
  for (int trial_number = 0; trial_number < 30; ++trial_number) {
    DryRun trial(cutting_scene({0.12}), square_asset(1));
    for (int hole = 0; hole < 7; ++hole) {
      const double x_m = 1e-3 * random.between(hole % 2 == 0 ? 5 : 12, hole % 2 == 0 ? 13 : 22);
      trial.move(x_m, 0.121, x_m, 0.117);
      trial.move(x_m, 0.117, x_m, 0.121);
      if (random.between(0, 1) == 0 || trial.tracks_.tracks[0].pending_count == kMaxPendingHoles)
        trial.publish();
      for (int k = 0; k < 20; ++k) {
        const double at_m = 5e-3 + 18e-3 * random.unit();
        trial.tick(at_m, 0.1205);
        Pose T;
        T.p_m = {at_m, 0, 0.1205};
        const SheetTrack& track = trial.tracks_.tracks[0];
        const Sheet& sheet = *trial.placed_.sheets[0];
        const double wanted =
            overlap(sheet, trial.bone_.tool,
                    outline_on_lattice(trial.bone_.tool, T, sheet.transform, sheet.z_m),
                    {track.pending.data(), static_cast<std::size_t>(track.pending_count)})
                .coverage;
        ASSERT_NEAR(trial.state_.sheets[0].share, wanted, kBent) << at_m << ", hole " << hole;
        partial += wanted > 0 && wanted < 1 ? 1 : 0;
        ++checked;
      }
    }
  }
  EXPECT_GT(partial, checked / 10);
}

// Which walls and which strength the law `cutting` gives the tool in a hole: in a hole elsewhere,
// in a hole entered again, and with a coupling that holds the tool far from the plate. (Contract of
// bone_contact.h.)

// The tool hovers beside the bone, over the topmost slices, before it drills elsewhere. What was
// free beside the bone is not free in the hole.
TEST(HoleContact, AHoleInSolidBoneHasItsWallsWhereverTheToolWasBefore) {
  const auto side_N = [](bool was_beside) {
    DryRun trial(walled(), spaced_asset(10, 1));
    if (was_beside) trial.move(25e-3, 0.121, 10e-3, 0.121);
    trial.move(10e-3, 0.121, 10e-3, 0.1171);
    trial.move(10e-3, 0.1171, 12e-3, 0.1171);
    return trial.side_N();
  };
  // 5 MPa over the width of 5.46 mm and the depth of 3.3 mm.
  EXPECT_LT(side_N(false), -80);
  EXPECT_NEAR(side_N(true), side_N(false), 1e-6);
}

TEST(HoleContact, AWallThatYieldsInAHoleEnteredAgainStaysWhereItWasPushed) {
  DryRun trial(walled(), spaced_asset(10, 1));
  trial.move(0, 0.121, 0, 0.1171);
  trial.publish();
  trial.move(0, 0.1171, 0, 0.121);
  // Beside the old axis by less than CuttingOptions::same_hole_m, so that little material is under
  // the tool.
  trial.move(0, 0.121, 30e-6, 0.121);
  trial.move(30e-6, 0.121, 30e-6, 0.1171);
  EXPECT_EQ(trial.sides_, 0);
  trial.move(30e-6, 0.1171, 3e-3, 0.1171);
  EXPECT_LT(trial.side_N(), -80) << "the walls have yielded";
  EXPECT_GT(trial.sides_, 0) << "and are cut";
  trial.move(3e-3, 0.1171, 1e-3, 0.1171);
  EXPECT_NEAR(trial.side_N(), 0, 1) << "they do not close behind the shaft";
}

TEST(HoleContact, AHoleEnteredAgainIsAsWideAsItWasLeft) {
  DryRun trial(walled(), spaced_asset(10, 1));
  trial.move(0, 0.121, 0, 0.1171);
  trial.move(0, 0.1171, 2.5e-3, 0.1171);  // the walls yield by 2 mm
  EXPECT_GT(trial.sides_, 0);
  trial.publish();
  trial.move(2.5e-3, 0.1171, 1e-3, 0.1171);
  trial.move(1e-3, 0.1171, 1e-3, 0.121);
  trial.move(1e-3, 0.121, 1e-3, 0.1171);
  for (const double x_m : {1.9e-3, 0.1e-3, 1e-3}) {
    trial.move(trial.state_.T_device_plate.p_m.x(), 0.1171, x_m, 0.1171);
    EXPECT_NEAR(trial.side_N(), 0, 1) << x_m;
  }
}

// The walls hold the needle while the hand pulls the plate so far aside that no bone is under the
// plate's tool.
TEST(HoleContact, ACoupledToolCutsTheBoneUnderItselfNotUnderThePlate) {
  DryRun trial(walled(), spaced_asset(10, 1), false);
  trial.move(16.3e-3, 0.121, 16.3e-3, 0.1172);
  trial.move(16.3e-3, 0.1172, 23.2e-3, 0.1172);
  EXPECT_LT(trial.state_.law.T_device_proxy.p_m.x(), 17e-3) << "the bone ends at 20 mm";
  const int fronts = trial.fronts_;
  trial.peak_N_ = 0;
  trial.move(23.2e-3, 0.1172, 23.2e-3, 0.1132);
  EXPECT_NEAR(trial.peak_N_, 0.2e6 * kHexagon_m2, 1e-3);
  EXPECT_EQ(trial.fronts_, fronts + 4);
}

// The bone's edge holds the needle in the air beside the bone, while the hand pushes the plate over
// the bone.
TEST(HoleContact, ACoupledToolBesideTheBoneIsNotStoppedByTheBoneUnderThePlate) {
  DryRun trial(walled(), spaced_asset(10, 1), false);
  trial.move(25e-3, 0.121, 25e-3, 0.117);
  trial.move(25e-3, 0.117, 17e-3, 0.117);
  EXPECT_GT(trial.state_.law.T_device_proxy.p_m.x(), 22.2e-3) << "it would touch at 22.7 mm";
  trial.peak_N_ = 0;
  trial.move(17e-3, 0.117, 17e-3, 0.113);
  EXPECT_LT(trial.peak_N_, 0.5) << "a corner of the tool is over the edge";
}

// The slope under a tip on bodies whose surface is known.

constexpr double kTop_m = 0.12;

/// Squares of 40 mm, the highest around the device's axis, each moved along x in mm. The z of a slice is that of its
/// middle.
class Body {
 public:
  Body(int slices, double spacing_mm, const std::function<double(int)>& shift_mm,
       double rotation_deg = 0, double half_angle_deg = 30)
      : spacing_m_(spacing_mm * 1e-3) {
    Asset asset = test::spaced_asset(slices, spacing_mm);
    for (int i = 0; i < slices; ++i)
      shift(asset, static_cast<std::size_t>(i),
            static_cast<int>(std::lround(256 * shift_mm(slices - 1 - i))));
    Scene scene = test::body_scene(0, slices - 1, kTop_m);
    scene.tool.kind = half_angle_deg < 90 ? "needle-conical" : "";
    scene.tool.half_angle_deg = half_angle_deg;
    scene.placement.anchor_mm = {80, 60};
    scene.placement.rotation_deg = rotation_deg;
    placed_.emplace(scene, asset);
    bone_ = *make_bone_volume(scene, placed_->sheets);
    turn_ = rotation_deg * std::numbers::pi / 180;
  }
  /// `x_mm`: along the body's x. `sheet`: counted from the top. The front is at the sheet's top.
  std::optional<Vector2d> slope(double x_mm, int sheet) const {
    const Vector2d at_m = 1e-3 * x_mm * along();
    return surface_slope(bone_, placed_->sheets, sheet, bone_.sheets[sheet].top_m, at_m);
  }
  Vector2d along() const { return {std::cos(turn_), std::sin(turn_)}; }

  double spacing_m_;
  std::optional<test::Placed> placed_;
  BoneVolume bone_;
  double turn_ = 0;
};

// Towards -x the slices reach further, the deeper they are.
TEST(SurfaceSlope, IsExactOnAPlane) {
  for (const double spacing_mm : {0.5, 1.0, 2.0}) {
    for (const double slope : {0.3, 0.5, 1.0, 1.5}) {
      for (const double rotation_deg : {0.0, 50.0, 200.0}) {
        const double run_mm = spacing_mm / slope;
        const Body body(
            12, spacing_mm, [&](int below) { return -run_mm * below; }, rotation_deg);
        // The edge of sheet k is at -20 - run * k, and the surface is half way between sheets 5 and 6.
        const double x_mm = -20 - run_mm * 5.5;
        const auto got = body.slope(x_mm, 6);
        ASSERT_TRUE(got) << spacing_mm << ", " << slope;
        EXPECT_NEAR((*got - -slope * body.along()).norm(), 0, 0.01 * slope)
            << spacing_mm << ", " << slope << ", " << rotation_deg;
        // A tool that touches a slice above with its rim feels the same plane.
        const auto rim = body.slope(x_mm, 5);
        ASSERT_TRUE(rim);
        EXPECT_NEAR((*rim - *got).norm(), 0, 0.01 * slope);
      }
    }
  }
}

// Outlines that move by whole pixels of 0.4 mm.
TEST(SurfaceSlope, IsCloseOnAPlaneOfWholePixels) {
  constexpr double kPixel_mm = 0.4;
  const Body body(16, 1,
                  [&](int below) { return -kPixel_mm * std::floor(below / kPixel_mm + 0.5); });
  for (int sheet = 4; sheet < 12; ++sheet) {
    for (int step = 1; step <= 8; ++step) {
      const double off_mm = 0.1 * step;
      const auto got = body.slope(-20 - sheet + off_mm, sheet);
      if (!got) continue;  // the tip is in the sheet above
      EXPECT_NEAR(got->x(), -1, 0.08) << sheet << ", " << off_mm;
    }
  }
}

TEST(SurfaceSlope, TheEndOfABodyIsLevelAndItsInsideHasNoSurface) {
  const Body body(10, 1, [](int) { return 0.0; });
  const auto top = body.slope(0, 0);
  ASSERT_TRUE(top);
  EXPECT_EQ(top->norm(), 0);
  EXPECT_FALSE(body.slope(0, 1));
  EXPECT_FALSE(body.slope(0, 9));
  EXPECT_FALSE(body.slope(-30, 0)) << "nothing is near";
}

TEST(SurfaceSlope, AWideStepIsLevel) {
  const Body body(10, 1, [](int below) { return below < 4 ? 0.0 : -12.0; });
  const auto step = body.slope(-27, 4);
  ASSERT_TRUE(step);
  EXPECT_EQ(step->norm(), 0);
}

// Beside a vertical side the face of the tip touches the rim. A flat tip has no face.
TEST(SurfaceSlope, BesideARimItIsThatOfTheTipsFace) {
  for (const auto& [half_angle_deg, wanted] :
       {std::pair{30.0, kMaxSlope}, {45.0, 1.0}, {90.0, 0.0}}) {
    const Body body(
        10, 1, [](int) { return 0.0; }, 0, half_angle_deg);
    const auto left = body.slope(-20.5, 0), right = body.slope(20.5, 0);
    ASSERT_TRUE(left && right);
    EXPECT_NEAR(left->x(), -wanted, 1e-6);
    EXPECT_NEAR(right->x(), wanted, 1e-6);
    EXPECT_NEAR(left->y(), 0, 1e-6);
    // The bottom of a body: nothing is below.
    const auto lowest = body.slope(-20.5, 9);
    ASSERT_TRUE(lowest);
    EXPECT_NEAR(lowest->x(), -wanted, 1e-6);
  }
}

}  // namespace
}  // namespace trocar::runtime
