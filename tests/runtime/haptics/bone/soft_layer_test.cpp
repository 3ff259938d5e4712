// SPDX-License-Identifier: Apache-2.0
// Soft layers over the bone, against closed forms (contract of soft_layer.h). Their energy is in
// cutting_energy_test.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "tests/runtime/haptics/bone/cutting_fixture.h"

namespace trocar::runtime {
namespace {

// Ligamentum flavum: 11 N at 6.12 mm, where 500 z + 2.12e5 z^2 = 3.06 + 7.94.
SoftLayer ligament() {
  SoftLayer layer;
  layer.bottom_m = 0.004;
  layer.stiffness_N_per_m = 500;
  layer.stiffening_N_per_m2 = 2.12e5;
  layer.puncture_N = 11;
  layer.cutting_N = 2;
  layer.friction_N_per_m = 200;
  return layer;
}
SoftLayer dura() {
  SoftLayer layer;
  layer.bottom_m = 4e-4;
  layer.stiffness_N_per_m = 150;
  layer.stiffening_N_per_m2 = 1e4;
  layer.puncture_N = 0.6;
  layer.cutting_N = 0.1;
  return layer;
}
SoftLayer at_depth(SoftLayer layer, double top_m) {
  layer.bottom_m += top_m - layer.top_m;
  layer.top_m = top_m;
  return layer;
}

struct SoftBench : Bench {
  std::vector<SoftLayer> layers;
  SoftBench(std::vector<SoftLayer> soft, double bone_m, double bone_N = 60)
      : Bench(even_slabs(10, 1e-3, bone_N)), layers(std::move(soft)) {
    for (CuttingSlab& slab : slabs) {
      slab.top_m += bone_m;
      slab.bottom_m += bone_m;
    }
    options.layers = layers;
    state = make_cutting_state(slabs.size(), 4, layers.size());
  }
  void push(double from, double to, double step = 1e-5) {
    move(plate_at(0, from), plate_at(0, to), step);
  }
};

TEST(SoftLayer, StiffensAsItsClosedFormUntilThePuncture) {
  for (const bool is_rigid : {true, false}) {
    for (const double step : {1e-5, 1e-4, 1e-3}) {
      SoftBench b({ligament()}, 0.05);
      b.options.coupling.is_rigid = is_rigid;
      const SoftLayer& layer = b.layers[0];
      const double z_puncture = (-500 + std::sqrt(500 * 500 + 4 * 2.12e5 * 11)) / (2 * 2.12e5);
      EXPECT_NEAR(stretch_at(layer, 11), z_puncture, 1e-12);
      const double at_puncture = z_puncture + (is_rigid ? 0 : 11.0 / 4000);
      double peak = 0, at_peak = 0;
      b.move(plate_at(0, -0.002), plate_at(0, 0.01), step,
             [&](const CuttingResult& out, const Pose& X) {
               const double F = out.wrench_device[2], depth = -X.p_m.z();
               if (depth < 0) {
                 EXPECT_EQ(F, 0);
               }
               if (depth > 0 && depth < at_puncture - 1e-9) {
                 const double z = is_rigid ? depth : depth - F / 4000;
                 EXPECT_NEAR(F, 500 * z + 2.12e5 * z * z, 1e-5) << depth;
               }
               if (F > peak) peak = F, at_peak = depth;
             });
      EXPECT_LE(peak, 11 + 1e-6);
      const double steepest = 500 + 2 * 2.12e5 * z_puncture;
      EXPECT_GE(peak, 11 - steepest * step - 1e-6);
      EXPECT_NEAR(at_peak, at_puncture, step + 1e-9);
    }
  }
}

// After it the cutting force and the friction of what is cut, until the bottom; then friction only.
TEST(SoftLayer, IsCutWithFrictionAfterThePuncture) {
  SoftLayer layer = ligament();
  layer.bottom_m = 0.02;
  SoftBench b({layer}, 0.1);
  b.push(-0.002, 0.0105, 1e-5);
  ASSERT_TRUE(b.state.layers[0].is_punctured);
  double work = 0, last_cut = 0;
  b.move(plate_at(0, 0.0105), plate_at(0, 0.04), 1e-5, [&](const CuttingResult& out, const Pose&) {
    const double cut = b.state.layers[0].cut_m;
    if (cut < 0.02 - 1e-9) {
      EXPECT_NEAR(out.layer_N, 2, 1e-5);
      EXPECT_NEAR(out.wrench_device[2], 2 + 200 * cut, 2e-2);
      if (last_cut > 0) {
        EXPECT_NEAR(out.layer_cut_J, 2 * (cut - last_cut), 1e-10);
      }
      last_cut = cut;
      work += out.layer_cut_J;
    } else {
      EXPECT_EQ(out.layer_N, 0);
    }
  });
  EXPECT_NEAR(b.out.wrench_device[2], 200 * 0.02, 1e-4);
  EXPECT_GT(work, 0.8 * 2 * 0.01);
}

// The hole outlives withdrawal; beside it the layer is whole.
TEST(SoftLayer, RemembersItsHoles) {
  SoftBench b({ligament()}, 0.05);
  b.options.tool.radius_m = 5e-4;
  const auto peak = [&](double x) {
    double most = 0;
    b.move(plate_at(x, -0.002), plate_at(x, 0.015), 2e-5,
           [&](const CuttingResult& out, const Pose&) { most = std::max(most, out.layer_N); });
    b.move(plate_at(x, 0.015), plate_at(x, -0.002), 2e-5);
    EXPECT_LT(b.out.stored_J, 1e-15);
    EXPECT_EQ(b.out.wrench_device.norm(), 0);
    return most;
  };
  EXPECT_NEAR(peak(0), 11, 0.1);
  EXPECT_EQ(peak(0), 0);
  EXPECT_EQ(peak(3e-4), 0);  // within the tool's radius
  EXPECT_NEAR(peak(0.005), 11, 0.1);
  EXPECT_EQ(peak(0), 0);
  EXPECT_EQ(peak(0.005), 0);
}

// Withdrawn before the puncture a layer is as it was.
TEST(SoftLayer, IsElasticBeforeThePuncture) {
  SoftBench b({ligament()}, 0.05);
  for (int again = 0; again < 3; ++again) {
    b.push(-0.002, 0.006, 1e-4);
    EXPECT_GT(b.out.wrench_device[2], 4);
    EXPECT_NEAR(b.out.layer_N, b.out.wrench_device[2], 1e-5);
    b.push(0.006, -0.002, 1e-4);
    EXPECT_EQ(b.out.wrench_device[2], 0);
  }
  EXPECT_FALSE(b.state.layers[0].is_punctured);
  EXPECT_EQ(b.cut_J, 0);
}

// Lumbar puncture: ligament of 4 mm, 5 mm of epidural space, the dura, 10 mm on a vertebral body.
TEST(SoftLayer, LayersInSeriesOverBone) {
  SoftBench b({ligament(), at_depth(dura(), 0.009)}, 0.019, 60);
  b.options.coupling.is_rigid = true;
  std::vector<double> peaks;
  double before = 0;
  bool has_fallen = true;
  double ligament_at = 0, dura_at = 0, bone_at = 0;
  b.move(plate_at(0, -0.001), plate_at(0, 0.0235), 1e-5,
         [&](const CuttingResult& out, const Pose& X) {
           const double F = out.layer_N + out.tip_N, depth = -X.p_m.z();
           if (has_fallen && F < before - 0.3 && before > 0) {
             peaks.push_back(before);
             (peaks.size() == 1 ? ligament_at : dura_at) = depth;
             has_fallen = false;
           }
           has_fallen = has_fallen || F > before;
           if (bone_at == 0 && out.tip_N > 0) bone_at = depth;
           before = F;
         });
  ASSERT_EQ(peaks.size(), 2U);
  EXPECT_NEAR(peaks[0], 11, 0.05);
  EXPECT_NEAR(ligament_at, stretch_at(b.layers[0], 11), 2e-5);
  EXPECT_NEAR(peaks[1], 0.6, 0.01);
  EXPECT_NEAR(dura_at, 0.009 + stretch_at(b.layers[1], 0.6), 2e-5);
  // The bone begins where it is, not where a soft tip would have it.
  EXPECT_NEAR(bone_at, 0.019, 2e-5);
  EXPECT_NEAR(b.out.tip_N, 60, 1e-6);
}

// A ligament that fails at 6 mm over a dura at 4.5 mm: the dura tears with it, by what stretched
// the ligament.
TEST(SoftLayer, AThinLayerCloseBehindIsTornToo) {
  SoftLayer close = at_depth(dura(), 0.0045);
  SoftBench b({ligament(), close}, 0.1);
  b.options.coupling.is_rigid = true;
  b.push(-0.001, 0.0058, 1e-5);
  EXPECT_FALSE(b.state.layers[0].is_punctured);
  // Stretched by 1.3 mm: 0.21 N of its 0.6, but only through the ligament.
  EXPECT_NEAR(b.out.layer_N,
              soft_spring(b.layers[0], 0.0058).force_N + soft_spring(close, 0.0013).force_N, 1e-9);
  close.puncture_N = 0.2;
  b.layers[1] = close;
  b.push(0.0058, 0.0059, 1e-5);
  EXPECT_FALSE(b.state.layers[1].is_punctured);  // the ligament holds
  std::uint64_t punctured = 0;
  b.move(plate_at(0, 0.0059), plate_at(0, 0.0063), 1e-5,
         [&](const CuttingResult& out, const Pose&) {
           EXPECT_EQ(punctured & out.layers_punctured, 0U) << "reported twice";
           punctured |= out.layers_punctured;
         });
  EXPECT_EQ(punctured, 0b11U);
  EXPECT_TRUE(b.state.layers[0].is_punctured);
  EXPECT_TRUE(b.state.layers[1].is_punctured);
}

// On bone that holds, a layer is squeezed until all that presses on it punctures it.
TEST(SoftLayer, IsPuncturedAgainstTheBone) {
  SoftBench b({ligament()}, 0.004);
  double most = 0;
  b.move(plate_at(0, -0.002), plate_at(0, 0.025), 1e-5, [&](const CuttingResult& out, const Pose&) {
    if (!b.state.layers[0].is_punctured) most = std::max(most, out.layer_N + out.tip_N);
  });
  EXPECT_NEAR(most, 11, 0.05);
  EXPECT_EQ(b.state.layers[0].cut_m, 0.004);
  EXPECT_EQ(b.out.layer_N, 0);
  EXPECT_NEAR(b.out.tip_N, 60, 1e-5);
}

// The same motion with no layers, and with layers that are never reached: the same bits.
TEST(SoftLayer, ChangeNothingWhereTheyAreNot) {
  SoftBench with({at_depth(ligament(), 0.2)}, 0), without({}, 0);
  for (int k = 0; k < 3000; ++k) {
    const Pose X = plate_at(1e-3 * std::sin(0.01 * k), 0.008 * std::sin(0.002 * k), 0.02);
    with.tick(X);
    without.tick(X);
    ASSERT_EQ(with.out.wrench_device, without.out.wrench_device);
    ASSERT_EQ(with.out.stored_J, without.out.stored_J);
  }
}

}  // namespace
}  // namespace trocar::runtime
