// SPDX-License-Identifier: Apache-2.0
// One tick of the force law `cutting` against the sheets of a session: computes what the slabs oppose to the
// tool at its position, runs the cutting law, and requests holes in the meshes.
//
// Contract (tests/runtime/bone_cutting/contact/bone_contact_test.cpp):
//  1. The strength of a slab is that of the material under the tool's outline, computed from HU if the
//     scene says so, times the coverage: the part of the outline over material that is not yet cut.
//     Friction is scaled with the coverage before any cut, so that a hole keeps its friction.
//  2. Each sheet that the front passes gets one hole request. One tick can pass several sheets.
//  3. For a tool beside material, the walls are the sheet's edges (admissible_region.h). Where a wall has
//     yielded, the tool's outline is cut out.
//  4. Times and intervals are the device's. Without a new pose, the tick repeats the previous position.
//  5. No allocation, lock or exception.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "runtime/bone_cutting/material/bone_volume.h"
#include "runtime/contact/puncture.h"

namespace trocar::runtime {

/// Memory of one sheet between ticks, on the haptic thread.
struct SheetInContact {
  LatticeOutline outline;  ///< outline for which coverage and hu hold
  std::uint32_t cuts = 0;  ///< holes in the mesh for which `coverage` holds; next: requested ones
  std::uint32_t cuts_requested = 0;
  bool is_known = false;
  bool has_hu = false;        ///< material lies under the tool, and `hu` is known
  bool is_beside = false;     ///< the tool passes or passed the sheet with little coverage
  bool is_presented = false;  ///< before any cut, material covers at least half of the tool
  double share = 1;           ///< part of the outline over material not yet cut
  double grip = 1;            ///< part of the shaft's wall that is material, before any cut
  double hu = 0;              ///< mean of the material under the tool
  double strength_N = 0;      ///< strength at full coverage
  Eigen::Vector2d free_at_m =
      Eigen::Vector2d::Zero();  ///< axis position for which `free` was computed
  Eigen::Vector2d cut_at_m = Eigen::Vector2d::Zero();  ///< axis position of the last requested hole
  bool has_cut = false;
  Slot free;
};

/// Energies since the session began.
struct BoneEnergyAccount {
  double cut_J = 0;       ///< front work
  double absorbed_J = 0;  ///< work that the hand did on the tissue, unscaled
  double stored_J = 0;
  /// Largest net energy that was released to the hand, unscaled.
  double released_max_J = 0;
};

/// Memory of the contact, allocated before the loop.
struct BoneContactState {
  CuttingState law;
  std::vector<CuttingSlab> slabs;
  std::vector<SheetInContact> sheets;
  std::vector<CutRequest> cuts;  ///< requests of the last tick; capacity for every sheet
  CuttingOptions options;        ///< the tip's stiffness is that of the sheet below it
  CuttingResult result;
  BoneEnergyAccount energy;
  double twist_rad_per_s = 0,
         feed_m_per_s = 0;  ///< velocities of the tool about and along its axis
  double front_HU = 0;      ///< RecordingRow::Cutting::front_HU
  double front_m = 0;       ///< depth of the front after the last tick
  double lift_to_m = 0;     ///< depth above which a tip that a fault left loaded is free
  bool must_lift = false;
  int next_checked = 0;  ///< index of a sheet
  int last_hole = -1;    ///< hole that the tool was in; reset_motion() keeps it
  bool has_plate = false;
  Pose T_device_plate;                    ///< last new pose of the plate
  Pose T_device_evaluated;                ///< pose at which the law was evaluated last
  Wrench wrench_device = Wrench::Zero();  ///< wrench of the tissue in the last tick
};

BoneContactState make_bone_contact_state(const BoneVolume& bone);

/// Runs one tick. `T_device_plate`: measured pose; `T_device_evaluated`: the same or the predicted pose.
/// `tracks`: requested and pending holes of the sheets. Fills `output` as update_contact() does; wrench and stored energy
/// are the tissue's, not scaled.
void update_bone_contact(const BoneVolume& bone, std::span<const Sheet* const> sheets,
                         const Pose& T_device_plate, const Pose& T_device_evaluated,
                         double pose_interval_s, std::span<SheetTrack> tracks,
                         BoneContactState& state, ContactOutput& output) noexcept;

/// Call this in ticks without update_bone_contact(): the next tick starts without load. Holes are kept.
void reset_motion(BoneContactState& state) noexcept;

/// Distance by which the tool must be retracted until no force would act if the loop went on now.
double retract_distance_m(const BoneVolume& bone, const Pose& T_device_plate,
                          const BoneContactState& state) noexcept;

}  // namespace trocar::runtime
