// SPDX-License-Identifier: Apache-2.0
// Contact and puncture of separate sheets, for the force laws `hooke` and `network`: the state
// machine of each sheet, and the sheet's force on the tool. There is one tool, and the sheets are
// stacked along z. (Paper, II.C, Fig. 11 and 12.)
//
// Contract:
//  1. Coverage is the fraction of the area of the tool's outline that lies over material. Contact
//     begins when the tip passes from above to below a sheet with a coverage of at least
//     `min_coverage`. With less coverage the tool misses the sheet. A missed sheet exerts no force
//     until the tip has been above the sheet again. The only exception is the force of a hole that
//     the shaft is in (item 7). A sheet in contact also becomes a missed sheet if the tool slides
//     off its material.
//  2. In contact the force is F = k dx + (c b) dx', but at least 0. Here c is the coverage, b is
//     the tissue's damping, and dx = z_sheet - z_tip is the penetration. The rate dx' is the change
//     of dx since the previous new pose, divided by the time between the two poses on the device's
//     clock. If update_contact() is given the argument `previous`, this earlier pose and its age
//     are used instead of the previous new pose. In a tick without a new pose dx' keeps its value,
//     because a fall to 0 would make the force jump. The stiffness k depends on the force law:
//      - `hooke`: k = c K, where K is the tissue's stiffness. F acts at the centroid of the covered
//        area.
//      - `network`: k and the point of action come from a prefetched stiffness, which a worker has
//        computed for a tool position near the present one. A new prefetched stiffness replaces the
//        old one gradually, with the time constant kBlend_s. Until the first one is ready, k and
//        the point of action are those of `hooke`.
//  3. If F would exceed c times the threshold, the sheet is punctured in this tick: the force
//     is zero, and a hole with the tool's outline is requested. Exception: if the coverage is below
//     `min_coverage`, the tool slides off the sheet instead. After a puncture, until the tip has
//     been above the sheet, the sheet exerts only the force of its hole on the shaft (tool.h).
//  4. The topmost sheet in contact bears the force and shields the sheets below. The tool does not
//     touch a shielded sheet until the tick after the topmost sheet is punctured, or until the tool
//     slides off the topmost sheet.
//  5. A requested hole takes effect immediately, even before the remesher has cut it into the mesh.
//  6. The tool's outline in a sheet is the section of the tool's prism with the undeformed
//     sheet. So the outline of a tool that moves along its own axis does not change, even if the
//     tool is tilted.
//  7. A sheet remembers its last kMaxHoles holes. If the tool misses the sheet or slides off the
//     sheet, the tool's outline is compared with the kMaxPendingHoles remembered holes that are
//     nearest to the tool. If the fraction of the outline outside of all these holes is less than
//     `min_coverage`, the shaft has returned to the nearest hole. The force of this hole then acts
//     from the next tick on, as after a puncture.
//  8. The forces of a hole are multiplied by the hole's coverage, which is set at the puncture. It
//     is c + p h, but at most 1. Here c is the coverage of the tool, p is the fraction of the
//     tool's outline in older holes, and h is the coverage of the nearest older hole. The term p h
//     counts the material that older holes have removed.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "formats/session/recording.h"
#include "formats/session/scene.h"
#include "runtime/haptics/sheet.h"
#include "runtime/haptics/tool.h"

namespace trocar::runtime {

/// Time constant with which a new prefetched stiffness replaces the old one in contact.
inline constexpr double kBlend_s = 0.005;

/// Parameters of contact, constant during a session.
struct ContactModel {
  Tool tool;
  double dt_s = 1e-3;                      ///< duration of a tick
  bool uses_prefetched_stiffness = false;  ///< true with the force law `network`
  /// Smallest coverage with which contact begins. Without this bound, a tool that returns through
  /// its own hole slightly off centre would come into contact with the material beside the hole.
  double min_coverage = 0.05;
  /// The stiffness of a sheet is prefetched only if the tip is at most this far above the sheet.
  double prefetch_height_m = 0.03;
};

/// Number of holes that a sheet remembers.
inline constexpr int kMaxHoles = 64;

/// A hole that was requested. The hole's outline can be computed again from the plate's pose at the
/// puncture.
struct RememberedHole {
  Eigen::Vector2d at_m =
      Eigen::Vector2d::Zero();  ///< intersection of the tool's axis and the sheet
  Pose T_device_plate;          ///< the plate's pose at the puncture
  double coverage = 0;          ///< factor on the forces of the hole (contract 8)
};

/// Contact state of a sheet. kFree: the tip is above the sheet. kShielded: the tip is below the
/// sheet, but a sheet above bears the force (contract 4).
enum class SheetState : std::uint8_t { kFree, kContact, kShielded, kPunctured, kMissed };

/// Response of a sheet to the tool at one position. The force is `stiffness_N_per_m` times the
/// penetration. The vector `offset_m` (x, y) points from the intersection of the tool's axis and
/// the sheet to the point where the force acts.
struct PrefetchedStiffness {
  std::int32_t sheet = -1;  ///< index of the sheet; -1: none
  double stiffness_N_per_m = 0;
  std::array<double, 2> offset_m{};
};

/// State of one sheet between ticks.
struct SheetTrack {
  SheetState state = SheetState::kFree;
  bool was_above = false;            ///< the tip has been above the sheet during this session
  double last_penetration_m = 0;     ///< penetration in the previous tick; meaningful in kContact
  bool has_last = false;             ///< last_penetration_m can be used
  double rate_m_per_s = 0;           ///< dx' in the previous tick; meaningful in kContact
  PrefetchedStiffness blended;       ///< stiffness in use with the law `network`; only in kContact
  ShaftState shaft;                  ///< in_hole is true only in kPunctured or kMissed
  double hole_coverage = 0;          ///< RememberedHole::coverage of the hole that the shaft is in
  std::uint32_t cuts_requested = 0;  ///< number of holes requested so far
  /// Hole k (the first hole of the sheet is hole 0) has the index k % kMaxHoles.
  std::array<RememberedHole, kMaxHoles> holes;
  int pending_count = 0;
  std::array<LatticeOutline, kMaxPendingHoles> pending;  ///< holes not yet cut into the mesh
};

/// State kept between ticks, for the haptic thread only.
struct ContactState {
  std::array<SheetTrack, kMaxSceneSlices> tracks;
};

/// A hole to be cut. `sheet`: index of the sheet; the topmost sheet has index 0. `cut`: number of
/// the hole in that sheet; the first hole has number 1.
struct CutRequest {
  std::int32_t sheet = -1;
  std::uint32_t cut = 0;
  LatticeOutline outline;
  /// False if the hole is requested because the shaft has pushed aside an edge of the material or
  /// the wall of a hole. Only the law `cutting` requests such holes.
  bool is_puncture = true;
};

/// Request for a prefetched stiffness: the sheet, and the position of the tool above or in it.
struct PrefetchRequest {
  std::int32_t sheet = -1;  ///< index of the sheet; -1: none is near
  std::array<double, 2>
      middle_m{};  ///< intersection of the tool's axis and the sheet, x and y in {B}
  LatticeOutline outline;
};

/// Result of a tick of any force law.
struct ContactOutput {
  /// Position of the tip. Laws `hooke` and `network`: the tip of the tool at T_device_evaluated.
  /// Law `cutting`: the tip of the tool on the plate. With every law, RecordingRow::tool_m is the
  /// tip on which the tissue acts.
  Eigen::Vector3d tip_device_m = Eigen::Vector3d::Zero();
  /// Force on the tip. Laws `hooke` and `network`: the force of the sheet in contact, along +z of
  /// {B}. Law `cutting`: the force of bone and soft layers, along the shaft.
  double force_N = 0;
  /// Wrench of the tissue on the tool, about the plate's origin, in {B}. With the laws `hooke` and
  /// `network` it consists of force_N and the forces of the holes on the shaft. With the law
  /// `cutting` it consists of the forces of all elements of the tissue (cutting_law.h).
  Wrench wrench_device = Wrench::Zero();
  /// Depth of the tip below the sheet that is in contact or punctured in this tick. Law `cutting`:
  /// depth of the plate's tip, tip_device_m, below the cutting front. Without contact it is 0.
  double penetration_m = 0;
  /// The coefficients k and c b (contract 2) of the sheet in contact, even if F is 0. Without
  /// contact both are 0.
  double stiffness_N_per_m = 0, damping_N_s_per_m = 0;
  double rate_m_per_s = 0;  ///< dx' of the sheet in contact
  /// Index of the sheet that is in contact or punctured in this tick. If there is none, index of
  /// the lowest sheet above the tip; -1: no sheet is above the tip.
  std::int32_t active_sheet = -1;
  ContactPhase phase = ContactPhase::kFree;
  bool punctured_now = false;  ///< a sheet is punctured in this tick
  /// In the tick of a puncture: the force F that would exceed the threshold; F is not applied. Law
  /// `cutting`: the largest strength of the slabs that the front passed in this tick.
  double trial_force_N = 0;
  CutRequest cut;  ///< hole of the puncture, unless `cut_list` is used
  /// Holes of this tick, if the law can request several holes in one tick.
  std::span<const CutRequest> cut_list;
  bool backlog = false;  ///< more than kMaxPendingHoles holes wait for one sheet; `cut` is invalid
  /// If true, the tool is tilted by more than kMaxTilt_deg, and no other member is valid.
  bool not_upright = false;
  PrefetchRequest prefetch;  ///< next request for the law's prefetch worker
  /// Springs, dampers and friction whose forces add up to wrench_device. The law `cutting` sets
  /// only LocalEnvironment::stored_J.
  LocalEnvironment local;

  // ForceLaw::update() fills these members, for the loop and the session.

  Pose T_device_evaluated;  ///< pose at which the law was evaluated
  /// Wrench to render on the plate. After a recovery, the loop multiplies it by a factor that rises
  /// from 0 to 1, the authority.
  Wrench wrench_plate = Wrench::Zero();
  double stored_J = 0;  ///< elastic energy of tissue and coupling, not multiplied by the authority
  bool is_released = false;  ///< the law released stored energy on purpose, as at a puncture
  /// In the tick of a puncture: force_N one tick earlier.
  double force_before_N = 0;
  /// Law `cutting` only: the amount by which the rendered force on the tip fell in this tick, if
  /// bone or a soft layer was cut and less than half of the force is left. Otherwise 0.
  double lost_force_N = 0;
  std::uint64_t layers_punctured = 0;  ///< bit i: soft layer i was punctured in this tick

  /// The holes to send to the remesher.
  std::span<const CutRequest> cuts() const noexcept {
    return punctured_now && cut_list.empty() ? std::span(&cut, 1) : cut_list;
  }
};

/// Removes those holes from SheetTrack::pending that are already cut into the mesh in use.
void drop_published(const Sheet& sheet, SheetTrack& track) noexcept;

/// Runs one tick of contact. `sheets`: the sheets with the meshes in use, topmost first, at most
/// kMaxSceneSlices. Precondition: Sheet::cuts never decreases from tick to tick. `prefetched`: the
/// latest stiffness (force law `network`). `pose_interval_s`: time since the previous new pose, on
/// the device's clock, or 0 if the pose is not new. `previous`: an earlier pose and its age. If the
/// age is positive, velocities are computed from this earlier pose instead of from the previous new
/// pose.
///
/// No allocation. Each sheet above the tip that is in contact or may come into contact costs at
/// most one call of overlap(). Each sheet that is punctured or missed in this tick costs at most
/// kMaxPendingHoles calls of outline_outside().
void update_contact(const ContactModel& model, std::span<const Sheet* const> sheets,
                    const PrefetchedStiffness& prefetched, const Pose& T_device_plate,
                    double pose_interval_s, ContactState& state, ContactOutput& output,
                    const PreviousPose& previous = {}) noexcept;

/// Call this in ticks without update_contact(). The next tick then starts without rate and
/// friction. Contact states, punctures and requested holes are kept.
void reset_motion(ContactState& state) noexcept;

/// Call this after the tool has jumped by `shift_m` although no force moved it, as the proxy does
/// at a puncture. The rates of the next tick then ignore this jump.
void shift_tool(const ContactModel& model, const Pose& T_device_plate,
                const Eigen::Vector3d& shift_m, ContactState& state) noexcept;

/// Converts a force that acts on the plate at a point, both in {B}, to a wrench about the plate's
/// origin.
Wrench wrench_at(const Eigen::Vector3d& force_N, const Eigen::Vector3d& point_m,
                 const Pose& T_device_plate) noexcept;

}  // namespace trocar::runtime
