// SPDX-License-Identifier: Apache-2.0
#include "runtime/deformation/calibration.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "runtime/deformation/part.h"
#include "runtime/deformation/response.h"
#include "runtime/deformation/unbounded.h"

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
  Calibration out{*exact, 0, 0, exact->foundation_N_per_m3};
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

}  // namespace trocar::runtime
