// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/membrane/sheet_law.h"

#include <nlohmann/json.hpp>

#include "formats/base/json.h"
#include "formats/base/text.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;

constexpr int kPlaces = 12;
constexpr double kDecayLengthsAround =
    7;  ///< half side of the sheet; its border then changes a stiffness by exp(-2 * 7)

/// A square sheet of two triangles around the origin.
SliceMesh two_triangles(std::int32_t half) {
  return {{{-half, -half}, {half, -half}, {half, half}, {-half, half}}, {{0, 1, 2}, {0, 2, 3}}};
}

/// Returns the tool at its `k`-th position and rotation. `centre`: centre of `tool`.
Ring placed(const Ring& tool, const Vector2d& centre, int k, double scatter) {
  // The angles are multiples of the golden angle, so that no two positions are alike.
  const double angle = k * std::numbers::pi * (3 - std::sqrt(5.0));
  const Vector2d at =
      scatter * std::sqrt((k + 0.5) / kPlaces) * Vector2d(std::cos(7 * angle), std::sin(7 * angle));
  Ring out;
  for (const LatticePoint& p : tool) {
    const Vector2d q = Vector2d(p.x, p.y) - centre;
    out.push_back({static_cast<std::int32_t>(
                       std::lround(at.x() + std::cos(angle) * q.x() - std::sin(angle) * q.y())),
                   static_cast<std::int32_t>(
                       std::lround(at.y() + std::sin(angle) * q.x() + std::cos(angle) * q.y()))});
  }
  return out;
}

/// Computes network, equilibrium and response of region.mesh.
Result<void> answer(const Lattice& lattice, const Membrane& membrane, Region& region) {
  region.network = make_network(region.mesh.mesh, lattice, membrane);
  if (!solve_local(region.network, region.mesh.kind, region.solution))
    return bug("the region's matrix is not positive definite");

  const LocalSolution& solution = region.solution;
  const double step_m = lattice.step_m();
  const double bed_per_step2 = membrane.foundation_N_per_m3 * step_m * step_m;
  RegionResponse& out = region.response;
  out.stiffness_N_per_m =
      solution.stiffness_N_per_m + bed_per_step2 * region.mesh.under_tool.area_steps2;
  Vector2d moment = bed_per_step2 * region.mesh.under_tool.moment_steps3;
  for (std::size_t i = 0; i < region.network.size(); ++i) {
    if (region.mesh.kind[i] == NodeKind::kFree) ++out.free_nodes;
    if (region.mesh.kind[i] != NodeKind::kTool) continue;
    const LatticePoint p = region.mesh.mesh.vertices[i];
    moment += reaction_N(region.network, solution.w, i) *
              Vector2d(static_cast<double>(std::int64_t{p.x} - region.mesh.origin.x),
                       static_cast<double>(std::int64_t{p.y} - region.mesh.origin.y));
  }
  out.centre_steps = Vector2d(region.mesh.origin.x, region.mesh.origin.y);
  if (out.stiffness_N_per_m > 0) {
    out.centre_steps += moment / out.stiffness_N_per_m;
    out.bounds = solution.bounds;
    // The foundation under the tool is exact; only the network's part has an error.
    out.bounds.force *= solution.stiffness_N_per_m / out.stiffness_N_per_m;
  }
  out.nodes = static_cast<std::uint32_t>(region.network.size());
  out.negative_springs = negative_at_free_nodes(region.network, region.mesh.kind);
  return {};
}

bool has_ring(const RegionMesh& mesh) {
  return std::find(mesh.kind.begin(), mesh.kind.end(), NodeKind::kBorder) != mesh.kind.end();
}

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

constexpr std::array<const char*, 4> kSolverNames{"auto", "local", "global", "propagation"};

bool is_finite(const PrefetchedStiffness& prefetched) noexcept {
  return std::isfinite(prefetched.stiffness_N_per_m) && std::isfinite(prefetched.offset_m[0]) &&
         std::isfinite(prefetched.offset_m[1]);
}

ContactModel contact_model(const ForceLawSetup& setup) {
  ContactModel model;
  model.tool = make_tool(setup.scene.tool);
  model.dt_s = 1 / setup.rate_Hz;
  return model;
}

}  // namespace

Result<Calibration> calibrate(double stiffness_N_per_m, double decay_length_m, const Ring& tool,
                              const Lattice& lattice, const Grading& grading) {
  const double decay_length_steps = decay_length_m / lattice.step_m();
  if (!(stiffness_N_per_m > 0) || !std::isfinite(stiffness_N_per_m))
    return refused("a sheet's stiffness must be positive");
  if (!(decay_length_steps > 0) || !(decay_length_steps <= 1 << 26))
    return refused("a sheet's decay length must be positive, and at most 2^26 lattice steps");
  if (tool.size() < 3) return refused("a tool has at least three corners");

  std::vector<Vector2d> outline_m;
  outline_m.reserve(tool.size());
  const Circle circle = circle_around(tool);
  for (const LatticePoint& p : tool)
    outline_m.push_back((Vector2d(p.x, p.y) - circle.centre) * lattice.step_m());
  const auto exact = membrane_for_tool(stiffness_N_per_m, decay_length_m, outline_m);
  if (!exact) return exact.error();
  Calibration out{*exact};
  if (!grading.graded) return out;

  const double scatter = circle.radius;
  const double half = kDecayLengthsAround * decay_length_steps + 2 * circle.radius + scatter;
  if (!(half < kMaxCoordinate / 2.0)) return refused("the tool is too large for the lattice");
  const auto sheet = make_sheet_mesh(two_triangles(static_cast<std::int32_t>(half)), 0, 0);
  if (!sheet) return sheet.error();
  ResponseOptions options;
  options.error_bound = 0;
  options.region.grading = grading;
  RegionWorkspace workspace;
  std::array<Region, kPlaces> regions;
  std::array<double, kPlaces> stiffness{};
  for (int k = 0; k < kPlaces; ++k) {
    auto region = prepare_region(*sheet, std::array<std::uint32_t, 2>{0, 1},
                                 placed(tool, circle.centre, k, scatter), lattice, *exact, options,
                                 workspace);
    if (!region) return region.error();
    regions[k] = std::move(*region);
    out.excess += regions[k].response.stiffness_N_per_m / stiffness_N_per_m / kPlaces;
  }
  out.excess -= 1;

  // Newton's method for the tension at which the mean is K. The derivative of a stiffness with
  // respect to T is twice the energy of the springs at T = 1.
  for (int round = 0; round < 6; ++round) {
    double mean = 0, slope = 0;
    for (int k = 0; k < kPlaces; ++k) {
      Region& region = regions[k];
      region.network = make_network(region.mesh.mesh, lattice, out.membrane);
      if (!solve_local(region.network, region.mesh.kind, region.solution))
        return bug("the network's matrix is not positive definite");
      const std::vector<double>& w = region.solution.w;
      double beds = 0;
      for (std::size_t i = 0; i < w.size(); ++i)
        beds += region.network.foundation_N_per_m[i] * w[i] * w[i];
      stiffness[k] = region.solution.stiffness_N_per_m + out.membrane.foundation_N_per_m3 *
                                                             region.mesh.under_tool.area_steps2 *
                                                             lattice.step_m() * lattice.step_m();
      mean += stiffness[k] / kPlaces;
      slope += (region.solution.stiffness_N_per_m - beds) / out.membrane.tension_N_per_m / kPlaces;
    }
    out.spread = 0;
    for (double each : stiffness)
      out.spread = std::max(out.spread, std::abs(each / mean - 1));
    out.membrane.tension_N_per_m -= (mean - stiffness_N_per_m) / slope;
  }
  return out;
}

Result<Region> prepare_region(const SheetMesh& sheet, std::span<const std::uint32_t> seeds,
                              const Ring& tool, const Lattice& lattice, const Membrane& membrane,
                              const ResponseOptions& options, RegionWorkspace& workspace) {
  const bool chosen = options.error_bound > 0;
  const double lambda_m = decay_length_m(membrane);
  RegionOptions region_options = options.region;
  // If the decay length is smaller than the tool, the sheet is steep along the outline, so
  // triangles are finer.
  const double circumradius_m = circle_around(tool).radius * lattice.step_m();
  region_options.grading.at_tool *= std::min(1.0, lambda_m / circumradius_m);
  // Along a strip the response decays as exp(-r / lambda), and the ring doubles the remaining error
  // (region.h, law 2). In a wide sheet it decays faster, and this radius more than suffices.
  if (chosen) region_options.radius_m = lambda_m * std::log(2 / std::min(0.5, options.error_bound));
  for (;;) {
    auto mesh = make_region(sheet, seeds, tool, lattice, region_options, workspace);
    if (!mesh) return mesh.error();
    Region region;
    region.mesh = std::move(*mesh);
    if (const auto done = answer(lattice, membrane, region); !done) return done.error();
    const bool whole = !has_ring(region.mesh);
    const double worst =
        std::max(region.response.bounds.force, region.response.bounds.displacement);
    if (!chosen || whole || worst <= options.error_bound) {
      region.response.radius_m =
          whole ? std::numeric_limits<double>::infinity() : region_options.radius_m;
      return region;
    }
    // Add the missing radius and a margin, so that one further attempt usually suffices.
    region_options.radius_m += lambda_m * (std::log(worst / options.error_bound) + 0.1);
  }
}

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
  if (const auto found = answer(request, sheet(static_cast<std::size_t>(request.sheet))))
    answered_.write(*found);
}

std::shared_ptr<const SheetShape> NetworkPrefetch::shape() const {
  const std::lock_guard lock(shape_mutex_);
  return shape_;
}

FaultDetail SheetLaw::update(const ForceLawInput& input, ContactOutput& output) noexcept {
  // A stiffness that is not finite would spread into later ticks, since stiffnesses are blended.
  if (model_.uses_prefetched_stiffness && !is_finite(input.prefetched)) {
    return {Fault::kTorqueNotFinite, FaultQuantity::kPrefetchedStiffness, -1,
            input.prefetched.stiffness_N_per_m, std::numeric_limits<double>::quiet_NaN()};
  }
  const bool is_coupled = coupling_options_.on;
  const Pose T_device_tool = is_coupled
                                 ? move_proxy(coupling_options_, input.pose_interval_s,
                                              input.T_device_plate, coupling_, input.previous)
                                 : input.T_device_plate;
  const PreviousPose previous =
      is_coupled ? previous_proxy(input.pose_interval_s, input.previous, coupling_)
                 : input.previous;
  update_contact(model_, input.sheets, input.prefetched, T_device_tool, input.pose_interval_s,
                 contact_, output, previous);
  output.T_device_evaluated = T_device_tool;
  if (output.not_upright || output.backlog) return {};
  tip_m_ = output.tip_device_m;
  if (output.punctured_now && last_active_sheet_ == output.cut.sheet)
    output.force_before_N = last_force_N_;
  last_force_N_ = output.force_N;
  last_active_sheet_ = output.active_sheet;

  output.wrench_plate = output.wrench_device;
  output.stored_J = output.local.stored_J;
  output.is_released = output.punctured_now;
  if (is_coupled) {
    const Eigen::Vector3d before_m = coupling_.offset_m;
    output.wrench_plate = coupling_wrench(coupling_options_, output.wrench_device, output.local,
                                          output.punctured_now, coupling_);
    if (output.punctured_now)
      shift_tool(model_, T_device_tool, coupling_.offset_m - before_m, contact_);
    output.stored_J += 0.5 * coupling_options_.stiffness_N_per_m * coupling_.offset_m.squaredNorm();
  }
  output.wrench_plate *= force_scale_;
  output.stored_J *= force_scale_;
  return {};
}

void SheetLaw::reset_motion() noexcept {
  runtime::reset_motion(contact_);
  coupling_ = {};
  tip_m_.reset();
  last_force_N_ = 0;
  last_active_sheet_ = -1;
}

void SheetLaw::finish_tick(RecordingRow& row) noexcept {
  if (tip_m_) row.tool_m = {tip_m_->x(), tip_m_->y(), tip_m_->z()};
}

double SheetLaw::retract_distance_m(std::span<const Sheet* const> sheets,
                                    const Pose& T_device_plate) const noexcept {
  double depth_m = 0;
  const double tip_z_m = (T_device_plate * model_.tool.tip_plate_m).z();
  for (std::size_t i = 0; i < sheets.size(); ++i) {
    const SheetTrack& track = contact_.tracks[i];
    const bool bears = track.was_above && track.state != SheetState::kPunctured &&
                       track.state != SheetState::kMissed;
    if (bears) depth_m = std::max(depth_m, sheets[i]->z_m - tip_z_m);
  }
  return depth_m;
}

std::string NetworkLaw::describe() const {
  return text_line("force law  network, solver %s, reach %.3g mm\n",
                   kSolverNames.at(static_cast<std::size_t>(law_.solver)),
                   law_.decay_length_m * 1e3) +
         runtime::describe(design());
}

std::string NetworkLaw::describe_sheet(std::size_t index, const Sheet& sheet,
                                       const Pose& T_device_plate) {
  const Tool& tool = model().tool;
  const Eigen::Vector3d middle_m = axis_at(tool, T_device_plate, sheet.z_m);
  PrefetchRequest request;
  request.sheet = static_cast<std::int32_t>(index);
  request.middle_m = {middle_m.x(), middle_m.y()};
  request.outline = outline_on_lattice(tool, T_device_plate, sheet.transform, sheet.z_m);
  const auto found = prefetch_->answer(request, sheet);
  if (!found) return {};  // the tool misses the sheet
  const PrefetchReport& report = prefetch_->report();
  return text_line("; the network has %.0f N/m there: %u free nodes, %.0f us to prepare",
                   found->stiffness_N_per_m, report.free_nodes_last, report.prepare.max_us());
}

SummarySection NetworkLaw::summary() const {
  const PrefetchReport& report = prefetch_->report();
  const nlohmann::json section = {{"responses", report.answers},
                                  {"failures", report.failures},
                                  {"prepare_us",
                                   {{"p50", report.prepare.quantile_us(0.5)},
                                    {"p99", report.prepare.quantile_us(0.99)},
                                    {"p999", report.prepare.quantile_us(0.999)},
                                    {"max", report.prepare.max_us()},
                                    {"samples", report.prepare.samples()}}},
                                  {"free_nodes_max", report.free_nodes_max},
                                  {"force_error_bound_max", report.force_bound_max},
                                  {"displacement_error_bound_max", report.displacement_bound_max},
                                  {"negative_springs_max", report.negative_springs_max}};
  return {"network", json_text(section)};
}

Result<ContactDesign> design_sheets(const ForceLawSetup& setup) {
  const Tool tool = make_tool(setup.scene.tool);
  double along_N_per_m = 0, across_N_per_m = 0, friction_N_per_m = 0, damping_N_s_per_m = 0,
         viscous_N_s_per_m = 0;
  for (const Sheet* sheet : setup.sheets) {
    const Tissue& tissue = sheet->tissue;
    along_N_per_m = std::max(along_N_per_m, tissue.stiffness_N_per_m + friction_N_per_m);
    friction_N_per_m += tissue.shaft.dry_friction_N / tissue.shaft.presliding_m;
    across_N_per_m += tissue.shaft.rim_stiffness_N_per_m;
    damping_N_s_per_m = std::max(damping_N_s_per_m, tissue.damping_N_s_per_m + viscous_N_s_per_m);
    viscous_N_s_per_m += tissue.shaft.viscous_friction_N_s_per_m;
  }
  damping_N_s_per_m = std::max(damping_N_s_per_m, viscous_N_s_per_m);
  along_N_per_m = std::max(along_N_per_m, friction_N_per_m);
  const CouplingOptions& coupling = setup.coupling;
  const auto rendered = [&](double K) {
    const double limited = coupling.on && K > 0
                               ? K * coupling.stiffness_N_per_m / (K + coupling.stiffness_N_per_m)
                               : K;
    return setup.scene.force_law.force_scale * limited;
  };
  if (coupling.on) damping_N_s_per_m += coupling.damping_N_s_per_m;
  const double length2_m2 = tool.tip_plate_m.squaredNorm(),
               aside2_m2 = tool.tip_plate_m.cross(tool.axis_plate).squaredNorm();
  const RenderedStiffness stiffness{
      std::max(rendered(along_N_per_m), rendered(across_N_per_m)),
      rendered(along_N_per_m) * aside2_m2 + rendered(across_N_per_m) * length2_m2,
      setup.scene.force_law.force_scale * damping_N_s_per_m, std::sqrt(aside2_m2)};
  const Pose T_device_plate = over_anchor(*setup.sheets.front(), tool);
  return design_contact(setup.device, plate_axes(setup.device, T_device_plate), setup.timing(),
                        stiffness, setup.stiffness);
}

Result<std::unique_ptr<ForceLaw>> make_hooke_law(const ForceLawSetup& setup) {
  const Result<ContactDesign> design = design_sheets(setup);
  if (!design) return design.error();
  return std::unique_ptr<ForceLaw>(std::make_unique<SheetLaw>(
      contact_model(setup), setup.coupling, setup.scene.force_law.force_scale, *design));
}

Result<std::unique_ptr<ForceLaw>> make_network_law(const ForceLawSetup& setup) {
  const Result<ContactDesign> design = design_sheets(setup);
  if (!design) return design.error();
  std::vector<Tissue> tissues;
  for (const Sheet* sheet : setup.sheets)
    tissues.push_back(sheet->tissue);
  auto prefetch =
      NetworkPrefetch::make(setup.scene, tissues, setup.sheets.front()->transform.lattice);
  if (!prefetch) return prefetch.error();
  ContactModel model = contact_model(setup);
  model.uses_prefetched_stiffness = true;
  return std::unique_ptr<ForceLaw>(std::make_unique<NetworkLaw>(
      model, setup.coupling, setup.scene.force_law, std::move(*prefetch), *design));
}

}  // namespace trocar::runtime
