// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/membrane/response.h"

#include <numbers>

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

}  // namespace trocar::runtime
