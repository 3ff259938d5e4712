// SPDX-License-Identifier: Apache-2.0
// deformation_sweep < PLAN.json > ROWS.json: speed and error of the network's solvers, at random
// places of scans' slices. Exit codes as for the programs.
//
// PLAN: {"assets": [{"name", "path"}], "places", "repetitions", "reach_m", "tool_radius_m"}
// At each place the whole slice, with the tool cut out and graded around it, is one network. The
// others are compared with its equilibrium (global_solver), on the same triangles:
//   propagation, at depths 1 .. 12, at rest (error of the depth) and in the first tick of a step;
//   local, at radii of 1 .. 12 half lambdas around the tool;
//   auto, at bounds of 10, 1 and 0.1 %.
// A row for each scan, method and parameter: errors (relative to the force, to the depth) and times
// (of the calling thread's CPU) as medians, 95 % and largest over the places. solve_us: one
// solve for a general load; prepare_us: network and factorisation; mesh_us (auto): the region cut
// out and refined.

#include <algorithm>
#include <cmath>
#include <ctime>
#include <iostream>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "runtime/deformation/calibration.h"
#include "runtime/deformation/propagation.h"
#include "runtime/deformation/response.h"
#include "tests/bench/sweep_main.h"
#include "tests/reference/deformation/general_load.h"
#include "tests/reference/deformation/global_solver.h"
#include "tests/reference/deformation/region_part.h"
#include "tests/support/deformation_fixture.h"

namespace {

using namespace trocar;
using namespace trocar::runtime;
using nlohmann::json;

constexpr int kSteps = 12;
constexpr double kBounds[] = {0.1, 0.01, 0.001};
constexpr int kTicksToRest = 4000;
constexpr int kEarlyTicks = 1;

double thread_us() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e6 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_nsec);
}

/// The median time of one of `repetitions` calls.
template <typename Act>
double median_us(int repetitions, Act&& act) {
  std::vector<double> times;
  for (int i = 0; i < repetitions; ++i) {
    const double start = thread_us();
    act();
    times.push_back(thread_us() - start);
  }
  std::nth_element(times.begin(), times.begin() + repetitions / 2, times.end());
  return times[static_cast<std::size_t>(repetitions / 2)];
}

/// One scan, method and parameter: a value for each place.
struct Row {
  std::vector<double> force_error, displacement_error, early_force_error, solve_us, prepare_us,
      mesh_us, answer_us, nodes, radius_mm;

  static void put(json& row, const std::string& name, std::vector<double> values) {
    if (values.empty()) return;
    std::sort(values.begin(), values.end());
    const std::size_t n = values.size();
    row[name] = values[n / 2];
    row[name + "_p95"] = values[std::min(n - 1, n * 95 / 100)];
    row[name + "_max"] = values.back();
  }
  json to_json() const {
    json row;
    put(row, "force_error", force_error);
    put(row, "displacement_error", displacement_error);
    put(row, "early_force_error", early_force_error);
    put(row, "solve_us", solve_us);
    put(row, "prepare_us", prepare_us);
    put(row, "mesh_us", mesh_us);
    put(row, "answer_us", answer_us);
    put(row, "free_nodes", nodes);
    put(row, "radius_mm", radius_mm);
    return row;
  }
};

/// One place: the whole slice's network and its equilibrium.
struct Place {
  RegionMesh mesh;
  Network network;
  GlobalSolution exact;
  double borne_N_per_m = 0;

  double force_error(double network_N_per_m) const {
    return std::abs(network_N_per_m - exact.stiffness_N_per_m) /
           (exact.stiffness_N_per_m + borne_N_per_m);
  }
};

void sweep_propagation(const Place& place, int repetitions, std::vector<Row>& rows) {
  for (int depth = 1; depth <= kSteps; ++depth) {
    Row& row = rows[static_cast<std::size_t>(depth - 1)];
    PropagationPlan plan;
    row.prepare_us.push_back(median_us(repetitions, [&] {
      plan = plan_propagation(place.network, place.mesh.kind, {.depth = depth});
    }));
    PropagationState state = make_propagation_state(place.network, plan);
    double force = 0;
    for (int tick = 0; tick < kEarlyTicks; ++tick)
      force = propagate(place.network, plan, 1, state);
    row.early_force_error.push_back(place.force_error(force));
    for (int tick = kEarlyTicks; tick < kTicksToRest; ++tick) {
      const double next = propagate(place.network, plan, 1, state);
      const bool rests = std::abs(next - force) <= 1e-9 * next;
      force = next;
      if (rests) break;
    }
    row.solve_us.push_back(
        median_us(repetitions, [&] { propagate(place.network, plan, 1, state); }));
    row.force_error.push_back(place.force_error(force));
    double worst = 0;
    for (std::size_t i = 0; i < state.w_m.size(); ++i)
      worst = std::max(worst, std::abs(state.w_m[i] - place.exact.w[i]));
    row.displacement_error.push_back(worst);
    row.nodes.push_back(static_cast<double>(plan.active.size()));
  }
}

/// The region inside a ring, on the place's own triangles.
void sweep_radius(const Place& place, const Ring& tool, const Lattice& lattice,
                  const Membrane& membrane, double radius_m, int repetitions, Row& row) {
  const RegionPart part = part_within(place.mesh, tool, lattice, radius_m);
  Network network;
  LocalSolution solution;
  row.prepare_us.push_back(median_us(repetitions, [&] {
    network = make_network(part.region.mesh, lattice, membrane);
    solve_local(network, part.region.kind, solution, {.bounds = false});
  }));
  std::vector<double> held(network.size(), 0), force(network.size(), 0), w(network.size()),
      work(solution.factor.size());
  for (std::size_t i = 0; i < held.size(); ++i)
    held[i] = part.region.kind[i] == NodeKind::kTool ? 1 : 0;
  row.solve_us.push_back(median_us(repetitions, [&] {
    solve_general(network, part.region.kind, solution.factor, held, force, work, w);
  }));
  row.force_error.push_back(place.force_error(solution.stiffness_N_per_m));
  std::vector<double> v(place.exact.w.size(), 0);
  for (std::size_t i = 0; i < part.parent.size(); ++i)
    v[part.parent[i]] = solution.w[i];
  double worst = 0;
  for (std::size_t i = 0; i < v.size(); ++i)
    worst = std::max(worst, std::abs(v[i] - place.exact.w[i]));
  row.displacement_error.push_back(worst);
  row.nodes.push_back(static_cast<double>(solution.factor.size()));
}

Result<json> sweep(const json& plan, const std::string& name, const std::string& path) {
  const int places = plan.at("places"), repetitions = plan.at("repetitions");
  const double reach_m = plan.at("reach_m"), tool_radius_m = plan.at("tool_radius_m");
  const auto asset = read_asset(path);
  if (!asset) return asset.error();
  const Lattice lattice = asset->lattice;
  const double circumradius = tool_radius_m / lattice.step_m();
  const auto calibration =
      calibrate(5000, reach_m, test::regular_polygon({}, circumradius, 6), lattice);
  if (!calibration) return calibration.error();
  const Membrane membrane = calibration->membrane;
  std::vector<const AssetSlice*> slices;
  for (const AssetSlice& slice : asset->slices) {
    if (!slice.mesh.triangles.empty()) slices.push_back(&slice);
  }
  if (slices.empty()) return refused(path + ": no slice has material");

  std::vector<Row> propagation(kSteps), local(kSteps), automatic(std::size(kBounds));
  Row global;
  RegionWorkspace workspace;
  std::mt19937_64 random(7);
  for (int i = 0; i < places; ++i) {
    const AssetSlice& slice = *slices[random() % slices.size()];
    const auto sheet = make_sheet_mesh(slice.mesh, 0, 0);
    if (!sheet) return sheet.error();
    const Ring tool = test::regular_polygon(test::place_in(slice.mesh, random), circumradius, 6,
                                            test::uniform(random));
    const std::vector<std::uint32_t> seeds = find_seeds(*sheet, tool);
    auto mesh = make_region(*sheet, seeds, tool, lattice, {}, workspace);
    if (!mesh) return mesh.error();
    Place place;
    place.mesh = std::move(*mesh);
    place.borne_N_per_m = membrane.foundation_N_per_m3 * place.mesh.under_tool.area_steps2 *
                          lattice.step_m() * lattice.step_m();
    place.network = make_network(place.mesh.mesh, lattice, membrane);
    Result<GlobalSolution> exact = bug("not solved");
    global.prepare_us.push_back(
        median_us(repetitions, [&] { exact = solve_global(place.network, place.mesh.kind); }));
    if (!exact) return exact.error();
    place.exact = std::move(*exact);
    global.force_error.push_back(0);
    global.displacement_error.push_back(0);
    global.nodes.push_back(static_cast<double>(
        std::count(place.mesh.kind.begin(), place.mesh.kind.end(), NodeKind::kFree)));
    if (!(place.exact.stiffness_N_per_m > 0)) continue;  // the tool covers the whole slice

    sweep_propagation(place, repetitions, propagation);
    for (int k = 1; k <= kSteps; ++k) {
      Row& row = local[static_cast<std::size_t>(k - 1)];
      sweep_radius(place, tool, lattice, membrane, k * reach_m / 2, repetitions, row);
      const RegionOptions options{k * reach_m / 2, {}};
      row.mesh_us.push_back(median_us(repetitions, [&] {
        mesh = make_region(*sheet, seeds, tool, lattice, options, workspace);
      }));
    }
    for (std::size_t b = 0; b < std::size(kBounds); ++b) {
      ResponseOptions options;
      options.error_bound = kBounds[b];
      auto region = prepare_region(*sheet, seeds, tool, lattice, membrane, options, workspace);
      if (!region) return region.error();
      const double radius_m = region->response.radius_m;
      sweep_radius(place, tool, lattice, membrane, radius_m, repetitions, automatic[b]);
      automatic[b].answer_us.push_back(median_us(repetitions, [&] {
        region = prepare_region(*sheet, seeds, tool, lattice, membrane, options, workspace);
      }));
      options.region.radius_m = radius_m;
      automatic[b].mesh_us.push_back(median_us(repetitions, [&] {
        mesh = make_region(*sheet, seeds, tool, lattice, options.region, workspace);
      }));
      if (std::isfinite(radius_m)) automatic[b].radius_mm.push_back(1e3 * radius_m);
    }
  }

  json rows = json::array();
  const auto put = [&](const std::string& method, double parameter, const Row& row) {
    json out = row.to_json();
    out["scan"] = name;
    out["method"] = method;
    out["parameter"] = parameter;
    out["places"] = row.force_error.size();
    out["id"] = name + "/" + method + " " + json(parameter).dump();
    rows.push_back(std::move(out));
  };
  for (int k = 1; k <= kSteps; ++k)
    put("propagation", k, propagation[static_cast<std::size_t>(k - 1)]);
  for (int k = 1; k <= kSteps; ++k)
    put("local", k, local[static_cast<std::size_t>(k - 1)]);
  for (std::size_t b = 0; b < std::size(kBounds); ++b)
    put("auto", kBounds[b], automatic[b]);
  put("global", 0, global);
  return rows;
}

Result<json> run(const json& plan) {
  if (plan.at("repetitions").get<int>() < 1 || plan.at("places").get<int>() < 1)
    return usage("repetitions and places must be >= 1");
  json out = {{"reach_m", plan.at("reach_m")},
              {"tool_radius_m", plan.at("tool_radius_m")},
              {"rows", json::array()}};
  for (const json& asset : plan.at("assets")) {
    const auto name = asset.at("name").get<std::string>();
    std::cerr << "deformation_sweep: " << name << '\n';
    auto rows = sweep(plan, name, asset.at("path").get<std::string>());
    if (!rows) return rows.error();
    for (json& row : *rows)
      out["rows"].push_back(std::move(row));
  }
  return out;
}

}  // namespace

int main() {
  return trocar::test::sweep_main("deformation_sweep", run);
}
