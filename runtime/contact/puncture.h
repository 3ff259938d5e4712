// SPDX-License-Identifier: Apache-2.0
// Contact and puncture of separate sheets, for the force laws `hooke` and `network`: the state machine of
// each sheet, and its force on the tool. There is one tool, and the sheets are stacked along z. (Paper,
// II.C, Fig. 11 and 12.)
//
// Contract (tests/runtime/contact/contact_test.cpp tests each point):
//  1. Coverage is the fraction of the area of the tool's outline that lies over material. Contact begins
//     when the tip passes from above to below a sheet with a coverage of at least `min_coverage`. With less
//     coverage the tool misses the sheet. A missed sheet exerts no force until the tip has been above it
//     again. The only exception is the force of a hole that the shaft is in (item 7). A tool in contact
//     that later slides off the material has also missed the sheet.
//  2. In contact the force is F = k dx + c b dx', but at least 0. The penetration is dx = z_sheet - z_tip,
//     and c is the coverage. K and b are the tissue's stiffness and damping. The rate dx' is the change of
//     dx since the previous new pose, divided by the time between the two poses on the device's clock. If
//     update_contact() is given the argument `previous`, that pose is used instead of the previous new
//     pose. In a tick without a new pose dx' keeps its value, so that the next new pose causes no force
//     spike. With the force law `hooke`, k = c K, and F acts at the centroid of the covered area. With the
//     force law `network`, k and the point of action come from the prefetched stiffness, which a worker
//     computed for a tool position near the present one. A new prefetched stiffness replaces the old one
//     gradually, with the time constant kBlend_s. Until the first one is ready, the law `hooke` applies.
//  3. If F would exceed c times the threshold, the sheet is punctured in this tick: the force is zero, and
//     a hole with the tool's outline is requested. In later ticks, until the tip has been above the sheet,
//     the sheet exerts only the force of its hole on the shaft (shaft.h). If the coverage has dropped below
//     `min_coverage`, the tool slides off the sheet instead of puncturing it.
//  4. The topmost sheet in contact bears the force. It shields the sheets below it: the tool does not touch
//     them until the tick after the topmost sheet is punctured, or until the tool slides off that sheet.
//  5. A requested hole takes effect immediately, even before the remesher has cut it into the mesh.
//  6. The tool's outline in a sheet is the section of the tool's prism with the undeformed sheet. So a tool
//     that moves along its own axis keeps its outline, however much it is tilted.
//  7. A sheet remembers its last kMaxHoles holes. If the tool misses the sheet or slides off it, the tool's
//     outline is compared with the remembered holes nearest to the tool, at most kMaxPendingHoles of them.
//     If the part of the outline outside of all these holes is less than `min_coverage`, the shaft has
//     returned to the nearest hole. The force of this hole then acts from the next tick on, as after a
//     puncture. The forces of a hole are multiplied by the hole's coverage. This coverage is the tool's
//     coverage at the puncture plus, if the outline then overlapped older holes, the overlapping part times
//     the coverage of the nearest of these holes. It is at most 1.
// Tests: tests/runtime/contact/contact_test.cpp
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

/// Time constant with which a new prefetched stiffness replaces the old one in contact.
inline constexpr double kBlend_s = 0.005;

/// Parameters of contact, constant during a session.
struct ContactModel {
  Tool tool;
  double dt_s = 1e-3;                      ///< duration of a tick
  bool uses_prefetched_stiffness = false;  ///< force law `network`
  /// Smallest coverage with which contact begins. Without this bound, a tool that returns through its own
  /// hole slightly off centre would touch the rim and come into contact again.
  double min_coverage = 0.05;
  /// The stiffness of a sheet is prefetched only if the tip is at most this far above the sheet.
  double prefetch_height_m = 0.03;
};

/// Number of holes that a sheet remembers.
inline constexpr int kMaxHoles = 64;

/// A hole that was requested. Its outline can be computed again from the plate's pose at the puncture.
struct RememberedHole {
  Eigen::Vector2d at_m =
      Eigen::Vector2d::Zero();  ///< intersection of the tool's axis and the sheet
  Pose T_device_plate;
  double coverage = 0;  ///< factor on the forces of the hole (contract 7)
};

enum class SheetState : std::uint8_t { kFree, kContact, kShielded, kPunctured, kMissed };

/// Response of a sheet to the tool at one position. The force is `stiffness_N_per_m` times the depth. The
/// vector `offset_m` (x, y) points from the intersection of the tool's axis and the sheet to the point
/// where the force acts.
struct PrefetchedStiffness {
  std::int32_t sheet = -1;  ///< index of the sheet; -1: none
  double stiffness_N_per_m = 0;
  std::array<double, 2> offset_m{};
};

struct SheetTrack {
  SheetState state = SheetState::kFree;
  bool was_above = false;         ///< the tip has been above the sheet
  double last_penetration_m = 0;  ///< penetration in the previous tick; meaningful in kContact
  bool has_last = false;
  double rate_m_per_s = 0;      ///< dx' in the previous tick; meaningful in kContact
  PrefetchedStiffness blended;  ///< force law `network`; meaningful in kContact
  ShaftState shaft;             ///< in_hole can be true only in kPunctured and kMissed
  double hole_coverage = 0;     ///< RememberedHole::coverage of the hole that the shaft is in
  std::uint32_t cuts_requested = 0;
  /// Hole number k, counted from 0, has the index k % kMaxHoles. There have been `cuts_requested` holes.
  std::array<RememberedHole, kMaxHoles> holes;
  int pending_count = 0;
  std::array<LatticeOutline, kMaxPendingHoles> pending;  ///< holes not yet cut into the mesh
};

/// State kept between ticks, for the haptic thread only.
struct ContactState {
  std::array<SheetTrack, kMaxSceneSlices> tracks;
};

/// A hole to be cut. `sheet`: index of the sheet, the topmost first. `cut`: number of the hole in that
/// sheet, counted from 1.
struct CutRequest {
  std::int32_t sheet = -1;
  std::uint32_t cut = 0;
  LatticeOutline outline;
  bool is_puncture = true;  ///< false: a hole's wall has yielded sideways
};

/// Position of the tool over or in the sheet whose stiffness is to be prefetched.
struct PrefetchRequest {
  std::int32_t sheet = -1;  ///< index of the sheet; -1: none is near
  std::array<double, 2>
      middle_m{};  ///< intersection of the tool's axis and the sheet, x and y in {B}
  LatticeOutline outline;
};

/// Result of a tick of any force law.
struct ContactOutput {
  Eigen::Vector3d tip_device_m = Eigen::Vector3d::Zero();
  double force_N = 0;  ///< force of the sheet in contact on the tip, along +z of {B}
  /// Wrench of the tissue on the tool, about the plate's origin, in {B}. It consists of force_N and the
  /// force of the holes on the shaft.
  Wrench wrench_device = Wrench::Zero();
  double penetration_m =
      0;  ///< depth below the active sheet, in contact and in the tick of its puncture
  /// k and c b (contract 2) of the sheet in contact, even if F is 0; 0 without contact.
  double stiffness_N_per_m = 0, damping_N_s_per_m = 0;
  double rate_m_per_s = 0;  ///< dx' of the sheet in contact
  /// The sheet in contact or punctured in this tick; otherwise the lowest one above the tip.
  std::int32_t active_sheet = -1;
  ContactPhase phase = ContactPhase::kFree;
  bool punctured_now = false;  ///< a sheet is punctured in this tick
  double trial_force_N = 0;    ///< F of the tick of a puncture, above the threshold; not applied
  CutRequest cut;              ///< the puncture's hole, unless `cut_list` is used
  std::span<const CutRequest> cut_list;  ///< requests of a law that makes several in a tick
  bool backlog = false;  ///< more than kMaxPendingHoles wait for one sheet; `cut` is invalid
  bool not_upright =
      false;  ///< the tool is tilted by more than kMaxTilt_deg; no other member is valid
  PrefetchRequest prefetch;  ///< next request for the law's prefetch worker
  LocalEnvironment local;    ///< springs, dampers and friction whose forces add up to wrench_device

  // ForceLaw::update() fills these members, for the loop and the session.

  Pose T_device_evaluated;               ///< pose at which the law was evaluated
  Wrench wrench_plate = Wrench::Zero();  ///< wrench to render on the plate at full authority
  double stored_J = 0;       ///< elastic energy of tissue and coupling, not scaled by authority
  bool is_released = false;  ///< stored energy was released on purpose, as at a puncture
  /// In the tick of a puncture: the rendered force on the tip one tick earlier.
  double force_before_N = 0;
  std::uint64_t layers_punctured = 0;  ///< soft layers punctured in this tick, one bit each

  /// The holes to send to the remesher.
  std::span<const CutRequest> cuts() const noexcept {
    return punctured_now && cut_list.empty() ? std::span(&cut, 1) : cut_list;
  }
};

/// Removes from the track's pending holes those that the mesh in use already has.
void drop_published(const Sheet& sheet, SheetTrack& track) noexcept;

/// Runs one tick of contact. `sheets`: the meshes in use, topmost first, at most kMaxSceneSlices. The
/// `cuts` of a sheet must never decrease from tick to tick. `prefetched`: the latest stiffness (force law
/// `network`). `pose_interval_s`: time since the previous new pose, on the device's clock, or 0 if the pose
/// is not new. `previous`: an earlier pose and its age. If it is given, velocities are computed from it
/// instead of from the previous new pose. No allocation. Each sheet above the tip that is in contact or may
/// come into contact costs at most one overlap(). Each sheet that is punctured or missed in this tick costs
/// at most kMaxPendingHoles outline_outside().
void update_contact(const ContactModel& model, std::span<const Sheet* const> sheets,
                    const PrefetchedStiffness& prefetched, const Pose& T_device_plate,
                    double pose_interval_s, ContactState& state, ContactOutput& output,
                    const PreviousPose& previous = {}) noexcept;

/// Call this in ticks without update_contact(). The next tick then starts without rate and friction.
/// Contact states, punctures and requested holes are kept.
void reset_motion(ContactState& state) noexcept;

/// Call this if the tool jumped by `shift_m` without a force. The proxy does so when a puncture releases
/// it. The rates of the next tick then ignore this jump.
void shift_tool(const ContactModel& model, const Pose& T_device_plate,
                const Eigen::Vector3d& shift_m, ContactState& state) noexcept;

/// Converts a force that acts on the plate at a point, both in {B}, to a wrench about the plate's origin.
Wrench wrench_at(const Eigen::Vector3d& force_N, const Eigen::Vector3d& point_m,
                 const Pose& T_device_plate) noexcept;

}  // namespace trocar::runtime
