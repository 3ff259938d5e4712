// SPDX-License-Identifier: Apache-2.0
#include "runtime/contact/shaft.h"

#include <algorithm>

namespace trocar::runtime {

void enter_hole(const ShaftSection& section, ShaftState& state) noexcept {
  state.in_hole = true;
  state.hole_m = section.at_m.head<2>();
  state.has_hole_position = state.has_last = true;
  state.last_m = section.inserted_m;
  state.spring_m = state.viscous_N = 0;
}

void reset_motion(ShaftState& state) noexcept {
  state.has_hole_position = state.has_last = false;
  state.spring_m = state.viscous_N = 0;
}

Eigen::Vector3d shaft_force(const ShaftTissue& tissue, const ShaftSection& section,
                            double pose_interval_s, ShaftState& state,
                            const PreviousShaft& previous) noexcept {
  if (!state.in_hole) return Eigen::Vector3d::Zero();
  if (!state.has_hole_position) state.hole_m = section.at_m.head<2>();
  state.has_hole_position = true;
  const double moved_m = state.has_last ? section.inserted_m - state.last_m : 0;
  const bool is_steady = state.has_last && previous.ago_s > 0;
  state.has_last = true;
  state.last_m = section.inserted_m;
  state.spring_m = std::clamp(state.spring_m + moved_m, -tissue.presliding_m, tissue.presliding_m);
  if (pose_interval_s > 0) {
    state.viscous_N = is_steady ? tissue.viscous_friction_N_s_per_m *
                                      (section.inserted_m - previous.inserted_m) / previous.ago_s
                                : tissue.viscous_friction_N_s_per_m * moved_m / pose_interval_s;
  }
  const double along_N =
      tissue.dry_friction_N * state.spring_m / tissue.presliding_m + state.viscous_N;
  Eigen::Vector3d force_N = along_N * section.axis;
  force_N.head<2>() -= tissue.rim_stiffness_N_per_m * (section.at_m.head<2>() - state.hole_m);
  return force_N;
}

void add_shaft(const ShaftTissue& tissue, const ShaftSection& section, const ShaftState& state,
               LocalEnvironment& local) noexcept {
  if (!state.in_hole) return;
  const double dry_N_per_m = tissue.dry_friction_N / tissue.presliding_m;
  local.axis = section.axis;
  local.dry_N += dry_N_per_m * state.spring_m;
  local.dry_max_N += tissue.dry_friction_N;
  if (state.spring_m < tissue.presliding_m) local.dry_in_N_per_m += dry_N_per_m;
  if (state.spring_m > -tissue.presliding_m) local.dry_out_N_per_m += dry_N_per_m;
  local.viscous_N_s_per_m += tissue.viscous_friction_N_s_per_m;
  const Eigen::Vector2d aside_m = section.at_m.head<2>() - state.hole_m;
  local.rim_N -= tissue.rim_stiffness_N_per_m * aside_m;
  local.rim_N_per_m += tissue.rim_stiffness_N_per_m;
  local.stored_J += 0.5 * dry_N_per_m * state.spring_m * state.spring_m +
                    0.5 * tissue.rim_stiffness_N_per_m * aside_m.squaredNorm();
}

void shift_shaft(double inserted_m, ShaftState& state) noexcept {
  state.last_m += inserted_m;
}

}  // namespace trocar::runtime
