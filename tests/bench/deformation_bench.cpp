// SPDX-License-Identifier: Apache-2.0
// deformation_bench NAME=ASSET...: the force law `network`. Speed against error of its solvers at
// random places of scans' slices, beside the whole slice's equilibrium on the same triangles by
// Eigen; the time until the answer for a new place; sparse_factor beside Eigen's SimplicialLDLT; a
// tick of contact and network.
#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numeric>
#include <random>
#include <span>

#include "formats/asset/asset.h"
#include "runtime/haptics/membrane/region.h"
#include "runtime/haptics/membrane/sheet_law.h"
#include "runtime/haptics/puncture.h"
#include "tests/bench/bench.h"
#include "tests/reference/deformation/general_load.h"
#include "tests/reference/deformation/global_solver.h"
#include "tests/reference/deformation/region_part.h"
#include "tests/support/deformation_fixture.h"
#include "tests/support/sheet_fixture.h"

namespace trocar::bench {
namespace {

using namespace trocar::runtime;

constexpr double kStiffness_N_per_m = 5000, kReach_m = 0.008, kTool_m = 0.003;

// ---- speed against error on scans ----

/// The whole slice with the tool cut out, as one network.
struct Place {
  std::shared_ptr<const SheetMesh> sheet;
  Ring tool;
  std::vector<std::uint32_t> seeds;
  RegionMesh mesh;
  Network network;
  GlobalSolution exact;
  double borne_N_per_m = 0;  ///< stiffness of the bed under the tool
};
struct Places {
  Lattice lattice;
  Membrane membrane;
  std::vector<Place> all;
};

std::shared_ptr<const Places> places_of(const Input& input, int count) {
  const Asset asset = take(read_asset(input.file));
  auto out = std::make_shared<Places>();
  out->lattice = asset.lattice;
  const double circumradius = kTool_m / asset.lattice.step_m();
  out->membrane = take(calibrate(kStiffness_N_per_m, kReach_m,
                                 test::regular_polygon({}, circumradius, 6), asset.lattice))
                      .membrane;
  std::vector<const AssetSlice*> slices;
  for (const AssetSlice& slice : asset.slices)
    if (!slice.mesh.triangles.empty()) slices.push_back(&slice);
  if (slices.empty()) throw std::runtime_error(input.file + ": no slice has material");
  RegionWorkspace workspace;
  std::mt19937_64 random(7);
  while (std::ssize(out->all) < count) {
    const AssetSlice& slice = *slices[random() % slices.size()];
    Place place;
    place.sheet = std::make_shared<SheetMesh>(take(make_sheet_mesh(slice.mesh, 0, 0)));
    place.tool = test::regular_polygon(test::place_in(slice.mesh, random), circumradius, 6,
                                       test::uniform(random));
    place.seeds = find_seeds(*place.sheet, place.tool);
    place.mesh =
        take(make_region(*place.sheet, place.seeds, place.tool, out->lattice, {}, workspace));
    place.network = make_network(place.mesh.mesh, out->lattice, out->membrane);
    place.exact = take(solve_global(place.network, place.mesh.kind));
    if (!(place.exact.stiffness_N_per_m > 0)) continue;  // the tool covers the whole slice
    const double step_m = out->lattice.step_m();
    place.borne_N_per_m =
        out->membrane.foundation_N_per_m3 * place.mesh.under_tool.area_steps2 * step_m * step_m;
    out->all.push_back(std::move(place));
  }
  return out;
}

/// A solver that is prepared for a place: one solve for a general load, and its errors.
struct Prepared {
  std::function<void()> solve;
  double force_error = 0;         ///< relative to the whole slice's force
  double displacement_error = 0;  ///< relative to the depth
  double nodes = 0;
};

double force_error(const Place& place, double network_N_per_m) {
  return std::abs(network_N_per_m - place.exact.stiffness_N_per_m) /
         (place.exact.stiffness_N_per_m + place.borne_N_per_m);
}
double largest_difference(const std::vector<double>& a, const std::vector<double>& b) {
  double worst = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    worst = std::max(worst, std::abs(a[i] - b[i]));
  return worst;
}

Prepared propagation(const Place& place, int depth) {
  struct State {
    PropagationPlan plan;
    PropagationState moving;
  };
  auto state = std::make_shared<State>();
  state->plan = plan_propagation(place.network, place.mesh.kind, {.depth = depth});
  state->moving = make_propagation_state(place.network, state->plan);
  double force = 0;
  for (int tick = 0; tick < 4000; ++tick) {
    const double next = propagate(place.network, state->plan, 1, state->moving);
    const bool rests = std::abs(next - force) <= 1e-9 * next;
    force = next;
    if (rests) break;
  }
  return {[state, &place] {
            benchmark::DoNotOptimize(propagate(place.network, state->plan, 1, state->moving));
          },
          force_error(place, force), largest_difference(state->moving.w_m, place.exact.w),
          static_cast<double>(state->plan.active.size())};
}

Prepared local(const Places& places, const Place& place, double radius_m) {
  struct State {
    RegionPart part;
    Network network;
    LocalSolution solution;
    std::vector<double> held, force, w, work;
  };
  auto s = std::make_shared<State>();
  s->part = part_within(place.mesh, place.tool, places.lattice, radius_m);
  s->network = make_network(s->part.region.mesh, places.lattice, places.membrane);
  solve_local(s->network, s->part.region.kind, s->solution, {.bounds = false});
  s->held.assign(s->network.size(), 0);
  s->force = s->w = s->held;
  s->work.resize(s->solution.factor.size());
  std::vector<double> whole(place.exact.w.size(), 0);
  for (std::size_t i = 0; i < s->held.size(); ++i) {
    if (s->part.region.kind[i] == NodeKind::kTool) s->held[i] = 1;
    whole[s->part.parent[i]] = s->solution.w[i];
  }
  return {[s] {
            solve_general(s->network, s->part.region.kind, s->solution.factor, s->held, s->force,
                          s->work, s->w);
          },
          force_error(place, s->solution.stiffness_N_per_m),
          largest_difference(whole, place.exact.w), static_cast<double>(s->solution.factor.size())};
}

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + std::ssize(values) / 2, values.end());
  return values[values.size() / 2];
}

void add_solver(const std::string& name, const std::shared_ptr<const Places>& places,
                const std::function<Prepared(const Place&)>& prepare, double bound = 1e300) {
  auto all = std::make_shared<std::vector<Prepared>>();
  std::vector<double> force, displacement, nodes;
  for (const Place& place : places->all) {
    const Prepared& made = all->emplace_back(prepare(place));
    force.push_back(made.force_error);
    displacement.push_back(made.displacement_error);
    nodes.push_back(made.nodes);
  }
  Counters counters{
      {"error_force", median(force)},
      {"error_force_max", *std::max_element(force.begin(), force.end())},
      {"error_displacement", median(displacement)},
      {"error_displacement_max", *std::max_element(displacement.begin(), displacement.end())},
      {"nodes", median(nodes)}};
  check(counters.at("error_force_max") <= bound && counters.at("error_displacement_max") <= bound,
        name + ": an error is above its bound");
  add(
      name, benchmark::kMicrosecond,
      [all, places, next = std::size_t{0}]() mutable { (*all)[next++ % all->size()].solve(); },
      [counters] { return counters; });
}

void add_scan(const Input& input) {
  const auto places = places_of(input, quick ? 6 : 40);
  const std::string stage = "deformation/" + input.name + "/";
  for (const int depth : {1, 2, 4, 8, 12}) {
    add_solver(stage + "propagation/depth-" + std::to_string(depth), places,
               [depth](const Place& place) { return propagation(place, depth); });
  }
  for (const int mm : {4, 8, 16, 32, 48}) {
    add_solver(stage + "local/" + std::to_string(mm) + "mm", places,
               [places, mm](const Place& place) { return local(*places, place, 1e-3 * mm); });
  }
  const auto region_at = [places](const Place& place, const ResponseOptions& options) {
    static RegionWorkspace workspace;
    return take(prepare_region(*place.sheet, place.seeds, place.tool, places->lattice,
                               places->membrane, options, workspace));
  };
  for (const double bound : {0.1, 0.01, 0.001}) {
    ResponseOptions options;
    options.error_bound = bound;
    const std::string setting = short_text(100 * bound) + "-percent";
    add_solver(
        std::string(stage).append("auto/").append(setting), places,
        [=](const Place& place) {
          return local(*places, place, region_at(place, options).response.radius_m);
        },
        bound);
    add("answer/" + input.name + "/trocar/" + setting, benchmark::kMicrosecond,
        [=, next = std::size_t{0}]() mutable {
          benchmark::DoNotOptimize(region_at(places->all[next++ % places->all.size()], options));
        });
  }
  add("answer/" + input.name + "/peer-whole-slice-Eigen", benchmark::kMicrosecond,
      [places, next = std::size_t{0}]() mutable {
        const Place& place = places->all[next++ % places->all.size()];
        benchmark::DoNotOptimize(solve_global(place.network, place.mesh.kind));
      });
}

// ---- sparse_factor beside Eigen ----

/// The free nodes' matrix, factored by Eigen in its order of approximate minimum degree.
struct EigenFactor {
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>, Eigen::Lower> ldlt;
  std::vector<std::uint32_t> nodes;  ///< node of each unknown

  void make(const Network& network, std::span<const NodeKind> kind) {
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
  }
  Eigen::VectorXd solve_ones() const {
    return ldlt.solve(Eigen::VectorXd::Ones(static_cast<Eigen::Index>(nodes.size())));
  }
};

struct Problem {
  Network network;
  std::vector<NodeKind> kind;
};

void add_factor(const std::string& name, Problem made) {
  const auto problem = std::make_shared<const Problem>(std::move(made));
  auto ours = std::make_shared<SparseFactor>();
  auto eigens = std::make_shared<EigenFactor>();
  if (!ours->make(problem->network, problem->kind)) throw std::runtime_error(name + ": no factor");
  eigens->make(problem->network, problem->kind);
  auto x = std::make_shared<std::vector<double>>(ours->size());
  const auto solve_ours = [ours, x] {
    std::fill(x->begin(), x->end(), 1.0);
    ours->solve(*x);
    benchmark::DoNotOptimize(x->data());
  };
  const auto difference = [=] {
    std::vector<double> by_node(problem->network.size());
    solve_ours();
    for (std::size_t u = 0; u < x->size(); ++u)
      by_node[ours->nodes()[u]] = (*x)[u];
    const Eigen::VectorXd y = eigens->solve_ones();
    double worst = 0;
    for (Eigen::Index u = 0; u < y.size(); ++u)
      worst =
          std::max(worst, std::abs(by_node[eigens->nodes[static_cast<std::size_t>(u)]] / y[u] - 1));
    check(worst <= 1e-9, name + ": the two factorisations give different answers");
    return Counters{{"error_difference", worst}, {"nodes", static_cast<double>(y.size())}};
  };
  add(
      "factor/" + name + "/trocar", benchmark::kMicrosecond,
      [=] { benchmark::DoNotOptimize(ours->make(problem->network, problem->kind)); }, difference);
  add("factor/" + name + "/peer-Eigen", benchmark::kMicrosecond,
      [=] { eigens->make(problem->network, problem->kind); });
  add("solve/" + name + "/trocar", benchmark::kMicrosecond, solve_ours, difference);
  add("solve/" + name + "/peer-Eigen", benchmark::kMicrosecond,
      [=] { benchmark::DoNotOptimize(eigens->solve_ones()); });
}

/// A sheet of 0.4 m with 8 mm triangles, a hexagon of 3 mm in its middle, and a region of about
/// `free_nodes` free nodes around it.
Region region_of(std::uint32_t free_nodes, const SheetMesh& sheet, const Ring& tool,
                 const Lattice& lattice) {
  ResponseOptions options;
  options.error_bound = 0;
  const Membrane membrane =
      take(calibrate(kStiffness_N_per_m, kReach_m, test::regular_polygon({}, 768, 6), lattice))
          .membrane;
  RegionWorkspace workspace;
  for (double radius_m = 0.002;; radius_m += 0.0005) {
    options.region.radius_m = radius_m;
    Region region = take(prepare_region(sheet, find_seeds(sheet, tool), tool, lattice, membrane,
                                        options, workspace));
    if (region.response.free_nodes >= free_nodes) return region;
  }
}

/// Contact, and a solve for loads on every node of a region: outline, overlap, phase, wrench.
void add_tick(const Region& made, const SheetMesh& mesh, const Lattice& lattice) {
  struct Tick {
    Region region;
    Sheet sheet;
    ContactModel model;
    ContactState contact;
    ContactOutput output;
    Pose T_device_plate;
    std::vector<double> held, force, work, w;
  };
  auto t = std::make_shared<Tick>();
  t->region = made;
  t->sheet.z_m = 0.12;
  t->sheet.transform.lattice = lattice;
  t->sheet.mesh = mesh;
  t->sheet.index_mesh();
  t->model.uses_prefetched_stiffness = true;
  t->model.tool = make_tool(SceneTool{});
  t->held.assign(t->region.network.size(), 1e-3);
  t->force.assign(t->held.size(), 0);
  t->w = t->force;
  t->work.resize(t->region.solution.factor.size());
  const auto meet = [t, lattice](double depth_m) {
    const std::array<const Sheet*, 1> sheets{&t->sheet};
    t->T_device_plate.p_m = {300 * lattice.step_m(), 500 * lattice.step_m(),
                             t->sheet.z_m - depth_m};
    update_contact(t->model, sheets, {}, t->T_device_plate, t->model.dt_s, t->contact, t->output);
  };
  meet(-1e-3);  // from above
  add(
      "tick/network-200-nodes/trocar", benchmark::kMicrosecond,
      [t, meet] {
        meet(1e-3);
        solve_general(t->region.network, t->region.mesh.kind, t->region.solution.factor, t->held,
                      t->force, t->work, t->w);
        benchmark::DoNotOptimize(t->w.data());
      },
      [t] {
        check(t->output.phase == ContactPhase::kContact, "the tick has no contact");
        return Counters();
      });
}

void add_all(const std::vector<Input>& inputs) {
  const Lattice lattice{8};
  const SheetMesh sheet =
      take(make_sheet_mesh(test::square_mesh({-51200, -51200}, 2048, 50), 0, 0));
  const Ring tool = test::regular_polygon({300, 500}, 768, 6, 0.2);
  for (const std::uint32_t nodes : {100U, 200U, 400U}) {
    const Region region = region_of(nodes, sheet, tool, lattice);
    add_factor(std::to_string(nodes) + "-nodes", {region.network, region.mesh.kind});
    if (nodes == 200) add_tick(region, sheet, lattice);
  }
  Problem slice{make_network(test::triangular_mesh({0, 0}, 256, 100), lattice, test::kMembrane),
                {}};
  slice.kind.assign(slice.network.size(), NodeKind::kFree);
  slice.kind[slice.network.size() / 2] = NodeKind::kTool;
  add_factor("slice-10000-nodes", std::move(slice));
  add("calibrate/hexagon/trocar", benchmark::kMicrosecond, [lattice] {
    benchmark::DoNotOptimize(
        calibrate(kStiffness_N_per_m, kReach_m, test::regular_polygon({}, 768, 6), lattice));
  });
  for (const Input& input : inputs)
    add_scan(input);
}

}  // namespace
}  // namespace trocar::bench

int main(int argc, char** argv) {
  return trocar::bench::bench_main(argc, argv, trocar::bench::add_all);
}
