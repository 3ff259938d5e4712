// SPDX-License-Identifier: Apache-2.0
#include "runtime/deformation/response.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "runtime/deformation/part.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;

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
  // (local_solver.h, law 2). In a wide sheet it decays faster, and this radius more than suffices.
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
