// SPDX-License-Identifier: Apache-2.0
#include "runtime/force_law/network_prefetch.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <utility>

#include "runtime/deformation/calibration.h"

namespace trocar::runtime {
namespace {

constexpr int kMaxPropagationTicks = 500;
constexpr double kSettled = 1e-6;  // relative change of the force per tick, at most

ResponseOptions options_of(const SceneForceLaw& law) {
  ResponseOptions options;
  options.error_bound = law.solver == NetworkSolver::kAuto ? law.error_bound : 0;
  options.region.radius_m =
      law.solver == NetworkSolver::kLocal ? law.radius_m : std::numeric_limits<double>::infinity();
  // The depth of a propagation is counted in nodes of the sheet's own mesh, so the mesh
  // is not graded.
  options.region.grading.graded = law.solver != NetworkSolver::kPropagation;
  return options;
}

/// Returns the force per depth to which the propagation converges.
double settled_stiffness_N_per_m(const Region& region, const SceneForceLaw& law) {
  PropagationOptions options;
  options.depth = law.depth;
  const PropagationPlan plan = plan_propagation(region.network, region.mesh.kind, options);
  PropagationState state = make_propagation_state(region.network, plan);
  double force_N = 0;
  for (int tick = 0; tick < kMaxPropagationTicks; ++tick) {
    const double next_N = propagate(region.network, plan, 1, state);
    const bool settled = std::abs(next_N - force_N) <= kSettled * std::abs(next_N);
    force_N = next_N;
    if (settled) break;
  }
  const double of_network_N = region.solution.stiffness_N_per_m;
  return region.response.stiffness_N_per_m - of_network_N + force_N;
}

void find_seeds_in_grid(const Sheet& sheet, const LatticeOutline& outline,
                        std::vector<std::uint32_t>& seeds) {
  seeds.clear();
  sheet.grid.for_each(sheet.mesh, box_around(outline),
                      [&](std::uint32_t t) { seeds.push_back(t); });
  std::sort(seeds.begin(), seeds.end());
}

SheetShape shape_of(const Sheet& sheet, Region region) {
  SheetShape shape;
  shape.slice_index = sheet.slice_index;
  shape.cuts = sheet.cuts;
  shape.z_m = sheet.z_m;
  for (const LatticePoint p : region.mesh.mesh.vertices) {
    const Eigen::Vector2d xy_m = sheet.transform.to_scene({p.x, p.y});
    shape.vertices_m.push_back({xy_m.x(), xy_m.y()});
  }
  shape.triangles = std::move(region.mesh.mesh.triangles);
  shape.w = std::move(region.solution.w);
  return shape;
}

}  // namespace

Result<std::unique_ptr<NetworkPrefetch>> NetworkPrefetch::make(
    const Scene& scene, const std::vector<Tissue>& tissue_of_sheet, const Lattice& lattice) {
  std::unique_ptr<NetworkPrefetch> prefetch(new NetworkPrefetch);
  prefetch->law_ = scene.force_law;
  SceneTool upright = scene.tool;
  upright.tilt_deg = 0;
  PlanarTransform transform;
  transform.lattice = lattice;
  Pose T_device_plate;
  const Tool tool = make_tool(upright);
  T_device_plate.p_m = -tool.tip_plate_m;
  const Ring outline = to_ring(outline_on_lattice(tool, T_device_plate, transform, 0));
  const Grading grading = options_of(scene.force_law).region.grading;
  for (std::size_t i = 0; i < tissue_of_sheet.size(); ++i) {
    const Tissue& tissue = tissue_of_sheet[i];
    // Sheets of equal stiffness share a membrane: all other values are common to the scene.
    const auto before = std::find_if(
        tissue_of_sheet.begin(), tissue_of_sheet.end(),
        [&](const Tissue& other) { return other.stiffness_N_per_m == tissue.stiffness_N_per_m; });
    const auto index_before = static_cast<std::size_t>(before - tissue_of_sheet.begin());
    if (index_before < i) {
      prefetch->membrane_.push_back(prefetch->membrane_[index_before]);
      continue;
    }
    ++prefetch->report_.calibrations;
    const auto found = calibrate(tissue.stiffness_N_per_m, scene.force_law.decay_length_m, outline,
                                 lattice, grading);
    if (!found) return found.error();
    prefetch->membrane_.push_back(found->membrane);
  }
  return prefetch;
}

std::optional<PrefetchedStiffness> NetworkPrefetch::answer(const PrefetchRequest& request,
                                                           const Sheet& sheet) {
  if (request.sheet < 0 || request.outline.size == 0) return std::nullopt;
  if (request.sheet == last_.sheet && request.outline == last_.outline && sheet.cuts == last_cuts_)
    return std::nullopt;
  last_ = request;
  last_cuts_ = sheet.cuts;
  const auto start = std::chrono::steady_clock::now();
  find_seeds_in_grid(sheet, request.outline, seeds_);
  auto region = prepare_region(
      sheet.mesh, seeds_, to_ring(request.outline), sheet.transform.lattice,
      membrane_[static_cast<std::size_t>(request.sheet)], options_of(law_), workspace_);
  if (!region) {
    ++report_.failures;
    return std::nullopt;
  }
  const RegionResponse& found = region->response;
  PrefetchedStiffness out;
  out.sheet = request.sheet;
  out.stiffness_N_per_m = law_.solver == NetworkSolver::kPropagation
                              ? settled_stiffness_N_per_m(*region, law_)
                              : found.stiffness_N_per_m;
  if (!(out.stiffness_N_per_m > 0)) return std::nullopt;
  const Eigen::Vector2d centre_m = sheet.transform.to_scene(found.centre_steps);
  out.offset_m = {centre_m.x() - request.middle_m[0], centre_m.y() - request.middle_m[1]};

  report_.prepare.add(
      std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now() - start)
          .count());
  ++report_.answers;
  report_.free_nodes_last = found.free_nodes;
  report_.free_nodes_max = std::max(report_.free_nodes_max, found.free_nodes);
  report_.force_bound_max = std::max(report_.force_bound_max, found.bounds.force);
  report_.displacement_bound_max =
      std::max(report_.displacement_bound_max, found.bounds.displacement);
  report_.negative_springs_max = std::max(report_.negative_springs_max, found.negative_springs);
  auto shape = std::make_shared<SheetShape>(shape_of(sheet, std::move(*region)));
  const std::lock_guard lock(shape_mutex_);
  shape_ = std::move(shape);
  return out;
}

void NetworkPrefetch::serve(const std::function<const Sheet&(std::size_t)>& sheet) {
  PrefetchRequest request;
  if (!asked_.read(request) || request.sheet < 0) return;
  if (const auto found = answer(request, sheet(static_cast<std::size_t>(request.sheet)))) {
    answered_.write(*found);
  }
}

std::shared_ptr<const SheetShape> NetworkPrefetch::shape() const {
  const std::lock_guard lock(shape_mutex_);
  return shape_;
}

}  // namespace trocar::runtime
