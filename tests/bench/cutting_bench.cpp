// SPDX-License-Identifier: Apache-2.0
// cutting_bench: the cutting law. A tick in six motions; speed against error over the number of
// slabs, with one and two Gauss points a slab, and over the cap on Newton's steps; predicted beside
// published forces (published_forces.h).
#include <algorithm>
#include <cmath>
#include <numbers>

#include "runtime/haptics/bone/cutting_law.h"
#include "tests/bench/bench.h"
#include "tests/bench/published_forces.h"
#include "tests/support/body_slabs.h"

namespace trocar::bench {
namespace {

using namespace trocar::runtime;

constexpr double kLength_m = 0.1;
// With these a tick has converged.
constexpr int kReferenceSteps = 200;
constexpr double kReferenceTolerance = 1e-10;

CuttingOptions options(std::size_t wall_points = kMaxWallPoints) {
  CuttingOptions o;
  o.wall_points = wall_points;
  o.tool.tip_plate_m = {0, 0, -kLength_m};
  o.tool.radius_m = 1.5e-3;
  return o;
}
CuttingOptions converged(CuttingOptions o) {
  o.max_steps = kReferenceSteps;
  o.tolerance = kReferenceTolerance;
  return o;
}

/// 32 mm of cancellous bone whose density varies by `texture` over 12 mm.
std::vector<CuttingSlab> textured(int count, double texture) {
  std::vector<BodySlice> slices(static_cast<std::size_t>(count));
  const double spacing = 0.032 / count;
  for (int i = 0; i < count; ++i) {
    BodySlice& s = slices[static_cast<std::size_t>(i)];
    s.depth_m = (i + 0.5) * spacing;
    // The slice's value is the mean of its slab.
    const double k = 2 * std::numbers::pi / 0.012, half = 0.5 * k * spacing;
    s.strength_N = 20 * (1 + texture * std::sin(k * s.depth_m) * std::sin(half) / half);
    s.friction_N_per_m = 300;
    s.wall_N_per_m2 = 5e6;
    s.wall_strength_N_per_m = 2e4;
  }
  return make_slabs(slices);
}

struct Errors {
  double sum2 = 0, worst = 0, peak = 0, side2 = 0, side_peak = 0;
  int count = 0;
  void add(const Wrench& got, const Wrench& reference) {
    const Eigen::Vector3d error = (got - reference).head<3>();
    sum2 += error.squaredNorm();
    side2 += error.head<2>().squaredNorm();
    worst = std::max(worst, error.norm());
    peak = std::max(peak, reference.head<3>().norm());
    side_peak = std::max(side_peak, reference.head<2>().norm());
    ++count;
  }
  double rms() const { return std::sqrt(sum2 / count) / peak; }
  double side_rms() const { return std::sqrt(side2 / count) / side_peak; }
};

// ---- number of slabs: a whole run against one with the finest slabs ----

/// Down its own axis, then swayed in its hole below the strength of the walls.
Pose guided(int tick, int ticks) {
  const int half = ticks / 2;
  Pose X;
  const double in = std::min(1.0, static_cast<double>(tick) / half) * 0.027 - 0.002;
  const double t = std::max(0, tick - half) / static_cast<double>(half);
  X.q = from_rotation_vector({0, 0.02, 0});
  X.p_m = X.q * Eigen::Vector3d(0, 0, kLength_m - in);
  X.p_m.x() += 3e-4 * std::sin(12 * t);
  X.p_m.y() += 2e-4 * std::sin(9 * t);
  return X;
}

/// A hand that holds a point: the walls alone keep the tool from turning about it.
CuttingOptions guided_options(std::size_t points) {
  CuttingOptions o = options(points);
  o.coupling.translation_N_per_m = 2e5;
  o.coupling.rotation_Nm_per_rad = 0.2;
  return o;
}

int guided_ticks() {
  return quick ? 600 : 4000;
}

std::vector<Wrench> guided_run(const CuttingOptions& o, int slab_count, double texture) {
  const auto slabs = textured(slab_count, texture);
  CuttingState state = make_cutting_state(slabs.size(), 1);
  CuttingResult out;
  std::vector<Wrench> wrenches;
  for (int k = 0; k < guided_ticks(); ++k) {
    cutting_tick(o, guided(k, guided_ticks()), slabs, state, out);
    wrenches.push_back(out.wrench_device);
  }
  return wrenches;
}

/// A run's ticks, from its start again after its end.
template <typename PoseAt>
auto ticking(const CuttingOptions& o, const std::vector<CuttingSlab>& slabs,
             const CuttingState& start, int ticks, const PoseAt& pose_at) {
  return [=, state = start, out = CuttingResult(), k = 0]() mutable {
    if (k == ticks) {
      state = start;
      k = 0;
    }
    cutting_tick(o, pose_at(k++), slabs, state, out);
    benchmark::DoNotOptimize(out);
  };
}

void add_slabs() {
  constexpr double kTexture = 0.2;
  for (const std::size_t points : {std::size_t{2}, std::size_t{1}}) {
    for (const int count : {8, 16, 32, 64, 128}) {
      const CuttingOptions o = guided_options(points);
      const auto errors = [o, count] {
        // Bone without texture tells the walls' part: the force across the shaft.
        static const CuttingOptions exact = converged(guided_options(2));
        static const auto reference = guided_run(exact, 512, kTexture),
                          reference_even = guided_run(exact, 512, 0);
        Errors textured_bone, even;
        const auto got = guided_run(o, count, kTexture), got_even = guided_run(o, count, 0);
        for (std::size_t k = 0; k < got.size(); ++k) {
          textured_bone.add(got[k], reference[k]);
          even.add(got_even[k], reference_even[k]);
        }
        return Counters{{"error_force", textured_bone.rms()}, {"error_side", even.side_rms()}};
      };
      const auto slabs = textured(count, kTexture);
      add("cutting/slabs/" + std::string(points == 2 ? "two-points" : "midpoint") + "/" +
              std::to_string(count),
          benchmark::kMicrosecond,
          ticking(o, slabs, make_cutting_state(slabs.size(), 1), guided_ticks(),
                  [n = guided_ticks()](int k) { return guided(k, n); }),
          errors);
    }
  }
}

// ---- Newton's steps: each tick against a converged one from the same state ----
// (Over a run, errors of one tick would grow: a pushed tool is not stable sideways.)

/// Pushed, dragged sideways and turned, so that walls yield.
Pose dragged(int tick, int ticks) {
  const double t = 3.0 * tick / ticks, depth = 0.022 + 0.002 * t;
  Pose X;
  X.p_m = {0.002 * std::sin(3 * t), 0.001 * std::sin(2 * t), kLength_m - depth};
  X.q = from_rotation_vector({0.02 * std::sin(t), 0.01, 0.1 * std::sin(5 * t)});
  return X;
}

/// The state after the tool was pushed in to `X`.
CuttingState pushed_in(const CuttingOptions& o, const std::vector<CuttingSlab>& slabs, Pose X,
                       double way_m) {
  CuttingState state = make_cutting_state(slabs.size(), 2);
  CuttingResult out;
  const double deep = X.p_m.z();
  for (int k = 0; k <= 700; ++k) {
    X.p_m.z() = deep + way_m * (1 - k / 700.0);
    cutting_tick(o, X, slabs, state, out);
  }
  return state;
}

void add_steps() {
  const int ticks = quick ? 600 : 3000;
  const auto slabs = textured(64, 0.2);
  const CuttingOptions exact = converged(options());
  const CuttingState start = pushed_in(exact, slabs, dragged(0, ticks), 0.024);
  for (const int cap : {1, 2, 3, 5, 8, 12}) {
    CuttingOptions o = options();
    o.max_steps = cap;
    const auto errors = [=] {
      CuttingState state = start;
      CuttingResult out;
      Errors sum;
      for (int k = 0; k < ticks; ++k) {
        CuttingState tried = state;
        cutting_tick(o, dragged(k, ticks), slabs, tried, out);
        const Wrench wrench = out.wrench_device;
        cutting_tick(exact, dragged(k, ticks), slabs, state, out);
        sum.add(wrench, out.wrench_device);
      }
      return Counters{{"error_force", sum.rms()}, {"error_force_max", sum.worst / sum.peak}};
    };
    add("cutting/newton/two-points/" + std::to_string(cap) + "-steps", benchmark::kMicrosecond,
        ticking(o, slabs, start, ticks, [ticks](int k) { return dragged(k, ticks); }), errors);
  }
}

// ---- a tick in six motions ----

struct Motion {
  const char* name;
  double drag = 0, turn = 0;  ///< turn in rad
  bool bevel = false, slope = false, rests = false;
};

std::vector<CuttingSlab> layered() {
  std::vector<CuttingSlab> slabs(64);
  for (int i = 0; i < 64; ++i) {
    CuttingSlab& s = slabs[static_cast<std::size_t>(i)];
    s.top_m = i * 5e-4;
    s.bottom_m = (i + 1) * 5e-4;
    s.strength_top_N = s.strength_bottom_N = i < 4 ? 60 : 15;
    s.friction_N_per_m = 100;
    s.wall_N_per_m2 = 1e7;
    s.wall_strength_N_per_m = 1e4;
  }
  return slabs;
}

/// At 4 kHz, from 30 mm deep; the tool reaches the bottom.
Pose moved(const Motion& motion, int k) {
  const double t = k / 4000.0, depth = 0.030 + (motion.rests ? 0 : 0.004 * t);
  const double sway = motion.rests ? 2e-4 : 0.002 * motion.drag;
  Pose X;
  X.p_m = {sway * std::sin(3 * t), 0.001 * motion.drag * std::sin(2 * t), kLength_m - depth};
  X.q =
      from_rotation_vector({0.02 * motion.drag * std::sin(t), 0.01, motion.turn * std::sin(5 * t)});
  return X;
}

void add_motions() {
  constexpr int kTicks = 12'000;
  const auto slabs = layered();
  for (const Motion& motion :
       {Motion{"push"}, Motion{.name = "hold", .rests = true}, Motion{.name = "twist", .turn = 0.1},
        Motion{.name = "drag", .drag = 1, .turn = 0.1},
        Motion{.name = "drag-bevel", .drag = 1, .turn = 0.1, .bevel = true},
        Motion{.name = "drag-slope", .drag = 1, .turn = 0.1, .bevel = true, .slope = true}}) {
    CuttingOptions o;
    o.tool.tip_plate_m = {0, 0, -kLength_m};
    if (motion.bevel) {
      o.tip_friction = o.tip_hold = 0.3;
      o.torsion_Nm = 0.02;
      o.tool.bevel_plate = {0.4, 0, 0};
    }
    if (motion.slope) o.slope = Eigen::Vector2d(0.8, 0.3);
    add("tick/cutting-64-slabs/" + std::string(motion.name), benchmark::kMicrosecond,
        ticking(o, slabs, pushed_in(o, slabs, moved(motion, 0), 0.032), kTicks,
                [motion](int k) { return moved(motion, k); }));
  }
}

// ---- published forces ----

void add_published() {
  const auto rows = test::read_published_forces(TROCAR_PUBLISHED_FORCES);
  const test::WallPressure wall_pressure = test::fit(rows);
  for (const test::PublishedForce& row : rows) {
    std::string name = row.id;
    std::replace(name.begin(), name.end(), '/', '|');
    add(
        "published/" + name + "/" +
            (row.standing == test::Standing::kCounted  ? "counted"
             : row.standing == test::Standing::kFitted ? "fitted"
                                                       : "not-counted"),
        benchmark::kMicrosecond,
        [row, wall_pressure] { benchmark::DoNotOptimize(test::predict(row, wall_pressure)); },
        [row, wall_pressure] {
          const test::Prediction predicted = test::predict(row, wall_pressure);
          return Counters{{"error_of_mean", predicted.median / row.mean - 1},
                          {"predicted", predicted.median},
                          {"published_low", row.low},
                          {"published_mean", row.mean},
                          {"published_high", row.high},
                          {"is_hit", is_hit(row, predicted) ? 1.0 : 0.0}};
        });
  }
}

void add_all(const std::vector<Input>& /*inputs*/) {
  add_motions();
  add_slabs();
  add_steps();
  add_published();
}

}  // namespace
}  // namespace trocar::bench

int main(int argc, char** argv) {
  return trocar::bench::bench_main(argc, argv, trocar::bench::add_all);
}
