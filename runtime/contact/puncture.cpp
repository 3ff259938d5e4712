// SPDX-License-Identifier: Apache-2.0
#include "runtime/contact/puncture.h"

#include <algorithm>

#include "runtime/contact/overlap.h"

namespace trocar::runtime {
namespace {

/// Forgets the holes that the mesh in use has.
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

void back_above(SheetTrack& track) noexcept {
  track.state = SheetState::kFree;
  track.was_above = true;
  track.has_last = false;
  track.shaft.in_hole = false;
}

/// The tool in one sheet's plane.
struct Place {
  LatticeOutline outline;
  Overlap overlap;
  ShaftPlace shaft;
};

ShaftPlace shaft_place(const ContactModel& model, const Sheet& sheet, const Pose& T_device_plate,
                       double penetration_m) noexcept {
  const Eigen::Vector3d axis = T_device_plate.q * model.tool.axis_plate;
  return {axis_at(model.tool, T_device_plate, sheet.z_m), axis, penetration_m / axis.z()};
}

/// Who is met: the state after the tip has come below the sheet or stays there.
SheetState next_state(const ContactModel& model, const SheetTrack& track, bool borne,
                      double overlapped) noexcept {
  switch (track.state) {
    case SheetState::kFree:
    case SheetState::kShielded:
      if (!track.was_above) return SheetState::kBeside;  // the session began below it
      if (borne) return SheetState::kShielded;
      return overlapped >= model.least_overlap ? SheetState::kContact : SheetState::kBeside;
    case SheetState::kContact:
      return overlapped == 0 ? SheetState::kBeside : SheetState::kContact;  // slid off
    case SheetState::kPunctured:
    case SheetState::kBeside:
      break;
  }
  return track.state;
}

/// Law 2: stiffness and the point where the force acts, relative to the outline's middle.
SheetResponse respond(const ContactModel& model, const Sheet& sheet, std::int32_t index,
                      const Place& place, const SheetResponse& latest, bool begins,
                      SheetTrack& track) noexcept {
  SheetResponse target;
  target.sheet = index;
  target.stiffness_N_per_m = place.overlap.fraction * sheet.tissue.stiffness_N_per_m;
  const Eigen::Vector2d offset_m =
      sheet.transform.to_scene(place.overlap.centroid_steps) - place.shaft.at_m.head<2>();
  target.offset_m = {offset_m.x(), offset_m.y()};
  if (model.law == ForceLawKind::kHooke) return target;
  if (latest.sheet == index) target = latest;
  if (begins) return track.blended = target;
  const double share = std::min(1.0, model.dt_s / kBlend_s);
  track.blended.sheet = index;
  track.blended.stiffness_N_per_m +=
      share * (target.stiffness_N_per_m - track.blended.stiffness_N_per_m);
  for (std::size_t k = 0; k < 2; ++k)
    track.blended.offset_m[k] += share * (target.offset_m[k] - track.blended.offset_m[k]);
  return track.blended;
}

/// The sheet whose response will be wanted next: the topmost that still bears, if near.
void look_ahead(const ContactModel& model, std::span<const Sheet* const> sheets,
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

void update_contact(const ContactModel& model, std::span<const Sheet* const> sheets,
                    const SheetResponse& response, const Pose& T_device_plate, double moved_over_s,
                    ContactState& state, ContactOutput& output) noexcept {
  output = ContactOutput{};
  output.tip_device_m = T_device_plate * model.tool.tip_plate_m;
  output.not_upright = !is_upright(model.tool, T_device_plate);
  if (output.not_upright) return;
  bool borne = false;  // a sheet above holds the tool, or gave way in this tick
  for (std::size_t i = 0; i < sheets.size(); ++i) {
    const Sheet& sheet = *sheets[i];
    SheetTrack& track = state.tracks[i];
    drop_published(sheet, track);
    const double penetration_m = sheet.z_m - output.tip_device_m.z();
    if (!(penetration_m > 0)) {
      back_above(track);
      continue;
    }
    Place place;
    place.shaft = shaft_place(model, sheet, T_device_plate, penetration_m);
    const Eigen::Vector3d hole_force_N =
        shaft_force(sheet.tissue.shaft, place.shaft, moved_over_s, track.shaft);
    output.wrench_device += wrench_at(hole_force_N, place.shaft.at_m, T_device_plate);

    const bool begins = track.state != SheetState::kContact;
    const bool may_bear =
        !begins || ((track.state == SheetState::kFree || track.state == SheetState::kShielded) &&
                    track.was_above && !borne);
    if (may_bear) {
      place.outline = outline_on_lattice(model.tool, T_device_plate, sheet.transform, sheet.z_m);
      place.overlap =
          overlap(sheet, model.tool, place.outline,
                  std::span(track.pending.data(), static_cast<std::size_t>(track.pending_count)));
    }
    track.state = next_state(model, track, borne, place.overlap.fraction);
    if (track.state != SheetState::kContact) {
      if (!borne && track.state != SheetState::kShielded) {
        output.active_sheet = static_cast<std::int32_t>(i);
        output.phase = track.state == SheetState::kPunctured ? ContactPhase::kPunctured
                                                             : ContactPhase::kBeside;
      }
      continue;
    }

    // The force, and whether the sheet stands it.
    if (!track.has_last) {
      track.rate_m_per_s = 0;
    } else if (moved_over_s > 0) {
      track.rate_m_per_s = (penetration_m - track.last_penetration_m) / moved_over_s;
    }
    track.last_penetration_m = penetration_m;
    track.has_last = true;
    const SheetResponse answer =
        respond(model, sheet, static_cast<std::int32_t>(i), place, response, begins, track);
    const double damping_N_s_per_m = place.overlap.fraction * sheet.tissue.damping_N_s_per_m;
    const double force_N = std::max(
        0.0, answer.stiffness_N_per_m * penetration_m + damping_N_s_per_m * track.rate_m_per_s);
    borne = true;
    output.active_sheet = static_cast<std::int32_t>(i);
    output.penetration_m = penetration_m;
    if (force_N <= sheet.tissue.threshold_N) {
      output.phase = ContactPhase::kContact;
      output.force_N = force_N;
      output.stiffness_N_per_m = answer.stiffness_N_per_m;
      output.damping_N_s_per_m = damping_N_s_per_m;
      output.rate_m_per_s = track.rate_m_per_s;
      Eigen::Vector3d point_m = place.shaft.at_m;
      point_m.head<2>() += Eigen::Vector2d(answer.offset_m.data());
      output.wrench_device += wrench_at({0, 0, force_N}, point_m, T_device_plate);
      continue;
    }
    track.state = SheetState::kPunctured;
    output.phase = ContactPhase::kPunctured;
    output.judged_force_N = force_N;
    if (track.pending_count == kMaxPendingHoles) {
      output.backlog = true;
      continue;
    }
    enter_hole(place.shaft, track.shaft);
    output.gave_way = true;
    track.pending[track.pending_count++] = place.outline;
    output.cut = {static_cast<std::int32_t>(i), ++track.cuts_requested, place.outline};
  }
  if (model.law == ForceLawKind::kNetwork) {
    look_ahead(model, sheets, T_device_plate, state, output);
  }
}

void forget_motion(ContactState& state) noexcept {
  for (SheetTrack& track : state.tracks) {
    track.has_last = false;
    forget_motion(track.shaft);
  }
}

Wrench wrench_at(const Eigen::Vector3d& force_N, const Eigen::Vector3d& point_m,
                 const Pose& T_device_plate) noexcept {
  Wrench wrench;
  wrench << force_N, (point_m - T_device_plate.p_m).cross(force_N);
  return wrench;
}

}  // namespace trocar::runtime
