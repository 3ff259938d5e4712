// SPDX-License-Identifier: Apache-2.0
#include "runtime/contact/puncture.h"

#include <algorithm>

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
}

}  // namespace

void update_contact(const ContactModel& model, std::span<const Sheet* const> sheets,
                    const Pose& T_device_plate, ContactState& state,
                    ContactOutput& output) noexcept {
  output = ContactOutput{};
  output.tip_device_m = T_device_plate * model.tool.tip_plate_m;
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

    // Who is met, and how much of the tool it has under it.
    LatticeOutline outline;
    double overlap = 0;
    const auto look = [&] {
      outline = outline_on_lattice(model.tool, T_device_plate, sheet.transform);
      overlap = overlap_fraction(
          sheet, outline,
          std::span(track.pending.data(), static_cast<std::size_t>(track.pending_count)));
    };
    if (track.state == SheetState::kFree || track.state == SheetState::kShielded) {
      if (!track.was_above) {
        track.state = SheetState::kBeside;  // the session began below it
      } else if (borne) {
        track.state = SheetState::kShielded;
      } else {
        look();
        track.state = overlap >= model.least_overlap ? SheetState::kContact : SheetState::kBeside;
      }
    } else if (track.state == SheetState::kContact) {
      look();
      if (overlap == 0) track.state = SheetState::kBeside;  // slid off the material
    }
    if (track.state != SheetState::kContact) {
      if (!borne && track.state != SheetState::kShielded) {
        output.active_sheet = static_cast<std::int32_t>(i);
        output.phase = track.state == SheetState::kPunctured ? ContactPhase::kPunctured
                                                             : ContactPhase::kBeside;
      }
      continue;
    }

    // The force, and whether the sheet stands it.
    const double rate_m_per_s =
        track.has_last ? (penetration_m - track.last_penetration_m) / model.dt_s : 0;
    track.last_penetration_m = penetration_m;
    track.has_last = true;
    const double force_N = std::max(0.0, overlap * (model.tissue.stiffness_N_per_m * penetration_m +
                                                    model.tissue.damping_N_s_per_m * rate_m_per_s));
    borne = true;
    output.active_sheet = static_cast<std::int32_t>(i);
    output.penetration_m = penetration_m;
    if (force_N <= model.tissue.threshold_N) {
      output.phase = ContactPhase::kContact;
      output.force_N = force_N;
      continue;
    }
    track.state = SheetState::kPunctured;
    output.phase = ContactPhase::kPunctured;
    output.judged_force_N = force_N;
    if (track.pending_count == kMaxPendingHoles) {
      output.backlog = true;
      continue;
    }
    output.gave_way = true;
    track.pending[track.pending_count++] = outline;
    output.cut = {static_cast<std::int32_t>(i), ++track.cuts_requested, outline};
  }
}

Wrench contact_wrench(const ContactOutput& contact, const Pose& T_device_plate) noexcept {
  const Eigen::Vector3d force_N(0, 0, contact.force_N);
  const Eigen::Vector3d lever_m = contact.tip_device_m - T_device_plate.p_m;
  Wrench wrench;
  wrench << force_N, lever_m.cross(force_N);
  return wrench;
}

}  // namespace trocar::runtime
