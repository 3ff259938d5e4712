// SPDX-License-Identifier: Apache-2.0
// Contact and puncture: each sheet's state machine and the force of the scene's law. One tool,
// sheets stacked along z. (Paper, II.C, Fig. 11 and 12.)
//
// Contract (tests/runtime/contact/contact_test.cpp tests each point):
//  1. Contact begins when the tip passes from above to below a sheet with at least `least_overlap`
//     of the tool outline over material. With less the tool passes beside the sheet, without force
//     but that of a hole (7), until the tip has been above it again. It does so too if it slides
//     off the material later.
//  2. In contact F = k dx + s b dx', at least 0, where dx = z_sheet - z_tip, s is the share of the
//     tool outline over material, and dx' the backward difference of dx over the time since the
//     previous new pose, or since `earlier` if it is given. Times are the device's. Without a new
//     pose dx' is held, and the next pose causes no force spike.
//     By the law `hooke` k = s K, and F acts in the centroid of the area over material. By the law
//     `network` k and the point are the sheet's response, which a worker prepared for a place of
//     the tool near this one; a new response is blended in over kBlend_s, and without any the law
//     `hooke` applies.
//  3. If F would exceed s times the threshold, the sheet is punctured in this tick: the force is
//     zero, and a hole with the tool's outline is requested. In later ticks the sheet exerts only
//     the force of its hole on the shaft (shaft.h), until the tip has been above it. A share that
//     has become less than `least_overlap` is not punctured: the tool slides off it.
//  4. The topmost sheet in contact bears the force. Those below are shielded from the tool until
//     the tick after its puncture, or until the tool slides off it.
//  5. A requested hole counts as open at once, whether its mesh is there or not.
//  6. The tool's outline in a sheet is the section of its prism with the undeformed sheet: a tool
//     that moves along its own axis keeps its outline, however much it is tilted.
//  7. A sheet remembers its last kMaxHoles holes. If the tool passes beside it, or slides off it,
//     with all but less than `least_overlap` of its outline in the nearest kMaxPendingHoles of
//     them, the shaft is in the hole again, as after its puncture: its force acts from the next
//     tick on. A hole over an edge of the sheet acts on the shaft by its share, as the sheet does
//     on the tool: that of its outline over material at the puncture, and in older holes by theirs.
//
// To add a force law: the four places at ForceLawKind (formats/session/scene.h). Its force is a
// case of sheet_force() in puncture.cpp.
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
  ForceLaw law;        ///< with its parameters
  /// Least share of the outline over material with which contact begins. Without this bound a tool
  /// that goes back through its own hole slightly off centre would be in contact with the rim.
  double least_overlap = 0.05;
  /// Height above a sheet below which its response is requested (laws that need one).
  double lookahead_m = 0.03;
};

/// Holes that a sheet remembers.
inline constexpr int kMaxHoles = 64;

/// A hole that was requested: the plate's pose at the puncture gives its outline again.
struct RememberedHole {
  Eigen::Vector2d at_m = Eigen::Vector2d::Zero();  ///< where the tool's axis met the sheet
  Pose T_device_plate;
  double share = 0;  ///< of the outline that the sheet holds (contract 7)
};

enum class SheetState : std::uint8_t { kFree, kContact, kShielded, kPunctured, kBeside };

/// A sheet's response to the tool at one place: force = stiffness * depth, acting `offset_m` (x, y)
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
  double rate_m_per_s = 0;  ///< dx' of the tick before; meaningful in kContact
  SheetResponse blended;    ///< by `network`; meaningful in kContact
  ShaftState shaft;         ///< in_hole only in kPunctured and kBeside
  double shaft_share = 0;   ///< of the hole that the shaft is in
  std::uint32_t cuts_requested = 0;
  /// The k-th hole, from 0, in place k % kMaxHoles; `cuts_requested` in all.
  std::array<RememberedHole, kMaxHoles> holes;
  int pending_count = 0;
  std::array<LatticeOutline, kMaxPendingHoles> pending;  ///< requested, mesh not there yet
};

/// What the haptic thread keeps between ticks.
struct ContactState {
  std::array<SheetTrack, kMaxSceneSlices> tracks;
};

/// A hole to be cut: the `cut`-th (from 1) of sheet `sheet` (an index into the scene's sheets,
/// the topmost first).
struct CutRequest {
  std::int32_t sheet = -1;
  std::uint32_t cut = 0;
  LatticeOutline outline;
  bool is_puncture = true;  ///< else a wall has yielded sideways
};

/// The place of the tool over, or in, the sheet that a response is requested for.
struct ResponseRequest {
  std::int32_t sheet = -1;           ///< -1: none near
  std::array<double, 2> middle_m{};  ///< of the outline: where the axis meets the sheet, in {B}
  LatticeOutline outline;
};

struct ContactOutput {
  Eigen::Vector3d tip_device_m = Eigen::Vector3d::Zero();
  double force_N = 0;  ///< of the sheet in contact, along +z of {B}
  /// Of that force and of the shaft in its holes: on the plate, about its origin, in {B}.
  Wrench wrench_device = Wrench::Zero();
  double penetration_m = 0;  ///< of the active sheet, in contact and in the tick of its puncture
  /// k and s b of the sheet in contact, also where F is 0; else 0.
  double stiffness_N_per_m = 0, damping_N_s_per_m = 0;
  double rate_m_per_s = 0;  ///< dx'
  std::int32_t active_sheet =
      -1;  ///< in contact or punctured in this tick; else the lowest above the tip
  ContactPhase phase = ContactPhase::kFree;
  bool punctured_now = false;  ///< a puncture in this tick: send `cut` to the remesher
  double judged_force_N = 0;   ///< F of the puncture: above s times the threshold, not applied
  CutRequest cut;
  std::span<const CutRequest> body_cuts;  ///< by `cutting`: any number in a tick, else none
  bool backlog = false;  ///< more than kMaxPendingHoles wait for one sheet: `cut` is not valid
  bool not_upright =
      false;               ///< the tool is tilted by more than kMaxTilt_deg: nothing else is valid
  ResponseRequest ahead;   ///< by `network`
  LocalEnvironment local;  ///< the elements of wrench_device

  /// What is to be sent to the remesher.
  std::span<const CutRequest> cuts() const noexcept {
    return punctured_now && body_cuts.empty() ? std::span(&cut, 1) : body_cuts;
  }
};

/// Drops from the track's pending holes those that the mesh in use already has.
void drop_published(const Sheet& sheet, SheetTrack& track) noexcept;

/// One tick. `sheets`: the meshes in use, the topmost first, at most kMaxSceneSlices; a sheet's
/// `cuts` never decreases from tick to tick. `response`: the latest one (`network`).
/// `pose_interval_s`: the time since the previous new pose, on the device's clock; 0: the pose is
/// not new. `earlier`: velocities are taken from there.
/// No allocation; at most one overlap for each sheet that the tip is below and that is not
/// punctured, shielded or passed beside, and kMaxPendingHoles outline_outside() for each that is
/// punctured or passed beside in this tick.
void update_contact(const ContactModel& model, std::span<const Sheet* const> sheets,
                    const SheetResponse& response, const Pose& T_device_plate,
                    double pose_interval_s, ContactState& state, ContactOutput& output,
                    const EarlierPose& earlier = {}) noexcept;

/// For a tick without update_contact: the next one starts without rate and friction. Contact
/// states, punctures and requested holes are kept.
void reset_motion(ContactState& state) noexcept;

/// The tool was moved by `shift_m` without a force, such as a proxy that a puncture released: the
/// rates of the next tick do not count it.
void shift_tool(const ContactModel& model, const Pose& T_device_plate,
                const Eigen::Vector3d& shift_m, ContactState& state) noexcept;

/// A force that acts on the plate at a point, both in {B}, as a wrench about the plate's origin.
Wrench wrench_at(const Eigen::Vector3d& force_N, const Eigen::Vector3d& point_m,
                 const Pose& T_device_plate) noexcept;

}  // namespace trocar::runtime
