// SPDX-License-Identifier: Apache-2.0
// One tick of the law `cutting` in a session: what the slabs oppose to the tool where it is now,
// the law's tick, and what is to be cut out of the meshes.
//
// Contract (tests/runtime/cutting/body_contact_test.cpp):
//  1. The strength of a slab is that of the material under the tool's outline, by HU where the
//  scene
//     says so, times the share of the outline over material that is not yet cut.
//     Friction is that of the share that was material before any cut, so that a hole keeps it.
//  2. What the front has passed is requested as a hole of the tool's outline, once for each sheet;
//     several in a tick where a snap passes several.
//  3. Beside material the walls are those of the sheet's edges (free_region.h). Where a wall has
//     yielded, the tool's outline is cut out there.
//  4. Times and interval are the device's; without a new pose the tick repeats the last one's
//  place.
//  5. No allocation, lock or exception.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "runtime/contact/puncture.h"
#include "runtime/cutting/body.h"

namespace trocar::runtime {

/// What the haptic thread keeps of a sheet between ticks.
struct SheetInBody {
  LatticeOutline outline;  ///< for which share and hu hold
  std::uint32_t cuts = 0;  ///< of the mesh, and of the holes requested, for which share holds
  std::uint32_t cuts_requested = 0;
  bool is_known = false;
  bool has_hu = false;        ///< there is material under the tool, and `hu` is known
  bool is_beside = false;     ///< the tool passes or passed it without material under most of it
  bool is_presented = false;  ///< material is under half of the tool, before any cut
  double share = 1;           ///< of the outline over material not yet cut
  double grip = 1;            ///< of the shaft's wall that is material, before any cut
  double hu = 0;              ///< mean of the material under the tool
  double strength_N = 0;      ///< with all of the outline over material
  Eigen::Vector2d free_at_m = Eigen::Vector2d::Zero();  ///< where `free` was found
  Eigen::Vector2d cut_at_m = Eigen::Vector2d::Zero();   ///< of the last hole requested
  bool has_cut = false;
  Slot free;
};

/// What the law has done with energy since the session began, and what the hand has.
struct BodyLedger {
  double cut_J = 0;       ///< front work
  double absorbed_J = 0;  ///< work of the hand on the tissue: minus that of its wrench, unscaled
  double stored_J = 0;
  /// The most that the hand was given above what it had put in, unscaled.
  double given_max_J = 0;
};

/// Allocated before the loop.
struct BodyState {
  CuttingState law;
  std::vector<CuttingSlab> slabs;
  std::vector<SheetInBody> sheets;
  std::vector<CutRequest> cuts;  ///< of the last tick; capacity for every sheet
  CuttingOptions options;        ///< the tip's stiffness is that of the sheet below it
  CuttingResult result;
  BodyLedger ledger;
  double twist_rad_per_s = 0, feed_m_per_s = 0;  ///< of the tool about and along its axis
  double front_HU = 0;                           ///< as RecordingRow::Cutting::front_HU
  double front_m = 0;                            ///< depth, after the last tick
  double lift_to_m = 0;                          ///< depth of the front that a fault left loaded
  bool must_lift = false;
  int next_checked = 0;  ///< sheet
  int last_hole = -1;    ///< that the tool was in; forget_motion() keeps it
  bool has_plate = false;
  Pose T_device_plate;                    ///< of the last new pose
  Pose T_device_evaluated;                ///< where the law was evaluated last
  Wrench wrench_device = Wrench::Zero();  ///< of the tissue in the last tick
};

BodyState make_body_state(const Body& body);

/// One tick. `T_device_plate`: the plate; `T_device_evaluated`: there or predicted. `tracks`: their
/// requested and pending holes. Fills `output` as update_contact() does; wrench and stored energy
/// are the tissue's, not scaled.
void update_body(const Body& body, std::span<const Sheet* const> sheets, const Pose& T_device_plate,
                 const Pose& T_device_evaluated, double pose_interval_s,
                 std::span<SheetTrack> tracks, BodyState& state, ContactOutput& output) noexcept;

/// For ticks in which no force is computed: nothing is loaded in the next one. Holes are kept.
void forget_motion(BodyState& state) noexcept;

/// How far the tool must be lifted until no force would act if the loop went on now.
double lift_m(const Body& body, const Pose& T_device_plate, const BodyState& state) noexcept;

}  // namespace trocar::runtime
