// SPDX-License-Identifier: Apache-2.0
// Contact and puncture (paper, II.C, Fig. 11 and 12): each sheet's state machine and the force of
// the scene's law. One tool, sheets stacked along z.
//
// Laws (tests/runtime/contact/contact_test.cpp tests each):
//  1. A sheet is met when the tip passes from above to below it with material under the tool;
//     with none it is passed beside, without force, until the tip is above it again.
//  2. In contact F = k dx + overlap b dx', at least 0, with dx = z_sheet - z_tip, dx' its backward
//     difference over the time since the last new pose (where there is none it stays as it was: a
//     device's silence is no stop, and what comes after it no blow) and overlap the share of the
//     tool's outline that has material. By `hooke` k = overlap K, and the force acts in the middle
//     of the overlapped area; by `network` k and the point are the sheet's response, found off this
//     thread for a place of the tool next to this one. A new response is blended in over kBlend_s;
//     without any, `hooke` holds.
//  3. If F would exceed the threshold, the sheet gives way in this very tick: the force is
//     zero, and a hole of the tool's outline is asked for. No later tick feels that sheet, but
//     for what its hole does to the shaft (shaft.h), until the tip has been above it.
//  4. The topmost sheet in contact bears the force; those below are shielded from the tool until
//     a later tick than that in which it gives way.
//  5. A hole asked for counts as open at once, whether its mesh is there or not.
//  6. The tool's outline in a sheet is its prism's section with the sheet at rest: what goes
//     down along its own axis keeps its place there, however much it is tilted.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/contact/shaft.h"
#include "runtime/contact/sheet.h"
#include "runtime/contact/tool.h"

namespace trocar::runtime {

/// Time constant with which a new response replaces the old one in contact.
inline constexpr double kBlend_s = 0.005;

/// What stays the same through a session.
struct ContactModel {
  Tool tool;
  double dt_s = 1e-3;  ///< of a tick
  ForceLawKind law = ForceLawKind::kHooke;
  /// Share of the outline that must lie over material for a sheet to be met. Without it a
  /// tool that goes back through its own hole a hair off would feel the rim as a full sheet does.
  double least_overlap = 0.05;
  /// How far above a sheet the tool is when its response is asked for (law 2, `network`).
  double lookahead_m = 0.03;
};

enum class SheetState : std::uint8_t { kFree, kContact, kShielded, kPunctured, kBeside };

/// How a sheet answers the tool at some place: force = stiffness * depth, acting `offset_m` (x, y)
/// from the middle of the tool's outline.
struct SheetResponse {
  std::int32_t sheet = -1;  ///< -1: none
  double stiffness_N_per_m = 0;
  std::array<double, 2> offset_m{};
};

struct SheetTrack {
  SheetState state = SheetState::kFree;
  bool was_above = false;         ///< the tip has been above the sheet
  double last_penetration_m = 0;  ///< of the tick before; meaningful in kContact
  bool has_last = false;
  double rate_m_per_s = 0;  ///< dx' of law 2, in the tick before; meaningful in kContact
  SheetResponse blended;    ///< law 2, `network`; meaningful in kContact
  ShaftState shaft;         ///< in_hole only in kPunctured
  std::uint32_t cuts_requested = 0;
  int pending_count = 0;
  std::array<LatticeOutline, kMaxPendingHoles> pending;  ///< asked for, mesh not there yet
};

/// The haptic thread's memory between ticks.
struct ContactState {
  std::array<SheetTrack, kMaxSceneSlices> tracks;
};

/// A hole to be cut: the `cut`-th (from 1) of sheet `sheet` (an index into the scene's sheets,
/// the topmost first).
struct CutRequest {
  std::int32_t sheet = -1;
  std::uint32_t cut = 0;
  LatticeOutline outline;
};

/// Where the tool is about to meet a sheet, or meets it: what a response is wanted for.
struct ResponseRequest {
  std::int32_t sheet = -1;           ///< -1: none near
  std::array<double, 2> middle_m{};  ///< of the outline: where the axis meets the sheet, in {B}
  LatticeOutline outline;
};

struct ContactOutput {
  Eigen::Vector3d tip_device_m = Eigen::Vector3d::Zero();
  double force_N = 0;  ///< of the sheet in contact, along +z of {B}
  /// Of that and of the shaft in its holes, on the plate, about its origin, in {B}.
  Wrench wrench_device = Wrench::Zero();
  double penetration_m = 0;  ///< of the active sheet, while in contact or giving way
  /// Of law 2, of the sheet in contact; else 0. What damps is also where there is no force.
  double stiffness_N_per_m = 0, damping_N_s_per_m = 0;
  double rate_m_per_s = 0;         ///< dx'
  std::int32_t active_sheet = -1;  ///< in contact or giving way; else the lowest one above the tip
  ContactPhase phase = ContactPhase::kFree;
  bool gave_way = false;      ///< law 3 happened: `cut` is to be sent to the remesher
  double judged_force_N = 0;  ///< what would have exceeded the threshold
  CutRequest cut;
  bool backlog = false;  ///< more than kMaxPendingHoles wait on one sheet: `cut` is not valid
  bool not_upright =
      false;              ///< the tool is tilted by more than kMaxTilt_deg: nothing else is valid
  ResponseRequest ahead;  ///< by `network`
};

/// One tick. `sheets` are the meshes in use, the topmost first, at most kMaxSceneSlices; a
/// sheet's `cuts` never decreases from tick to tick. `response`: the latest there is (`network`).
/// `moved_over_s`: the time in which the plate came here from its pose in the tick before; 0: there
/// is no new pose, this is the same one.
/// No allocation; at most one overlap for each sheet that the tip is below and that is not
/// punctured, shielded or passed beside.
void update_contact(const ContactModel& model, std::span<const Sheet* const> sheets,
                    const SheetResponse& response, const Pose& T_device_plate, double moved_over_s,
                    ContactState& state, ContactOutput& output) noexcept;

/// A tick without update_contact: the next one knows no rate and no friction from before. What was
/// met, punctured and asked for stays.
void forget_motion(ContactState& state) noexcept;

/// A force that acts on the plate at a point, both in {B}, as a wrench about the plate's origin.
Wrench wrench_at(const Eigen::Vector3d& force_N, const Eigen::Vector3d& point_m,
                 const Pose& T_device_plate) noexcept;

}  // namespace trocar::runtime
