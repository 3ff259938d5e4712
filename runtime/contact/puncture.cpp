// SPDX-License-Identifier: Apache-2.0
#include "runtime/contact/puncture.h"

#include <algorithm>
#include <array>
#include <span>

#include "runtime/contact/overlap.h"

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
  ShaftPlace shaft;
};

ShaftPlace shaft_place(const ContactModel& model, const Sheet& sheet, const Pose& T_device_plate,
                       double penetration_m) noexcept {
  const Eigen::Vector3d axis = T_device_plate.q * model.tool.axis_plate;
  return {axis_at(model.tool, T_device_plate, sheet.z_m), axis, penetration_m / axis.z()};
}

/// What a hole that the sheet holds by this share exerts on the shaft.
ShaftTissue held_by(const ShaftTissue& tissue, double share) noexcept {
  ShaftTissue held = tissue;
  held.dry_friction_N *= share;
  held.viscous_friction_N_s_per_m *= share;
  held.rim_stiffness_N_per_m *= share;
  return held;
}

/// The holes that a sheet remembers around one place of the tool.
struct HolesAround {
  double outside = 1;  ///< share of the tool's outline outside; below least_overlap a bound
  double share = 0;    ///< RememberedHole::share of the nearest
};

HolesAround holes_around(const ContactModel& model, const Sheet& sheet, const SheetTrack& track,
                         const ToolSection& place) noexcept {
  HolesAround around;
  std::array<const RememberedHole*, kMaxHoles> hole;
  const std::size_t known = std::min(static_cast<std::size_t>(track.cuts_requested), hole.size());
  for (std::size_t k = 0; k < known; ++k)
    hole[k] = &track.holes[k];
  std::array<LatticeOutline, kMaxPendingHoles> outlines;
  const std::size_t count = std::min(known, outlines.size());
  if (count == 0) return around;
  const Eigen::Vector2d at_m = place.shaft.at_m.head<2>();
  std::partial_sort(hole.begin(), hole.begin() + count, hole.begin() + known,
                    [&](const RememberedHole* a, const RememberedHole* b) {
                      return (a->at_m - at_m).squaredNorm() < (b->at_m - at_m).squaredNorm();
                    });
  around.share = hole[0]->share;
  // Mostly the nearest is enough; each more makes the cutting off take longer.
  for (std::size_t k = 0; k < count && !(around.outside < model.least_overlap); ++k) {
    outlines[k] =
        outline_on_lattice(model.tool, hole[k]->T_device_plate, sheet.transform, sheet.z_m);
    around.outside = outline_outside(model.tool, place.outline, std::span(outlines.data(), k + 1));
  }
  return around;
}

/// The tool is beside the sheet now: in one of its holes, or without force.
void enter_old_hole(const ContactModel& model, const Sheet& sheet, const ToolSection& place,
                    SheetTrack& track) noexcept {
  const HolesAround around = holes_around(model, sheet, track, place);
  if (!(around.outside < model.least_overlap)) return;
  enter_hole(place.shaft, track.shaft);
  track.shaft_share = around.share;
}

/// The tool is in the hole of its puncture. Remembers it as the latest of the sheet.
void enter_new_hole(const ContactModel& model, const Sheet& sheet, const ToolSection& place,
                    const Pose& T_device_plate, SheetTrack& track) noexcept {
  double share = place.overlap.fraction;
  if (share < 1) {
    const HolesAround around = holes_around(model, sheet, track, place);
    share = std::min(1.0, share + (1 - around.outside) * around.share);
  }
  enter_hole(place.shaft, track.shaft);
  track.shaft_share = share;
  track.holes[track.cuts_requested % track.holes.size()] = {place.shaft.at_m.head<2>(),
                                                            T_device_plate, share};
}

/// The contact state of a sheet that the tip is below. `shielded`: a sheet above it bears the tool,
/// or was punctured in this tick.
SheetState next_state(const ContactModel& model, const SheetTrack& track, bool shielded,
                      double overlapped) noexcept {
  switch (track.state) {
    case SheetState::kFree:
    case SheetState::kShielded:
      if (!track.was_above) return SheetState::kBeside;  // the session began below it
      if (shielded) return SheetState::kShielded;
      return overlapped >= model.least_overlap ? SheetState::kContact : SheetState::kBeside;
    case SheetState::kContact:
      return overlapped == 0 ? SheetState::kBeside : SheetState::kContact;  // slid off
    case SheetState::kPunctured:
    case SheetState::kBeside:
      break;
  }
  return track.state;
}

/// The law `hooke`: K times the overlap, in the centroid of the overlapped area.
SheetResponse hooke_response(const Sheet& sheet, std::int32_t index,
                             const ToolSection& place) noexcept {
  SheetResponse response;
  response.sheet = index;
  response.stiffness_N_per_m = place.overlap.fraction * sheet.tissue.stiffness_N_per_m;
  const Eigen::Vector2d offset_m =
      sheet.transform.to_scene(place.overlap.centroid_steps) - place.shaft.at_m.head<2>();
  response.offset_m = {offset_m.x(), offset_m.y()};
  return response;
}

/// The law `network`: the track's response, moved towards `target` by one tick's share. In the
/// first tick of a contact it is `target` at once.
SheetResponse blended_response(const ContactModel& model, const SheetResponse& target, bool begins,
                               SheetTrack& track) noexcept {
  if (begins) return track.blended = target;
  const double share = std::min(1.0, model.dt_s / kBlend_s);
  track.blended.sheet = target.sheet;
  track.blended.stiffness_N_per_m +=
      share * (target.stiffness_N_per_m - track.blended.stiffness_N_per_m);
  for (std::size_t k = 0; k < 2; ++k)
    track.blended.offset_m[k] += share * (target.offset_m[k] - track.blended.offset_m[k]);
  return track.blended;
}

/// The force of a sheet on the tool at one penetration (contract 2).
struct SheetForce {
  double force_N = 0;
  double stiffness_N_per_m = 0, damping_N_s_per_m = 0;
  std::array<double, 2> offset_m{};  ///< where it acts, from the middle of the tool's outline
};

/// Computes the force of every force law; a new law gets its case here.
SheetForce sheet_force(const ContactModel& model, const Sheet& sheet, std::int32_t index,
                       const ToolSection& place, const SheetResponse& latest, bool begins,
                       double penetration_m, SheetTrack& track) noexcept {
  SheetResponse response = hooke_response(sheet, index, place);
  switch (model.law.kind) {
    case ForceLawKind::kHooke:
    case ForceLawKind::kCutting:  // has no sheets: body_contact.h
      break;
    case ForceLawKind::kNetwork:
      response = blended_response(model, latest.sheet == index ? latest : response, begins, track);
      break;
  }
  SheetForce out;
  out.stiffness_N_per_m = response.stiffness_N_per_m;
  out.damping_N_s_per_m = place.overlap.fraction * sheet.tissue.damping_N_s_per_m;
  out.force_N = std::max(
      0.0, out.stiffness_N_per_m * penetration_m + out.damping_N_s_per_m * track.rate_m_per_s);
  out.offset_m = response.offset_m;
  return out;
}

void add_sheet(const SheetForce& force, double penetration_m, LocalEnvironment& local) noexcept {
  local.sheet_N = force.stiffness_N_per_m * penetration_m;
  local.sheet_N_per_m = force.stiffness_N_per_m;
  local.sheet_N_s_per_m = force.damping_N_s_per_m;
  local.stored_J += 0.5 * force.stiffness_N_per_m * penetration_m * penetration_m;
}

/// Requests the response that will be needed next: of the topmost sheet that is neither punctured
/// nor passed beside, if it is near.
void request_response(const ContactModel& model, std::span<const Sheet* const> sheets,
                      const Pose& T_device_plate, const ContactState& state,
                      ContactOutput& output) noexcept {
  for (std::size_t i = 0; i < sheets.size(); ++i) {
    const SheetState now = state.tracks[i].state;
    if (now == SheetState::kPunctured || now == SheetState::kBeside) continue;
    if (output.tip_device_m.z() - sheets[i]->z_m > model.lookahead_m) return;
    const Eigen::Vector3d middle_m = axis_at(model.tool, T_device_plate, sheets[i]->z_m);
    output.ahead.sheet = static_cast<std::int32_t>(i);
    output.ahead.middle_m = {middle_m.x(), middle_m.y()};
    output.ahead.outline =
        outline_on_lattice(model.tool, T_device_plate, sheets[i]->transform, sheets[i]->z_m);
    return;
  }
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
                    const SheetResponse& response, const Pose& T_device_plate,
                    double pose_interval_s, ContactState& state, ContactOutput& output,
                    const EarlierPose& earlier) noexcept {
  output = ContactOutput{};
  output.tip_device_m = T_device_plate * model.tool.tip_plate_m;
  output.not_upright = !is_upright(model.tool, T_device_plate);
  if (output.not_upright) return;
  const double earlier_tip_z_m = (earlier.T_device_plate * model.tool.tip_plate_m).z();
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
    ToolSection place;
    place.shaft = shaft_place(model, sheet, T_device_plate, penetration_m);
    const ShaftTissue held = held_by(sheet.tissue.shaft, track.shaft_share);
    const double earlier_m = sheet.z_m - earlier_tip_z_m;
    EarlierShaft earlier_shaft;
    if (track.shaft.in_hole && earlier.ago_s > 0) {
      earlier_shaft = {shaft_place(model, sheet, earlier.T_device_plate, earlier_m).inserted_m,
                       earlier.ago_s};
    }
    const Eigen::Vector3d hole_force_N =
        shaft_force(held, place.shaft, pose_interval_s, track.shaft, earlier_shaft);
    output.wrench_device += wrench_at(hole_force_N, place.shaft.at_m, T_device_plate);
    add_shaft(held, place.shaft, track.shaft, output.local);

    const bool begins = track.state != SheetState::kContact;
    const bool may_bear =
        !begins || ((track.state == SheetState::kFree || track.state == SheetState::kShielded) &&
                    track.was_above && !shielded);
    if (may_bear) {
      place.outline = outline_on_lattice(model.tool, T_device_plate, sheet.transform, sheet.z_m);
      place.overlap =
          overlap(sheet, model.tool, place.outline,
                  std::span(track.pending.data(), static_cast<std::size_t>(track.pending_count)));
    }
    track.state = next_state(model, track, shielded, place.overlap.fraction);
    if (may_bear && track.state == SheetState::kBeside) {
      enter_old_hole(model, sheet, place, track);
    }
    if (track.state != SheetState::kContact) {
      if (!shielded && track.state != SheetState::kShielded) {
        output.active_sheet = static_cast<std::int32_t>(i);
        output.phase = track.state == SheetState::kPunctured ? ContactPhase::kPunctured
                                                             : ContactPhase::kBeside;
      }
      continue;
    }

    // The force, and whether it exceeds the threshold.
    if (!track.has_last) {
      track.rate_m_per_s = 0;
    } else if (pose_interval_s > 0) {
      track.rate_m_per_s = earlier.ago_s > 0
                               ? (penetration_m - earlier_m) / earlier.ago_s
                               : (penetration_m - track.last_penetration_m) / pose_interval_s;
    }
    track.last_penetration_m = penetration_m;
    track.has_last = true;
    const SheetForce force = sheet_force(model, sheet, static_cast<std::int32_t>(i), place,
                                         response, begins, penetration_m, track);
    output.active_sheet = static_cast<std::int32_t>(i);
    const bool holds = force.force_N <= place.overlap.fraction * sheet.tissue.threshold_N;
    if (!holds && place.overlap.fraction < model.least_overlap) {
      track.state = SheetState::kBeside;  // too little for a hole
      output.phase = ContactPhase::kBeside;
      enter_old_hole(model, sheet, place, track);
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
      Eigen::Vector3d point_m = place.shaft.at_m;
      point_m.head<2>() += Eigen::Vector2d(force.offset_m.data());
      output.wrench_device += wrench_at({0, 0, force.force_N}, point_m, T_device_plate);
      continue;
    }
    track.state = SheetState::kPunctured;
    output.phase = ContactPhase::kPunctured;
    output.judged_force_N = force.force_N;
    if (track.pending_count == kMaxPendingHoles) {
      output.backlog = true;
      continue;
    }
    enter_new_hole(model, sheet, place, T_device_plate, track);
    output.punctured_now = true;
    track.pending[track.pending_count++] = place.outline;
    output.cut = {static_cast<std::int32_t>(i), ++track.cuts_requested, place.outline, true};
  }
  if (needs_response(model.law.kind)) {
    request_response(model, sheets, T_device_plate, state, output);
  }
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
