// SPDX-License-Identifier: Apache-2.0
// cutting_bench [Google Benchmark's options]: a tick of the cutting law in a body of 64 slabs that
// the shaft fills, in six motions; in the last two a bevelled tip has friction and is held by the
// bone, once on a slope. Ends with two tables: quantiles of the ticks' times, and error
// against the cap on Newton's steps.
//
// A tick is timed four times from the same state and the least counts, so that interrupts and
// stalls of a virtual machine's host do not show; the caches are warm. Such a machine is also
// slower for seconds at a time: each motion is run in five rounds. The quantiles are those of the
// round with the least median; the medians of the other rounds stand beside them.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <vector>

#include "runtime/bone_cutting/law/cutting_law.h"

namespace trocar::bench {
namespace {

using namespace trocar::runtime;

constexpr int kTicks = 12'000;
constexpr double kRate_Hz = 4000, kLength_m = 0.1;

enum class Motion { kPush, kHold, kTwist, kDrag, kBevel, kSlope };
constexpr std::array<const char*, 6> kNames{"push",
                                            "hold below yield",
                                            "push and twist",
                                            "push, drag, twist",
                                            "the same with a bevel",
                                            "the same on a slope"};

bool drags(Motion motion) {
  return motion != Motion::kPush && motion != Motion::kHold && motion != Motion::kTwist;
}

CuttingOptions options(Motion motion) {
  CuttingOptions o;
  o.tool.tip_plate_m = {0, 0, -kLength_m};
  if (motion == Motion::kBevel || motion == Motion::kSlope) {
    o.tip_friction = o.tip_hold = 0.3;
    o.torsion_Nm = 0.02;
    o.tool.bevel_plate = {0.4, 0, 0};
  }
  if (motion == Motion::kSlope) o.slope = Eigen::Vector2d(0.8, 0.3);
  return o;
}

std::vector<CuttingSlab> body() {
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

// The tool is first pushed in 25 mm; then the motion, during which it reaches the bottom.
Pose pose_at(Motion motion, int k) {
  const double t = k / kRate_Hz, depth = 0.030 + (motion == Motion::kHold ? 0 : 0.004 * t);
  const double drag = drags(motion) ? 1 : 0,
               turn = motion == Motion::kTwist || drags(motion) ? 0.1 : 0;
  const double sway = motion == Motion::kHold ? 2e-4 : 0.002 * drag;
  Pose X;
  X.p_m = {sway * std::sin(3 * t), 0.001 * drag * std::sin(2 * t), kLength_m - depth};
  X.q = from_rotation_vector({0.02 * drag * std::sin(t), 0.01, turn * std::sin(5 * t)});
  return X;
}

struct Run {
  CuttingOptions o;
  std::vector<CuttingSlab> slabs = body();
  CuttingState state = make_cutting_state(64, 2);
  CuttingResult out;
  explicit Run(Motion motion) : o(options(motion)) {
    const Pose first = pose_at(motion, 0);
    for (int k = 0; k <= 700; ++k) {
      Pose X = first;
      X.p_m.z() += 0.032 * (1 - k / 700.0);
      tick(X);
    }
  }
  void tick(const Pose& X) { cutting_tick(o, X, slabs, state, out); }
};

void law_tick(benchmark::State& state) {
  const auto motion = static_cast<Motion>(state.range(0));
  Run run(motion);
  int k = 0;
  while (state.KeepRunning()) {
    run.tick(pose_at(motion, k));
    k = (k + 1) % kTicks;
    benchmark::DoNotOptimize(run.out);
  }
  state.SetLabel(kNames[static_cast<std::size_t>(state.range(0))]);
}
BENCHMARK(law_tick)->DenseRange(0, 5);

struct Round {
  std::vector<double> us;  // ascending
  double evaluations = 0;  // a tick
  double at(double share) const {
    return us[static_cast<std::size_t>(share * static_cast<double>(us.size() - 1))];
  }
};

Round time_ticks(Motion motion) {
  Run run(motion);
  Round out;
  for (int k = 0; k < kTicks; ++k) {
    const Pose X = pose_at(motion, k);
    const CuttingState before = run.state;
    double least = 1e9;
    for (int pass = 0; pass < 4; ++pass) {
      run.state = before;
      const auto start = std::chrono::steady_clock::now();
      run.tick(X);
      const std::chrono::duration<double, std::micro> took =
          std::chrono::steady_clock::now() - start;
      least = std::min(least, took.count());
    }
    out.us.push_back(least);
    out.evaluations += static_cast<double>(run.out.evaluations) / kTicks;
  }
  std::sort(out.us.begin(), out.us.end());
  return out;
}

void print_quantiles() {
  constexpr std::array<Motion, 6> kMotions{Motion::kPush, Motion::kHold,  Motion::kTwist,
                                           Motion::kDrag, Motion::kBevel, Motion::kSlope};
  std::array<std::vector<Round>, kMotions.size()> rounds;
  for (int k = 0; k < 5; ++k) {
    for (const Motion motion : kMotions)
      rounds[static_cast<std::size_t>(motion)].push_back(time_ticks(motion));
  }
  std::printf("\n%-20s %8s %8s %8s %8s %12s   %s\n", "64 slabs", "p50 us", "p99", "p99.9", "most",
              "evaluations", "p50 of the other rounds");
  for (const Motion motion : kMotions) {
    auto& of = rounds[static_cast<std::size_t>(motion)];
    std::sort(of.begin(), of.end(),
              [](const Round& a, const Round& b) { return a.at(0.5) < b.at(0.5); });
    std::printf("%-22s %8.2f %8.2f %8.2f %8.2f %12.2f  ", kNames[static_cast<std::size_t>(motion)],
                of[0].at(0.5), of[0].at(0.99), of[0].at(0.999), of[0].at(1), of[0].evaluations);
    for (std::size_t k = 1; k < of.size(); ++k)
      std::printf(" %.2f", of[k].at(0.5));
    std::printf("\n");
  }
}

// Each tick's error against one from the same state with 200 steps and a tolerance of 1e-10, over
// the peak force. (Over a run, errors of one tick would grow: a tool that is pushed along a path is
// not stable sideways.)
void print_errors() {
  std::printf("\n%-20s %8s %10s %10s %10s\n", "dragged at 1 kHz", "steps", "p50", "p99", "worst");
  for (const int cap : {1, 2, 3, 5, 8, 12}) {
    Run run(Motion::kDrag);
    std::vector<double> errors;
    double peak = 0;
    for (int k = 0; k < kTicks; k += 4) {
      const Pose X = pose_at(Motion::kDrag, k);
      const CuttingState before = run.state;
      run.o.max_steps = cap;
      run.o.tolerance = 1e-6;
      run.tick(X);
      const Wrench w = run.out.wrench_device;
      run.state = before;
      run.o.max_steps = 200;
      run.o.tolerance = 1e-10;
      run.tick(X);
      errors.push_back((w - run.out.wrench_device).head<3>().norm());
      peak = std::max(peak, run.out.wrench_device.head<3>().norm());
    }
    std::sort(errors.begin(), errors.end());
    const auto at = [&](double share) {
      return errors[static_cast<std::size_t>(share * static_cast<double>(errors.size() - 1))] /
             peak;
    };
    std::printf("%-20s %8d %10.2g %10.2g %10.2g\n", "", cap, at(0.5), at(0.99), at(1));
  }
}

}  // namespace
}  // namespace trocar::bench

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
  benchmark::RunSpecifiedBenchmarks();
  trocar::bench::print_quantiles();
  trocar::bench::print_errors();
  return 0;
}
