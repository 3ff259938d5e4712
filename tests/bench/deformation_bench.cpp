// SPDX-License-Identifier: Apache-2.0
// What the force law `network` costs: a region from sheet to response, stage by stage; a whole
// slice's factorisation; one solve with 200 free nodes. Medians:
// --benchmark_repetitions=9 --benchmark_report_aggregates_only=true.
//
// The table at the end compares sparse_factor with Eigen's SimplicialLDLT in the same run, call by
// call in turn: factorisation and solve alone, and the times for which a user waits. The table
// alone: --benchmark_filter=none.
#include <benchmark/benchmark.h>

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <ctime>
#include <map>
#include <span>
#include <utility>
#include <vector>

#include "runtime/contact/puncture.h"
#include "runtime/deformation/calibration.h"
#include "runtime/deformation/propagation.h"
#include "runtime/deformation/response.h"
#include "runtime/sheet_mesh/triangle_grid.h"
#include "tests/reference/deformation/general_load.h"
#include "tests/reference/deformation/global_solver.h"
#include "tests/reference/deformation/region_part.h"
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

/// A benchmark is called several times; its input is made once.
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
  sheet.index_mesh();
  const std::array<const Sheet*, 1> sheets{&sheet};
  ContactModel model;
  model.uses_prefetched_stiffness = true;
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

// After a cut, on a mesh that exists: the solution and its bounds.
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

// --- sparse_factor beside Eigen's SimplicialLDLT ---

/// The free nodes' matrix, factored by Eigen in its order of approximate minimum degree.
struct EigenFactor {
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>, Eigen::Lower> ldlt;
  std::vector<std::uint32_t> nodes;  ///< node of each unknown

  bool make(const Network& network, std::span<const NodeKind> kind) {
    nodes.clear();
    std::vector<int> unknown(network.size(), -1);
    for (std::uint32_t i = 0; i < network.size(); ++i) {
      if (kind[i] != NodeKind::kFree) continue;
      unknown[i] = static_cast<int>(nodes.size());
      nodes.push_back(i);
    }
    const auto n = static_cast<int>(nodes.size());
    Eigen::SparseMatrix<double> matrix(n, n);
    matrix.reserve(static_cast<Eigen::Index>(nodes.size() + network.neighbour.size() / 2));
    for (int u = 0; u < n; ++u) {
      const std::uint32_t i = nodes[static_cast<std::size_t>(u)];
      double diagonal = network.foundation_N_per_m[i];
      for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k)
        diagonal += network.stiffness_N_per_m[k];
      matrix.startVec(u);
      matrix.insertBack(u, u) = diagonal;
      for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k) {
        if (const int v = unknown[network.neighbour[k]]; v > u)
          matrix.insertBack(v, u) = -network.stiffness_N_per_m[k];
      }
    }
    matrix.finalize();
    ldlt.compute(matrix);
    return ldlt.info() == Eigen::Success;
  }
};

double thread_us() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e6 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_nsec);
}

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

/// Median CPU times of both in us, called in turn.
struct Pair {
  double ours_us = 0, eigen_us = 0;
};
template <typename Ours, typename Eigens>
Pair in_turn(int repetitions, Ours&& ours, Eigens&& eigens) {
  std::vector<double> ours_us, eigen_us;
  for (int i = 0; i < repetitions; ++i) {
    const double start = thread_us();
    ours();
    const double middle = thread_us();
    eigens();
    ours_us.push_back(middle - start);
    eigen_us.push_back(thread_us() - middle);
  }
  return {median(ours_us), median(eigen_us)};
}

void print_row(const char* what, std::size_t free_nodes, const Pair& t) {
  std::printf("%-58s %9zu %11.1f %11.1f %9.2f\n", what, free_nodes, t.ours_us, t.eigen_us,
              t.eigen_us / t.ours_us);
}

struct Comparison {
  std::size_t free_nodes = 0;
  Pair factor, solve;
  double difference = 0;  ///< largest relative one of the two solutions
};

/// False if the solutions differ by more than rounding: then the times mean nothing.
bool compare(const Network& network, std::span<const NodeKind> kind, int repetitions,
             Comparison& out) {
  SparseFactor ours;
  EigenFactor eigens;
  bool made = true;
  out.factor = in_turn(
      repetitions, [&] { made = ours.make(network, kind) && made; },
      [&] { made = eigens.make(network, kind) && made; });
  if (!made) return false;
  out.free_nodes = ours.size();
  const auto n = static_cast<Eigen::Index>(ours.size());
  std::vector<double> x(ours.size());
  Eigen::VectorXd right(n), y(n);
  out.solve = in_turn(
      10 * repetitions,
      [&] {
        std::fill(x.begin(), x.end(), 1.0);
        ours.solve(x);
        benchmark::DoNotOptimize(x.data());
      },
      [&] {
        right.setOnes();
        y = eigens.ldlt.solve(right);
        benchmark::DoNotOptimize(y.data());
      });
  std::vector<double> by_node(network.size());
  for (std::size_t u = 0; u < ours.size(); ++u)
    by_node[ours.nodes()[u]] = x[u];
  for (Eigen::Index u = 0; u < n; ++u) {
    const double expected = by_node[eigens.nodes[static_cast<std::size_t>(u)]];
    out.difference = std::max(out.difference, std::abs(y[u] / expected - 1));
  }
  return out.difference <= 1e-9;
}

/// The time of a task, and what it would be if `factors` factorisations and `solves` solves in it
/// were Eigen's.
Pair with_eigen(double task_us, const Comparison& c, double factors, double solves) {
  return {task_us, task_us + factors * (c.factor.eigen_us - c.factor.ours_us) +
                       solves * (c.solve.eigen_us - c.solve.ours_us)};
}

template <typename Act>
double median_us(int repetitions, Act&& act) {
  return in_turn(repetitions, act, [] {}).ours_us;
}

bool print_comparison() {
  std::printf("\n%-58s %9s %11s %11s %9s\n", "sparse_factor beside Eigen's SimplicialLDLT", "nodes",
              "ours, us", "Eigen's, us", "ratio");
  bool agree = true;
  double difference = 0;
  for (const std::uint32_t wanted : {100U, 200U, 400U}) {
    Setting& s = setting(wanted);
    Comparison c;
    agree = compare(s.region.network, s.region.mesh.kind, 201, c) && agree;
    difference = std::max(difference, c.difference);
    print_row("factorisation", c.free_nodes, c.factor);
    print_row("one solve", c.free_nodes, c.solve);
    const double prepare_us = median_us(51, [&] {
      auto region =
          prepare_region(s.sheet, s.seeds, s.tool, s.lattice, s.membrane, s.options, s.workspace);
      benchmark::DoNotOptimize(region);
    });
    // The shape and the bounds are a solve each.
    print_row("user waits: the response to a new place", c.free_nodes,
              with_eigen(prepare_us, c, 1, 2));
  }
  for (const int cells : {100, 200}) {
    const Network network =
        make_network(test::triangular_mesh({0, 0}, 256, cells), Lattice{8}, {320, 5e6});
    std::vector<NodeKind> kind(network.size(), NodeKind::kFree);
    kind[network.size() / 2] = NodeKind::kTool;
    Comparison c;
    agree = compare(network, kind, 9, c) && agree;
    difference = std::max(difference, c.difference);
    print_row("factorisation, a whole slice", c.free_nodes, c.factor);
    print_row("one solve, a whole slice", c.free_nodes, c.solve);
  }
  // calibrate() prepares 12 regions and solves each 6 times more, on sheets of two triangles.
  const Lattice lattice{8};
  const Ring tool = test::regular_polygon({}, 768, 6);
  const std::int32_t half = 20000;
  const SheetMesh square = sheet_of(
      {{{-half, -half}, {half, -half}, {half, half}, {-half, half}}, {{0, 1, 2}, {0, 2, 3}}});
  ResponseOptions whole;
  whole.error_bound = 0;
  RegionWorkspace workspace;
  const auto region = prepare_region(square, std::array<std::uint32_t, 2>{0, 1}, tool, lattice,
                                     setting(200).membrane, whole, workspace);
  Comparison c;
  agree = compare(region->network, region->mesh.kind, 201, c) && agree;
  difference = std::max(difference, c.difference);
  const double load_us = median_us(9, [&] {
    const auto calibration = calibrate(5000, kReach_m, tool, lattice);
    benchmark::DoNotOptimize(calibration->membrane);
  });
  print_row("user waits: the calibration when a scene is loaded", c.free_nodes,
            with_eigen(load_us, c, 12 * 7, 12 * 7));
  std::printf("ratio: Eigen's time over ours. A haptic tick neither factors nor solves.\n");
  std::printf("largest relative difference of the two solutions: %.2g\n", difference);
  return agree;
}

}  // namespace

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
  if (print_comparison()) return 0;
  std::fprintf(stderr, "deformation_bench: the two factorisations give different answers\n");
  return 1;
}
