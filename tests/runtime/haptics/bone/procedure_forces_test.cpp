// SPDX-License-Identifier: Apache-2.0
// The forces of the procedures' tools in bone of the published densities, against the published forces.
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "formats/session/procedures.h"
#include "runtime/haptics/bone/bone_volume.h"
#include "tests/support/body_fixture.h"

namespace trocar::runtime {
namespace {

struct Forces {
  double tip_N = 0, shaft_N_per_m = 0;
};

/// In uniform bone of a QCT density in g/cm^3, as a scene makes them.
Forces forces_of(std::string_view name, Strength strength, double density) {
  Scene scene = test::body_scene(0, 9, 0.12);
  scene.hand.trajectory.front().tip_m = {0, 0, 0.5};
  EXPECT_TRUE(apply_procedure(*find_procedure(name), strength, scene));
  EXPECT_TRUE(resolve_layers(scene));
  const double hu = density / BoneByHu{}.per_HU;
  const BoneVolume bone =
      test::bone_volume_of(scene, test::spaced_asset(10, 1, std::vector<double>(10, hu)));
  return {bone.sheets[3].strength_N(bone.shape, hu),
          bone.slabs[bone.sheets[3].first_slab].friction_N_per_m};
}

// Abstract of CORS 2013-220: 90 N, SD assumed 35 %; bone of a volume fraction of 0.209.
TEST(ProcedureForces, APedicleProbeNeedsThePublishedForce) {
  const double density = 0.598 * 1.9 * 0.209;
  const double N = forces_of("pedicle-probe", Strength::kMedian, density).tip_N;
  EXPECT_GT(N, 58.5);
  EXPECT_LT(N, 121.5);
  EXPECT_LT(forces_of("pedicle-probe", Strength::kLow, density).tip_N, 58.5);
  EXPECT_GT(forces_of("pedicle-probe", Strength::kHigh, density).tip_N, 121.5);
}

// Mulligan et al. 2010: 1,000 N, SD assumed 35 %, 25 mm deep, in bone of 0.30 g/cm^3. The friction's factor was fitted on it.
TEST(ProcedureForces, AJamshidiNeedleNeedsThePublishedForce) {
  const Forces forces = forces_of("jamshidi-8g", Strength::kMedian, 0.3);
  const double N = forces.tip_N + 0.025 * forces.shaft_N_per_m;
  EXPECT_GT(N, 650);
  EXPECT_LT(N, 1350);
}

// A needle through the back: each layer gives a few newtons, and the ligamentum flavum more than the dura.
TEST(ProcedureForces, TheLayersOfTheBackBreakInTheOrderOfTheirToughness) {
  for (const char* name : {"spinal-needle", "tuohy-needle"}) {
    double before_N = 0;
    for (const Strength strength : {Strength::kLow, Strength::kMedian, Strength::kHigh}) {
      Scene scene = test::body_scene(0, 9, 0.12);
      scene.hand.trajectory.front().tip_m = {0, 0, 0.5};
      ASSERT_TRUE(apply_procedure(*find_procedure(name), strength, scene));
      ASSERT_TRUE(resolve_layers(scene));
      ASSERT_EQ(scene.layers.size(), 5U);
      for (const SceneLayer& layer : scene.layers) {
        EXPECT_GT(layer.puncture_N, 0.1) << name << ", " << layer.name;
        EXPECT_LT(layer.puncture_N, 25) << name << ", " << layer.name;
        EXPECT_NEAR(layer.cutting_N, 0.61 * layer.puncture_N, 1e-9);
      }
      EXPECT_GT(scene.layers[3].puncture_N, scene.layers[4].puncture_N);
      EXPECT_GT(scene.layers[3].puncture_N, before_N);
      before_N = scene.layers[3].puncture_N;
    }
  }
}

}  // namespace
}  // namespace trocar::runtime
