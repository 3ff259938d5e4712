// SPDX-License-Identifier: Apache-2.0
// What the force law `network` costs: on the haptic thread (a tick's solve with 200 free nodes),
// and off it (a region from sheet to answer, stage by stage; a whole slice's factorisation).
// Medians:
// --benchmark_repetitions=9 --benchmark_report_aggregates_only=true.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "runtime/contact/puncture.h"
#include "runtime/deformation/calibration.h"
#include "runtime/deformation/global_solver.h"
#include "runtime/deformation/propagation.h"
#include "runtime/deformation/response.h"
#include "runtime/mesh/triangle_grid.h"
#include "tests/support/deformation_fixture.h"
#include "tests/support/sheet_fixture.h"

namespace {

using namespace trocar;
using namespace trocar::runtime;

constexpr double kReach_m = 0.008;

SheetMesh sheet_of(const SliceMesh& mesh) {
  auto sheet = make_sheet_mesh(mesh, 0, 0);
  return std::move(*sheet);
}

/// A sheet of 0.4 m with 8 mm triangles, a hexagon of 3 mm in its middle, and a region of about
/// `free_nodes` free nodes around it.
struct Setting {
  Lattice lattice{8};
  SheetMesh sheet = sheet_of(test::square_mesh({-51200, -51200}, 2048, 50));
  Ring tool = test::regular_polygon({300, 500}, 768, 6, 0.2);
  std::vector<std::uint32_t> seeds = find_seeds(sheet, tool);
  Membrane membrane =
      calibrate(5000, kReach_m, test::regular_polygon({}, 768, 6), lattice)->membrane;
  ResponseOptions options;
  RegionWorkspace workspace;
  Region region;

  explicit Setting(std::uint32_t free_nodes) {
    options.error_bound = 0;
    for (double radius_m = 0.002;; radius_m += 0.0005) {
      options.region.radius_m = radius_m;
      auto found = prepare_region(sheet, seeds, tool, lattice, membrane, options, workspace);
      region = std::move(*found);
      if (region.response.free_nodes >= free_nodes) break;
    }
  }
};

/// Benchmarks are called several times each; what they look at is made once.
Setting& setting(std::int64_t free_nodes) {
  static std::map<std::int64_t, Setting> made;
  return made.try_emplace(free_nodes, static_cast<std::uint32_t>(free_nodes)).first->second;
}

void note(benchmark::State& state, const Setting& s) {
  state.counters["free_nodes"] = s.region.response.free_nodes;
  state.counters["factor_entries"] = static_cast<double>(s.region.solution.factor.entries());
}

// A load on every node.
void TickSolve(benchmark::State& state) {
  const Setting& s = setting(state.range(0));
  std::vector<double> x(s.region.solution.factor.size());
  while (state.KeepRunning()) {
    std::fill(x.begin(), x.end(), 1.0);
    s.region.solution.factor.solve(x);
    benchmark::DoNotOptimize(x.data());
  }
  note(state, s);
}
BENCHMARK(TickSolve)->Arg(100)->Arg(200)->Arg(400)->Unit(benchmark::kMicrosecond);

// The same with the loads gathered, the displacements spread and the tool's reaction summed.
struct Tick {
  std::vector<std::uint32_t> rim;
  std::vector<double> held_m, force_N, work, w_m;

  explicit Tick(const Region& region) {
    const std::size_t n = region.network.size();
    for (std::uint32_t i = 0; i < n; ++i) {
      if (region.mesh.kind[i] == NodeKind::kTool) rim.push_back(i);
    }
    held_m.resize(n);
    force_N.resize(n);
    w_m.resize(n);
    work.resize(region.solution.factor.size());
  }
  double force_at(const Region& region, double depth_m) {
    for (std::uint32_t i : rim)
      held_m[i] = depth_m;
    solve_general(region.network, region.mesh.kind, region.solution.factor, held_m, force_N, work,
                  w_m);
    double sum_N = 0;
    for (std::uint32_t i : rim)
      sum_N += reaction_N(region.network, w_m, i);
    return sum_N;
  }
};

void TickForceAndSolve(benchmark::State& state) {
  const Setting& s = setting(state.range(0));
  Tick tick(s.region);
  double depth_m = 1e-3;
  while (state.KeepRunning()) {
    benchmark::DoNotOptimize(tick.force_at(s.region, depth_m));
    depth_m += 1e-9;
  }
  note(state, s);
}
BENCHMARK(TickForceAndSolve)->Arg(200)->Unit(benchmark::kMicrosecond);

// And with the contact before it: outline, overlap, state machine, wrench.
void TickContactForceAndSolve(benchmark::State& state) {
  const Setting& s = setting(state.range(0));
  Tick tick(s.region);
  Sheet sheet;
  sheet.z_m = 0.12;
  sheet.transform.lattice = s.lattice;
  sheet.mesh = s.sheet;
  sheet.grid = TriangleGrid(sheet.mesh);
  const std::array<const Sheet*, 1> sheets{&sheet};
  ContactModel model;
  model.law = ForceLawKind::kNetwork;
  model.tool = make_tool(SceneTool{});
  ContactState contact;
  ContactOutput output;
  Pose T_device_plate;
  double depth_m = -1e-3;  // from above
  const auto meet = [&] {
    T_device_plate.p_m = {300 * s.lattice.step_m(), 500 * s.lattice.step_m(), sheet.z_m - depth_m};
    update_contact(model, sheets, {}, T_device_plate, model.dt_s, contact, output);
  };
  meet();
  depth_m = 1e-3;
  while (state.KeepRunning()) {
    meet();
    benchmark::DoNotOptimize(output);
    benchmark::DoNotOptimize(tick.force_at(s.region, depth_m));
  }
  if (output.phase != ContactPhase::kContact) state.SkipWithError("no contact");
  note(state, s);
}
BENCHMARK(TickContactForceAndSolve)->Arg(200)->Unit(benchmark::kMicrosecond);

void PrepareRegion(benchmark::State& state) {
  Setting& s = setting(state.range(0));
  while (state.KeepRunning()) {
    auto region =
        prepare_region(s.sheet, s.seeds, s.tool, s.lattice, s.membrane, s.options, s.workspace);
    benchmark::DoNotOptimize(region);
  }
  note(state, s);
}
BENCHMARK(PrepareRegion)->Arg(100)->Arg(200)->Unit(benchmark::kMicrosecond);

void PrepareRegionMesh(benchmark::State& state) {
  Setting& s = setting(200);
  while (state.KeepRunning()) {
    auto mesh = make_region(s.sheet, s.seeds, s.tool, s.lattice, s.options.region, s.workspace);
    benchmark::DoNotOptimize(mesh);
  }
  note(state, s);
}
BENCHMARK(PrepareRegionMesh)->Unit(benchmark::kMicrosecond);

void PrepareRegionNetwork(benchmark::State& state) {
  const Setting& s = setting(200);
  while (state.KeepRunning()) {
    auto network = make_network(s.region.mesh.mesh, s.lattice, s.membrane);
    benchmark::DoNotOptimize(network);
  }
  note(state, s);
}
BENCHMARK(PrepareRegionNetwork)->Unit(benchmark::kMicrosecond);

// What a cut in the sheet asks for once the mesh is there; the bounds are included.
void RefactorRegion(benchmark::State& state) {
  const Setting& s = setting(200);
  LocalSolution solution;
  while (state.KeepRunning()) {
    solve_local(s.region.network, s.region.mesh.kind, solution);
    benchmark::DoNotOptimize(solution);
  }
  note(state, s);
}
BENCHMARK(RefactorRegion)->Unit(benchmark::kMicrosecond);

void PrepareAuto(benchmark::State& state) {
  Setting& s = setting(200);
  ResponseOptions options = s.options;
  options.error_bound = 1.0 / static_cast<double>(state.range(0));
  std::uint32_t free_nodes = 0;
  while (state.KeepRunning()) {
    auto region =
        prepare_region(s.sheet, s.seeds, s.tool, s.lattice, s.membrane, options, s.workspace);
    free_nodes = region->response.free_nodes;
    benchmark::DoNotOptimize(region);
  }
  state.counters["free_nodes"] = free_nodes;
}
BENCHMARK(PrepareAuto)
    ->ArgName("one_in")
    ->Arg(10)
    ->Arg(100)
    ->Arg(1000)
    ->Unit(benchmark::kMicrosecond);

// A slice of 10,000 vertices, and of 40,000: factorisation and solution by Eigen.
void GlobalSolution(benchmark::State& state) {
  const auto cells = static_cast<int>(state.range(0));
  const Network network =
      make_network(test::triangular_mesh({0, 0}, 256, cells), Lattice{8}, {320, 5e6});
  std::vector<NodeKind> kind(network.size(), NodeKind::kFree);
  kind[network.size() / 2] = NodeKind::kTool;
  while (state.KeepRunning()) {
    auto solution = solve_global(network, kind);
    benchmark::DoNotOptimize(solution);
  }
  state.counters["free_nodes"] = static_cast<double>(network.size() - 1);
}
BENCHMARK(GlobalSolution)->Arg(100)->Arg(200)->Unit(benchmark::kMillisecond);

void PropagationTick(benchmark::State& state) {
  const Setting& s = setting(400);
  const PropagationPlan plan = plan_propagation(s.region.network, s.region.mesh.kind,
                                                {.depth = static_cast<int>(state.range(0))});
  PropagationState moving = make_propagation_state(s.region.network, plan);
  double depth_m = 1e-3;
  while (state.KeepRunning()) {
    benchmark::DoNotOptimize(propagate(s.region.network, plan, depth_m, moving));
    depth_m += 1e-9;
  }
  state.counters["active_nodes"] = static_cast<double>(plan.active.size());
}
BENCHMARK(PropagationTick)->DenseRange(1, 12)->Unit(benchmark::kMicrosecond);

}  // namespace

BENCHMARK_MAIN();
