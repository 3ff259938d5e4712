// SPDX-License-Identifier: Apache-2.0
// Contact and puncture of separate sheets (force laws `hooke` and `network`): each sheet's state machine
// and its force on the tool. One tool, sheets stacked along z. (Paper, II.C, Fig. 11 and 12.)
//
// Contract (tests/runtime/contact/contact_test.cpp tests each point):
//  1. Contact begins when the tip passes from above to below a sheet with a coverage of at least
//     `min_coverage`. Coverage is the part of the tool outline's area that lies over material. With less
//     coverage the tool misses the sheet: only a hole exerts a force (7), until the tip has been above
//     the sheet again. A tool that slides off the material later misses the sheet likewise.
//  2. In contact F = k dx + c b dx', but at least 0. dx = z_sheet - z_tip is the penetration, c the
//     coverage, K and b the tissue's stiffness and damping. dx' is the backward difference of dx since the
//     previous new pose, or since the argument `previous` of update_contact() if that is given. Times are
//     the device's. Without a new pose dx' is held, and the next pose causes no force spike. With the force
//     law `hooke` k = c K, and F acts at the centroid of the covered area. With the force law `network`, k
//     and the point of action come from the prefetched stiffness, which a worker computed for a tool
//     position near this one. A new one is blended in over kBlend_s. While there is none the
//     law `hooke` applies.
//  3. If F would exceed c times the threshold, the sheet is punctured in this tick: the force is zero,
//     and a hole with the tool's outline is requested. In later ticks the sheet exerts only the force of
//     its hole on the shaft (shaft.h), until the tip has been above it. If the coverage has dropped below
//     `min_coverage`, the tool slides off the sheet instead of puncturing it.
//  4. The topmost sheet in contact bears the force. The sheets below it are shielded from the tool until
//     the tick after its puncture, or until the tool slides off it.
//  5. A requested hole counts as open at once, whether its mesh is there or not.
//  6. The tool's outline in a sheet is the section of its prism with the undeformed sheet: a tool that
//     moves along its own axis keeps its outline, however much it is tilted.
//  7. A sheet remembers its last kMaxHoles holes. If the tool misses the sheet or slides off it, and less
//     than `min_coverage` of its outline lies outside the nearest kMaxPendingHoles of these holes, the
//     shaft is in the hole again, as after a puncture: the hole's force acts from the next tick on. A hole
//     across an edge of the sheet acts on the shaft in proportion to its coverage, as the sheet does on
//     the tool: coverage at the puncture plus that of the older holes it overlaps.
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

/// Constant during a session.
struct ContactModel {
  Tool tool;
  double dt_s = 1e-3;                      ///< duration of a tick
  bool uses_prefetched_stiffness = false;  ///< force law `network`
  /// Smallest coverage with which contact begins. Without this bound a tool that goes back through its
  /// own hole slightly off centre would be in contact with the rim.
  double min_coverage = 0.05;
  /// Height of the tip above a sheet below which the sheet's stiffness is prefetched.
  double prefetch_height_m = 0.03;
};

/// Holes that a sheet remembers.
inline constexpr int kMaxHoles = 64;

/// A hole that was requested: the plate's pose at the puncture gives its outline again.
struct RememberedHole {
  Eigen::Vector2d at_m =
      Eigen::Vector2d::Zero();  ///< intersection of the tool's axis and the sheet
  Pose T_device_plate;
  double coverage = 0;  ///< part of the outline that the sheet holds (contract 7)
};

enum class SheetState : std::uint8_t { kFree, kContact, kShielded, kPunctured, kMissed };

/// A sheet's response to the tool at one position: force = stiffness * depth, acting `offset_m` (x, y)
/// from the middle of the tool's outline.
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
  ShaftState shaft;             ///< in_hole only in kPunctured and kMissed
  double hole_coverage = 0;     ///< RememberedHole::coverage of the hole that the shaft is in
  std::uint32_t cuts_requested = 0;
  /// Hole number k, from 0, has the index k % kMaxHoles; `cuts_requested` holes in all.
  std::array<RememberedHole, kMaxHoles> holes;
  int pending_count = 0;
  std::array<LatticeOutline, kMaxPendingHoles> pending;  ///< requested holes that the mesh lacks
};

/// Memory between ticks, on the haptic thread.
struct ContactState {
  std::array<SheetTrack, kMaxSceneSlices> tracks;
};

/// A hole to be cut: the `cut`-th (from 1) of sheet `sheet` (an index into the scene's sheets,
/// the topmost first).
struct CutRequest {
  std::int32_t sheet = -1;
  std::uint32_t cut = 0;
  LatticeOutline outline;
  bool is_puncture = true;  ///< false: a hole's wall has yielded sideways
};

/// The tool's position over, or in, the sheet whose stiffness is to be prefetched.
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
  /// Wrench of the tissue on the tool, about the plate's origin, in {B}: the force above, and the shaft's.
  Wrench wrench_device = Wrench::Zero();
  double penetration_m =
      0;  ///< depth below the active sheet, in contact and in the tick of its puncture
  /// k and c b of the sheet in contact, also where F is 0; otherwise 0.
  double stiffness_N_per_m = 0, damping_N_s_per_m = 0;
  double rate_m_per_s = 0;  ///< dx'
  /// The sheet in contact or punctured in this tick; otherwise the lowest one above the tip.
  std::int32_t active_sheet = -1;
  ContactPhase phase = ContactPhase::kFree;
  bool punctured_now = false;  ///< a sheet is punctured in this tick
  double trial_force_N = 0;    ///< F of the puncture: above c times the threshold, not applied
  CutRequest cut;              ///< the puncture's hole, unless `cut_list` is used
  std::span<const CutRequest> cut_list;  ///< requests of a law that makes several in a tick
  bool backlog = false;  ///< more than kMaxPendingHoles wait for one sheet: `cut` is not valid
  bool not_upright =
      false;  ///< the tool is tilted by more than kMaxTilt_deg: nothing else is valid
  PrefetchRequest prefetch;  ///< next request for the law's prefetch worker
  LocalEnvironment local;    ///< the elements of wrench_device

  // Filled by ForceLaw::update(), for the loop and the session.

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

/// Drops from the track's pending holes those that the mesh in use already has.
void drop_published(const Sheet& sheet, SheetTrack& track) noexcept;

/// Runs one tick of contact. `sheets`: the meshes in use, topmost first, at most kMaxSceneSlices; a sheet's
/// `cuts` never decreases from tick to tick. `prefetched`: the latest one (force law `network`).
/// `pose_interval_s`: time since the previous new pose, on the device's clock; 0: the pose is not new.
/// `previous`: velocities are computed from there. No allocation. Cost: at most one overlap() for each
/// sheet that the tip is below and that is not punctured, shielded or missed, and kMaxPendingHoles
/// outline_outside() for each sheet that is punctured or missed in this tick.
void update_contact(const ContactModel& model, std::span<const Sheet* const> sheets,
                    const PrefetchedStiffness& prefetched, const Pose& T_device_plate,
                    double pose_interval_s, ContactState& state, ContactOutput& output,
                    const PreviousPose& previous = {}) noexcept;

/// Call this in ticks without update_contact: the next tick starts without rate and friction. Contact
/// states, punctures and requested holes are kept.
void reset_motion(ContactState& state) noexcept;

/// Reports that the tool moved by `shift_m` without a force, such as a proxy that a puncture released: the
/// rates of the next tick ignore this motion.
void shift_tool(const ContactModel& model, const Pose& T_device_plate,
                const Eigen::Vector3d& shift_m, ContactState& state) noexcept;

/// Converts a force that acts on the plate at a point, both in {B}, to a wrench about the plate's origin.
Wrench wrench_at(const Eigen::Vector3d& force_N, const Eigen::Vector3d& point_m,
                 const Pose& T_device_plate) noexcept;

}  // namespace trocar::runtime
