// SPDX-License-Identifier: Apache-2.0
// What the haptic thread needs of the cutting law: no allocation, the same bits for the same input,
// a bound on what a tick computes.
#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "runtime/realtime/realtime_thread.h"
#include "tests/runtime/haptics/bone/cutting_fixture.h"
#include "tests/support/counted_allocations.h"

namespace trocar::runtime {
namespace {

Bench body_of_64() {
  Bench b(even_slabs(64, 5e-4, 15), 3);
  for (CuttingSlab& slab : b.slabs) {
    slab.friction_N_per_m = 100;
    slab.wall_N_per_m2 = 1e7;
    slab.wall_strength_N_per_m = 1e4;
  }
  b.options.tool.tip_plate_m = {0, 0, -0.1};
  b.options.coupling.max_force_N = 60;
  return b;
}

// The scene has two soft layers over the bone, and friction of the tip.
Bench soft_body_of_64() {
  static const std::array<SoftLayer, 2> layers{{{.top_m = -0.002,
                                                 .bottom_m = 0.002,
                                                 .stiffness_N_per_m = 500,
                                                 .stiffening_N_per_m2 = 2e5,
                                                 .puncture_N = 5,
                                                 .cutting_N = 1,
                                                 .friction_N_per_m = 100},
                                                {.top_m = 0.004,
                                                 .bottom_m = 0.0045,
                                                 .stiffness_N_per_m = 150,
                                                 .stiffening_N_per_m2 = 1e4,
                                                 .puncture_N = 0.6,
                                                 .cutting_N = 0.1}}};
  Bench b = body_of_64();
  b.options.tip_friction = 0.3;
  b.options.layers = layers;
  b.state = make_cutting_state(b.slabs.size(), 3, layers.size());
  return b;
}

// Down, sideways, out and in again at three places.
Pose pose_at(int k) {
  const double t = 1e-3 * k, depth = 0.04 * std::abs(std::sin(3 * t)) - 0.003;
  Pose X = plate_at(0.005 * std::floor(t / 1.1) + 0.002 * std::sin(9 * t), depth - 0.1,
                    0.05 * std::sin(2 * t));
  X.q = from_rotation_vector({0, 0, 0.3 * std::sin(7 * t)}) * X.q;
  return X;
}

TEST(CuttingTick, AllocatesNothing) {
  TROCAR_NEEDS_COUNTED_ALLOCATIONS();
  for (Bench b : {body_of_64(), soft_body_of_64()}) {
    const std::uint64_t before = allocations_in_scopes();
    int entered = 0, punctured = 0;
    {
      const NoAllocationScope scope;
      for (int k = 0; k < 4000; ++k) {
        const int hole = b.state.hole;
        b.tick(pose_at(k));
        entered += hole < 0 && b.state.hole >= 0;
        punctured += b.out.layer_cut_J > 0;
      }
    }
    EXPECT_EQ(allocations_in_scopes(), before);
    EXPECT_GE(entered, 4);
    EXPECT_EQ(punctured > 0, !b.options.layers.empty());
  }
}

TEST(CuttingTick, SameInputSameBits) {
  Bench a = soft_body_of_64(), b = soft_body_of_64();
  for (int k = 0; k < 3000; ++k) {
    a.tick(pose_at(k));
    b.tick(pose_at(k));
    for (int i = 0; i < 6; ++i)
      ASSERT_EQ(a.out.wrench_device[i], b.out.wrench_device[i]);
    ASSERT_EQ(a.out.stored_J, b.out.stored_J);
    ASSERT_EQ(a.out.front_m, b.out.front_m);
  }
}

TEST(CuttingTick, StepsAreBounded) {
  Bench b = body_of_64();
  int most = 0, evaluations = 0;
  for (int k = 0; k < 4000; k += 7) {  // 7 ms a tick: every one is hard
    b.tick(pose_at(k));
    most = std::max(most, b.out.steps);
    evaluations = std::max(evaluations, b.out.evaluations);
    ASSERT_TRUE(b.out.wrench_device.allFinite());
  }
  EXPECT_GT(most, 5);
  EXPECT_LE(most, b.options.max_steps);
  EXPECT_LE(evaluations, 13 * b.options.max_steps + 30);
}

}  // namespace
}  // namespace trocar::runtime
