// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/puncture.h"

namespace trocar::runtime {
namespace {

void reset_above(SheetTrack& track) noexcept {
  track.state = SheetState::kFree;
  track.was_above = true;
  track.has_last = false;
  track.shaft.in_hole = false;
}

/// The tool in one sheet's plane.
struct ToolSection {
  LatticeOutline outline;
  Overlap overlap;
  ShaftSection shaft;
};

ShaftSection shaft_section(const ContactModel& model, const Sheet& sheet,
                           const Pose& T_device_plate, double penetration_m) noexcept {
  const Eigen::Vector3d axis = T_device_plate.q * model.tool.axis_plate;
  return {axis_at(model.tool, T_device_plate, sheet.z_m), axis, penetration_m / axis.z()};
}

/// Returns the tissue's shaft properties, multiplied by the coverage of a hole.
ShaftTissue scaled_tissue(const ShaftTissue& tissue, double coverage) noexcept {
  ShaftTissue scaled = tissue;
  scaled.dry_friction_N *= coverage;
  scaled.viscous_friction_N_s_per_m *= coverage;
  scaled.rim_stiffness_N_per_m *= coverage;
  return scaled;
}

/// The nearest remembered holes of a sheet.
struct HolesAround {
  double outside = 1;  ///< part of the tool's outline outside the holes; if < min_coverage, a bound
  double coverage = 0;  ///< RememberedHole::coverage of the nearest hole
};

HolesAround holes_around(const ContactModel& model, const Sheet& sheet, const SheetTrack& track,
                         const ToolSection& section) noexcept {
  HolesAround around;
  std::array<const RememberedHole*, kMaxHoles> hole;
  const std::size_t known = std::min(static_cast<std::size_t>(track.cuts_requested), hole.size());
  for (std::size_t k = 0; k < known; ++k)
    hole[k] = &track.holes[k];
  std::array<LatticeOutline, kMaxPendingHoles> outlines;
  const std::size_t count = std::min(known, outlines.size());
  if (count == 0) return around;
  const Eigen::Vector2d at_m = section.shaft.at_m.head<2>();
  std::partial_sort(hole.begin(), hole.begin() + count, hole.begin() + known,
                    [&](const RememberedHole* a, const RememberedHole* b) {
                      return (a->at_m - at_m).squaredNorm() < (b->at_m - at_m).squaredNorm();
                    });
  around.coverage = hole[0]->coverage;
  // The nearest hole usually suffices. Each further hole makes the clipping take longer.
  for (std::size_t k = 0; k < count && !(around.outside < model.min_coverage); ++k) {
    outlines[k] =
        outline_on_lattice(model.tool, hole[k]->T_device_plate, sheet.transform, sheet.z_m);
    around.outside =
        outline_outside(model.tool, section.outline, std::span(outlines.data(), k + 1));
  }
  return around;
}

/// Call this when the tool misses the sheet: puts the shaft into an old hole if it is in
/// one (contract 7).
void enter_old_hole(const ContactModel& model, const Sheet& sheet, const ToolSection& section,
                    SheetTrack& track) noexcept {
  const HolesAround around = holes_around(model, sheet, track, section);
  if (!(around.outside < model.min_coverage)) return;
  enter_hole(section.shaft, track.shaft);
  track.hole_coverage = around.coverage;
}

/// Puts the shaft into the hole of its puncture, and remembers this hole as the sheet's latest.
void enter_new_hole(const ContactModel& model, const Sheet& sheet, const ToolSection& section,
                    const Pose& T_device_plate, SheetTrack& track) noexcept {
  double coverage = section.overlap.coverage;
  if (coverage < 1) {
    const HolesAround around = holes_around(model, sheet, track, section);
    coverage = std::min(1.0, coverage + (1 - around.outside) * around.coverage);
  }
  enter_hole(section.shaft, track.shaft);
  track.hole_coverage = coverage;
  track.holes[track.cuts_requested % track.holes.size()] = {section.shaft.at_m.head<2>(),
                                                            T_device_plate, coverage};
}

/// Returns the contact state of a sheet that the tip is below. `shielded`: a sheet above it bears the
/// tool, or was punctured in this tick.
SheetState next_state(const ContactModel& model, const SheetTrack& track, bool shielded,
                      double coverage) noexcept {
  switch (track.state) {
    case SheetState::kFree:
    case SheetState::kShielded:
      if (!track.was_above) return SheetState::kMissed;  // the session began below it
      if (shielded) return SheetState::kShielded;
      return coverage >= model.min_coverage ? SheetState::kContact : SheetState::kMissed;
    case SheetState::kContact:
      return coverage == 0 ? SheetState::kMissed : SheetState::kContact;  // slid off
    case SheetState::kPunctured:
    case SheetState::kMissed:
      break;
  }
  return track.state;
}

/// Force law `hooke`: the stiffness is K times the coverage and acts at the centroid of
/// the covered area.
PrefetchedStiffness hooke_stiffness(const Sheet& sheet, std::int32_t index,
                                    const ToolSection& section) noexcept {
  PrefetchedStiffness response;
  response.sheet = index;
  response.stiffness_N_per_m = section.overlap.coverage * sheet.tissue.stiffness_N_per_m;
  const Eigen::Vector2d offset_m =
      sheet.transform.to_scene(section.overlap.centroid_steps) - section.shaft.at_m.head<2>();
  response.offset_m = {offset_m.x(), offset_m.y()};
  return response;
}

/// Force law `network`: moves the track's stiffness towards `target` by the fraction dt_s / kBlend_s. In
/// the first tick of a contact the result is `target`.
PrefetchedStiffness blended_stiffness(const ContactModel& model, const PrefetchedStiffness& target,
                                      bool begins, SheetTrack& track) noexcept {
  if (begins) return track.blended = target;
  const double weight = std::min(1.0, model.dt_s / kBlend_s);
  track.blended.sheet = target.sheet;
  track.blended.stiffness_N_per_m +=
      weight * (target.stiffness_N_per_m - track.blended.stiffness_N_per_m);
  for (std::size_t k = 0; k < 2; ++k)
    track.blended.offset_m[k] += weight * (target.offset_m[k] - track.blended.offset_m[k]);
  return track.blended;
}

/// Force of a sheet on the tool at one penetration (contract 2).
struct SheetForce {
  double force_N = 0;
  double stiffness_N_per_m = 0, damping_N_s_per_m = 0;
  std::array<double, 2> offset_m{};  ///< point of action, from the middle of the tool's outline
};

SheetForce sheet_force(const ContactModel& model, const Sheet& sheet, std::int32_t index,
                       const ToolSection& section, const PrefetchedStiffness& latest, bool begins,
                       double penetration_m, SheetTrack& track) noexcept {
  PrefetchedStiffness found = hooke_stiffness(sheet, index, section);
  if (model.uses_prefetched_stiffness)
    found = blended_stiffness(model, latest.sheet == index ? latest : found, begins, track);
  SheetForce out;
  out.stiffness_N_per_m = found.stiffness_N_per_m;
  out.damping_N_s_per_m = section.overlap.coverage * sheet.tissue.damping_N_s_per_m;
  out.force_N = std::max(
      0.0, out.stiffness_N_per_m * penetration_m + out.damping_N_s_per_m * track.rate_m_per_s);
  out.offset_m = found.offset_m;
  return out;
}

void add_sheet(const SheetForce& force, double penetration_m, LocalEnvironment& local) noexcept {
  local.sheet_N = force.stiffness_N_per_m * penetration_m;
  local.sheet_N_per_m = force.stiffness_N_per_m;
  local.sheet_N_s_per_m = force.damping_N_s_per_m;
  local.stored_J += 0.5 * force.stiffness_N_per_m * penetration_m * penetration_m;
}

/// Requests the stiffness that will be needed next: that of the topmost sheet that is neither punctured
/// nor missed, if the tip is at most prefetch_height_m above it.
void request_prefetch(const ContactModel& model, std::span<const Sheet* const> sheets,
                      const Pose& T_device_plate, const ContactState& state,
                      ContactOutput& output) noexcept {
  for (std::size_t i = 0; i < sheets.size(); ++i) {
    const SheetState now = state.tracks[i].state;
    if (now == SheetState::kPunctured || now == SheetState::kMissed) continue;
    if (output.tip_device_m.z() - sheets[i]->z_m > model.prefetch_height_m) return;
    const Eigen::Vector3d middle_m = axis_at(model.tool, T_device_plate, sheets[i]->z_m);
    output.prefetch.sheet = static_cast<std::int32_t>(i);
    output.prefetch.middle_m = {middle_m.x(), middle_m.y()};
    output.prefetch.outline =
        outline_on_lattice(model.tool, T_device_plate, sheets[i]->transform, sheets[i]->z_m);
    return;
  }
}

/// Updates the rate dx' of a sheet in contact (contract 2). If `ago_s` is positive, the rate is
/// `change_m`, the change of the penetration in the last `ago_s`, divided by `ago_s`.
void update_rate(double penetration_m, double change_m, double pose_interval_s, double ago_s,
                 SheetTrack& track) noexcept {
  if (!track.has_last) {
    track.rate_m_per_s = 0;
  } else if (pose_interval_s > 0) {
    track.rate_m_per_s =
        ago_s > 0 ? change_m / ago_s : (penetration_m - track.last_penetration_m) / pose_interval_s;
  }
  track.last_penetration_m = penetration_m;
  track.has_last = true;
}

}  // namespace

void drop_published(const Sheet& sheet, SheetTrack& track) noexcept {
  const std::uint32_t missing = track.cuts_requested - sheet.cuts;
  const int keep =
      static_cast<int>(std::min(missing, static_cast<std::uint32_t>(track.pending_count)));
  const int drop = track.pending_count - keep;
  if (drop == 0) return;
  std::copy(track.pending.begin() + drop, track.pending.begin() + track.pending_count,
            track.pending.begin());
  track.pending_count = keep;
}

void update_contact(const ContactModel& model, std::span<const Sheet* const> sheets,
                    const PrefetchedStiffness& prefetched, const Pose& T_device_plate,
                    double pose_interval_s, ContactState& state, ContactOutput& output,
                    const PreviousPose& previous) noexcept {
  output = ContactOutput{};
  output.tip_device_m = T_device_plate * model.tool.tip_plate_m;
  output.not_upright = !is_upright(model.tool, T_device_plate);
  if (output.not_upright) return;
  const double previous_tip_z_m = (previous.T_device_plate * model.tool.tip_plate_m).z();
  bool shielded = false;  // a sheet above bears the tool, or was punctured in this tick
  for (std::size_t i = 0; i < sheets.size(); ++i) {
    const Sheet& sheet = *sheets[i];
    SheetTrack& track = state.tracks[i];
    drop_published(sheet, track);
    const double penetration_m = sheet.z_m - output.tip_device_m.z();
    if (!(penetration_m > 0)) {
      reset_above(track);
      continue;
    }
    ToolSection section;
    section.shaft = shaft_section(model, sheet, T_device_plate, penetration_m);
    const ShaftTissue tissue = scaled_tissue(sheet.tissue.shaft, track.hole_coverage);
    const double previous_m = sheet.z_m - previous_tip_z_m;
    PreviousShaft previous_shaft;
    if (track.shaft.in_hole && previous.ago_s > 0) {
      previous_shaft = {shaft_section(model, sheet, previous.T_device_plate, previous_m).inserted_m,
                        previous.ago_s};
    }
    const Eigen::Vector3d hole_force_N =
        shaft_force(tissue, section.shaft, pose_interval_s, track.shaft, previous_shaft);
    output.wrench_device += wrench_at(hole_force_N, section.shaft.at_m, T_device_plate);
    add_shaft(tissue, section.shaft, track.shaft, output.local);

    const bool begins = track.state != SheetState::kContact;
    const bool may_bear =
        !begins || ((track.state == SheetState::kFree || track.state == SheetState::kShielded) &&
                    track.was_above && !shielded);
    if (may_bear) {
      section.outline = outline_on_lattice(model.tool, T_device_plate, sheet.transform, sheet.z_m);
      section.overlap =
          overlap(sheet, model.tool, section.outline,
                  std::span(track.pending.data(), static_cast<std::size_t>(track.pending_count)));
    }
    track.state = next_state(model, track, shielded, section.overlap.coverage);
    if (may_bear && track.state == SheetState::kMissed)
      enter_old_hole(model, sheet, section, track);
    if (track.state != SheetState::kContact) {
      if (!shielded && track.state != SheetState::kShielded) {
        output.active_sheet = static_cast<std::int32_t>(i);
        output.phase = track.state == SheetState::kPunctured ? ContactPhase::kPunctured
                                                             : ContactPhase::kMissed;
      }
      continue;
    }

    // Compute the force and compare it with the threshold.
    update_rate(penetration_m, penetration_m - previous_m, pose_interval_s, previous.ago_s, track);
    const SheetForce force = sheet_force(model, sheet, static_cast<std::int32_t>(i), section,
                                         prefetched, begins, penetration_m, track);
    output.active_sheet = static_cast<std::int32_t>(i);
    const bool holds = force.force_N <= section.overlap.coverage * sheet.tissue.threshold_N;
    if (!holds && section.overlap.coverage < model.min_coverage) {
      track.state = SheetState::kMissed;  // too little coverage for a hole
      output.phase = ContactPhase::kMissed;
      enter_old_hole(model, sheet, section, track);
      continue;
    }
    shielded = true;
    output.penetration_m = penetration_m;
    if (holds) {
      output.phase = ContactPhase::kContact;
      output.force_N = force.force_N;
      output.stiffness_N_per_m = force.stiffness_N_per_m;
      output.damping_N_s_per_m = force.damping_N_s_per_m;
      output.rate_m_per_s = track.rate_m_per_s;
      add_sheet(force, penetration_m, output.local);
      Eigen::Vector3d point_m = section.shaft.at_m;
      point_m.head<2>() += Eigen::Vector2d(force.offset_m.data());
      output.wrench_device += wrench_at({0, 0, force.force_N}, point_m, T_device_plate);
      continue;
    }
    track.state = SheetState::kPunctured;
    output.phase = ContactPhase::kPunctured;
    output.trial_force_N = force.force_N;
    if (track.pending_count == kMaxPendingHoles) {
      output.backlog = true;
      continue;
    }
    enter_new_hole(model, sheet, section, T_device_plate, track);
    output.punctured_now = true;
    track.pending[track.pending_count++] = section.outline;
    output.cut = {static_cast<std::int32_t>(i), ++track.cuts_requested, section.outline, true};
  }
  if (model.uses_prefetched_stiffness)
    request_prefetch(model, sheets, T_device_plate, state, output);
}

void reset_motion(ContactState& state) noexcept {
  for (SheetTrack& track : state.tracks) {
    track.has_last = false;
    reset_motion(track.shaft);
  }
}

void shift_tool(const ContactModel& model, const Pose& T_device_plate,
                const Eigen::Vector3d& shift_m, ContactState& state) noexcept {
  const double axis_z = (T_device_plate.q * model.tool.axis_plate).z();
  for (SheetTrack& track : state.tracks) {
    track.last_penetration_m -= shift_m.z();
    shift_shaft(-shift_m.z() / axis_z, track.shaft);
  }
}

Wrench wrench_at(const Eigen::Vector3d& force_N, const Eigen::Vector3d& point_m,
                 const Pose& T_device_plate) noexcept {
  Wrench wrench;
  wrench << force_N, (point_m - T_device_plate.p_m).cross(force_N);
  return wrench;
}

}  // namespace trocar::runtime
