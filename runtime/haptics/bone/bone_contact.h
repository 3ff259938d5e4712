// SPDX-License-Identifier: Apache-2.0
// Ticks of the force law `cutting` on a session's sheets, and the slope of the surface.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "runtime/haptics/bone/bone_volume.h"
#include "runtime/haptics/puncture.h"

namespace trocar::runtime {

// The slope of the bone's surface under the tip. Each slice gives the distance from the tip's
// position to the slice's outline, positive inside the material and negative outside
// (sheet.h). Between two neighbouring slices this distance is interpolated linearly, and
// the surface is where this distance is zero (shape-based interpolation: G. Herman, J. Zheng, C.
// Bucholtz, IEEE Comput. Graph. Appl. 12(3), 1992). So the surface is continuous, with kinks at the
// slices, although the slices themselves form steps.
//
// Contract:
//  1. On a plane surface the slope is exact up to kMaxSlope (cutting_law.h). On steeper surfaces
//     the tip increasingly touches with its face. While the slope of the surface grows from
//     kMaxSlope to twice kMaxSlope, the result changes gradually from kMaxSlope to the slope of the
//     tip's face (item 3). In a segmentation the outline moves by whole pixels from slice to slice.
//     Therefore the slope is fitted to all slices within kSlopeWindow_m of the surface. The fitted
//     slope is at most kMostSteeper times the slope between the two slices nearest to the surface.
//  2. The slope is 0 at the top of a bone volume. It is also 0 on a wide step: the tip is more than
//     EdgeDistance::kReach_mm away, horizontally, from the outline of the slice above the surface.
//  3. If no surface is found within a diameter of the tool below the front, a face of the tip is
//     assumed to touch an edge of the bone. In this case the slope is that of the tip's face, but
//     at most kMaxSlope, and the gradient points away from the material.

inline constexpr double kSlopeWindow_m = 2.6e-3;
/// Largest number of sheets that are read to search for the surface, and on each side of the
/// surface for the fit.
inline constexpr int kMaxSlopeSheets = 6;
inline constexpr double kMostSteeper = 1.5;

/// Returns the gradient of the surface's depth with respect to x and y. The gradient points
/// downhill, and its length is at most kMaxSlope. Returns nothing in two cases. Either bone
/// surrounds the tip: the tip lies within the outlines of the front's slice and of the slice above.
/// Or the tip lies outside the material of the front's slice, at least EdgeDistance::kReach_mm away
/// from it. `sheet`: index of the sheet whose slab contains the cutting front. `front_m`: depth of
/// the front. `at_m`: x and y of the tip. No allocation. The time is bounded, because at most 3 *
/// kMaxSlopeSheets + 1 distances are read: 1 for the front's sheet, kMaxSlopeSheets in the search
/// for the surface, and kMaxSlopeSheets on each side of the surface.
std::optional<Eigen::Vector2d> surface_slope(const BoneVolume& bone,
                                             std::span<const Sheet* const> sheets, int sheet,
                                             double front_m, const Eigen::Vector2d& at_m) noexcept;

// Runs one tick of the force law `cutting` with the sheets of a session: computes the resistance of
// the slabs at the tool's position, runs the cutting law (cutting_law.h), and requests holes in the
// meshes.
//
// Contract:
//  1. The strength of a slab is the strength of the material under the tool's outline, multiplied
//     by the coverage: the fraction of the outline over material that is not yet cut. The tissue
//     states the strength of the material, or the strength is computed from HU. Friction is
//     multiplied by the coverage that the tool would have without any holes, so that cutting a hole
//     does not reduce the friction in the hole. If a coupling connects the tool to the plate, the
//     coverage, the HU and the slope of the surface are determined for the proxy's pose after the
//     last tick (CuttingState::T_device_proxy). In three cases they are determined for the pose at
//     which the law computes its forces: with a rigid coupling, in the first tick of a session or
//     after reset_motion(), and if the proxy is tilted by more than kMaxTilt_deg.
//  2. For each sheet that the cutting front passes completely, one hole is requested. The front can
//     pass several sheets in one tick. If the coverage is at most 0.1 %, no hole is requested.
//  3. If the tool is in a hole that it has cut through a sheet, or is about to enter such a hole
//     again, the walls in this sheet are those of the hole. Otherwise, if the coverage of the sheet
//     is below one half, the sheet's edges act as walls (admissible_region.h). An admissible region
//     that was computed beside a sheet's material is not used for a hole that begins elsewhere.
//     Where the shaft has pushed an edge or the wall of a hole aside (the wall has yielded), the
//     law requests a hole with the tool's outline.
//  4. All times are those of the device's clock. A tick without a new pose keeps the wrench and
//     the energy of the last tick, and cuts nothing.
//  5. No allocation, lock or exception.

/// With less coverage than this, there is no bone under the tool: no hole is cut there.
inline constexpr double kMinCoverage = 1e-3;

/// Memory of one sheet between ticks, on the haptic thread.
struct SheetInContact {
  LatticeOutline outline;  ///< tool's outline for which `uncut_coverage` and `hu` were computed
  std::uint32_t cuts = 0;  ///< number of holes in the mesh when `share` was computed
  std::uint32_t cuts_requested = 0;  ///< number of requested holes at that time
  bool is_known = false;             ///< the values below have been computed
  bool has_hu = false;               ///< material lies under the tool, so `hu` is valid
  bool is_beside = false;            ///< the sheet's edges act as walls (contract 3)
  bool is_presented = false;         ///< `uncut_coverage` is at least one half
  double share = 1;           ///< coverage: fraction of the outline over material not yet cut
  double uncut_coverage = 1;  ///< coverage if the sheet had no holes; factor on friction
  double hu = 0;              ///< mean HU of the material under the tool
  double strength_N = 0;      ///< strength before multiplication by `share`
  Eigen::Vector2d free_at_m =
      Eigen::Vector2d::Zero();  ///< axis position for which `free` was computed
  Eigen::Vector2d cut_at_m = Eigen::Vector2d::Zero();  ///< axis position of the last requested hole
  /// Outlines of the first kMaxPendingHoles holes that were requested in this sheet. If fewer holes
  /// were requested (SheetTrack::cuts_requested), the other outlines are empty.
  std::array<LatticeOutline, kMaxPendingHoles> holes;
  /// A hole was requested in this sheet because the front has passed the sheet. The flag is cleared
  /// when the tool leaves its hole or enters another.
  bool has_cut = false;
  /// The tool has returned, or is about to return, to a hole that it cut through this sheet earlier
  /// and then left. `has_cut` is false in this case.
  bool is_in_hole = false;
  Slot free;  ///< admissible region (CuttingSlab::free)
};

/// Energies since the session began.
struct BoneEnergyAccount {
  double cut_J = 0;  ///< work of cutting bone
  /// Work that the hand has done on the tissue, computed from the tissue's wrench without the
  /// factor SceneForceLaw::force_scale.
  double absorbed_J = 0;
  double stored_J = 0;  ///< energy that tissue and coupling store now
  /// Largest net energy that the hand has received up to any tick: the maximum of -absorbed_J.
  double released_max_J = 0;
};

/// State of the law `cutting` between ticks. Its memory is allocated before the loop starts.
struct BoneContactState {
  CuttingState law;
  std::vector<CuttingSlab> slabs;
  std::vector<SheetInContact> sheets;
  std::vector<CutRequest> cuts;  ///< hole requests of the last tick; capacity: two per sheet
  /// A copy of BoneVolume::options. Ticks set tip_N_per_m and torsion_Nm (from the sheet at the
  /// tip), `slope` and `interval_s`.
  CuttingOptions options;
  CuttingResult result;
  BoneEnergyAccount energy;
  double twist_rad_per_s = 0,
         feed_m_per_s = 0;        ///< velocities of the tool about and along its axis
  double front_HU = 0;            ///< HU at the front (RecordingRow::Cutting::front_HU)
  double front_m = 0;             ///< depth of the front after the last tick
  double retract_to_depth_m = 0;  ///< if must_retract: depth to which the tip must be raised
  /// The tip pressed on a soft layer when reset_motion() was called.
  bool must_retract = false;
  bool is_released = false;  ///< reset_motion() was called after the last tick
  int next_checked = 0;      ///< index of the sheet whose walls were checked last (contract 3)
  int last_hole = -1;        ///< CuttingState::hole after the last tick; reset_motion() keeps it
  bool has_plate = false;    ///< the following poses and the wrench are valid
  Pose T_device_plate;       ///< last new pose of the plate
  Pose T_device_evaluated;   ///< pose at which the law was evaluated last
  Wrench wrench_device = Wrench::Zero();  ///< wrench of the tissue in the last tick
};

BoneContactState make_bone_contact_state(const BoneVolume& bone);

/// Runs one tick. `T_device_plate`: the measured pose. `T_device_evaluated`: the pose at which the
/// law is evaluated, estimated and led. `tracks`: requested and pending holes of the sheets.
/// `pose_interval_s`: time since the previous new pose; 0: the pose is not new. Fills `output`;
/// ContactOutput says what its members mean with the law `cutting`. The wrench and the stored
/// energy are those of the tissue, before multiplication by SceneForceLaw::force_scale.
void update_bone_contact(const BoneVolume& bone, std::span<const Sheet* const> sheets,
                         const Pose& T_device_plate, const Pose& T_device_evaluated,
                         double pose_interval_s, std::span<SheetTrack> tracks,
                         BoneContactState& state, ContactOutput& output) noexcept;

/// Call this in ticks without update_bone_contact(). The next tick then starts without force
/// between tool and tissue. Holes are kept.
void reset_motion(BoneContactState& state) noexcept;

/// Returns the height by which the tip must be raised after reset_motion(), so that forces do not
/// return inside bone that the tool has not cut, nor in a soft layer that was under load. 0: the tip
/// need not be raised, because the tool is out of the bone, or in a hole that it has cut down to its
/// tip. In ticks with forces, returns 0.
double retract_distance_m(const BoneVolume& bone, std::span<const Sheet* const> sheets,
                          const Pose& T_device_plate, const BoneContactState& state) noexcept;

}  // namespace trocar::runtime
