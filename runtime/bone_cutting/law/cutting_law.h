// SPDX-License-Identifier: Apache-2.0
// The mechanics of one tool in one bone volume, a tick at a time. A massless proxy of the tool moves to the
// minimum of a potential. The potential contains the coupling to the plate; the tip's push on the cutting front;
// friction of the shaft, along and around its axis; friction of the tip, across the axis; and the walls of the hole. All elements are
// elastic up to a limit and yield at it, and yielding only dissipates (incremental variational plasticity:
// Ortiz and Stainier, 1999). The front moves down to its first equilibrium, through any number of slabs in a
// tick. (The global minimum would break a shell long before its strength is reached.)
//
// Contract (tests/runtime/bone_cutting/law/cutting_law_test.cpp, cutting_energy_test.cpp, hole_test.cpp):
//  1. The law is passive except for the energy introduced by the zero-order hold. With the stored energy E
//     before and E' after the tick, the wrench w on the device and its displacement dx between two ticks,
//       E' - E + cut_J <= -w . dx + dx' K dx / 2
//     holds in every tick, for any stiffness, friction and number of Newton steps, because no step raises
//     the potential, and no element appears or grows with energy. K is the coupling's stiffness. For a rigid
//     coupling K is the elements' stiffness at the plate; if the plate rotates, the curvature of their paths
//     adds to it.
//  2. The front's work is the integral of the strength over the cut depth. The front never moves back, and
//     moves only while the tip's force exceeds the strength at the front.
//  3. A wall that has yielded stays where it was pushed (slot.h). Uncut material is a wall for a tool that
//     approaches from outside, too (CuttingSlab::free).
//  4. A hole outlives withdrawal. A tool that comes within `same_hole_m` of a hole enters it: cut depth has
//     no strength, and the hole's walls and friction act. Elsewhere the tool makes a new hole. For a tool
//     partly over an old hole, CuttingSlab::share is the fraction of the tool that still cuts.
//  5. Soft tissue over the bone has elements of its own (soft_layer.h). The work of cutting it counts in the
//     inequality as cut_J does.
//  6. No allocation, lock or system call; at most `most_steps` Newton steps in a tick.
//
// Depth is -z of {B}: the tool enters the bone downwards, within kMaxTilt_deg of upright.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "runtime/bone_cutting/law/slot.h"
#include "runtime/bone_cutting/law/soft_layer.h"
#include "runtime/mechanism/pose.h"

namespace trocar::runtime {

struct CuttingTool {
  Eigen::Vector3d tip_plate_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d inward_plate =
      -Eigen::Vector3d::UnitZ();  ///< unit vector along the shaft to the tip
  double radius_m = 1e-3;         ///< radius at which friction around the shaft acts
};

/// Spring from the plate to the proxy, about the plate's origin.
struct CuttingCoupling {
  bool is_rigid = false;  ///< the proxy is the plate
  double translation_N_per_m = 4000, rotation_Nm_per_rad = 20;
  /// The device's limits. Beyond them the coupling's force is constant (Huber).
  double most_force_N = std::numeric_limits<double>::infinity();
  double most_moment_Nm = std::numeric_limits<double>::infinity();
};

/// Largest number of Gauss points of a hole's wall in each slab.
inline constexpr std::size_t kMaxWallPoints = 2;

struct CuttingOptions {
  CuttingTool tool;
  CuttingCoupling coupling;
  double tip_N_per_m = 20'000;  ///< stiffness of the tip against the front
  double presliding_m = 1e-4;  ///< displacement along and around the shaft at which friction slides
  /// Coulomb's coefficient of the tip across its axis, on the front that it presses on. The friction limit
  /// follows from the force at the end of the last tick; it is reached after tip_presliding_m.
  double tip_friction = 0, tip_presliding_m = 1e-4;
  /// Distance of the axis from a hole's slot below which the tool enters that hole.
  double same_hole_m = 5e-5;
  double tolerance =
      1e-6;             ///< residual force, relative to the larger of 1 N and the coupling force
  int most_steps = 12;  ///< largest number of Newton steps in a tick
  /// Gauss points of a hole's wall in each slab: two are exact for a rigid rod. One serves only to measure
  /// their benefit (tests/bench/cutting_sweep). Constant during a session.
  std::size_t wall_points = kMaxWallPoints;
  double interval_s = 1e-3;  ///< time since the last tick, for viscous elements
  /// Soft tissue over the bone, uppermost first; at most as many as `CuttingState::layers`.
  std::span<const SoftLayer> layers;
};

/// A slab's resistance to the tool at its position. Depths ascend from slab to slab.
struct CuttingSlab {
  double top_m = 0, bottom_m = 0;  ///< depth; equal: a sheet of no thickness
  /// Strength of the front at full coverage, at the slab's top and bottom; linear in between. The caller
  /// supplies it for the tool's current position.
  double strength_top_N = 0, strength_bottom_N = 0;
  /// Factor on the strength above the depth `share_to_m`: the part of the tool that is over material which
  /// other holes have not cut. It follows from the geometry of the cuts.
  double share = 1, share_to_m = std::numeric_limits<double>::infinity();
  /// Length of shaft that the hole of a sheet of no thickness holds; the values below apply to it.
  double hole_m = 0;
  double friction_N_per_m = 0;                          ///< per embedded length
  double viscous_N_s_per_m2 = 0;                        ///< along the shaft, per embedded length
  double wall_N_per_m2 = 0, wall_strength_N_per_m = 0;  ///< lateral, per embedded depth
  double clearance_m = 0;  ///< clearance of a new hole around the shaft
  /// Region in which the axis touches no uncut material, for a tool that approaches from the side. Its
  /// boundary acts as a wall. When `free_version` (from 1) changes, the region replaces the hole's slot
  /// without energy; with a rigid coupling it does so as soon as nothing presses on the wall.
  const Slot* free = nullptr;
  std::uint32_t free_version = 0;
};

/// State of one hole in one slab.
struct CuttingHoleSlab {
  double cut_m = -std::numeric_limits<double>::infinity();  ///< depth down to which the hole is cut
  double embedded_m = 0;                                    ///< depth that the shaft fills
  double wall_N_per_m = 0, wall_most_N = 0;      ///< at each Gauss point, in the last tick
  std::array<double, kMaxWallPoints> depth_m{};  ///< depths of the Gauss points
  std::uint32_t free_version = 0;                ///< version of CuttingSlab::free in `walls`
  std::array<Slot, kMaxWallPoints> walls;
};

struct CuttingHole {
  int first = -1;               ///< slab in which the hole begins; -1: there is no hole
  std::uint64_t last_used = 0;  ///< tick of the last use
  std::vector<CuttingHoleSlab> slabs;
};

struct CuttingState {
  bool has_begun = false;
  Pose T_device_proxy;
  /// Distance of the tip beyond the front, along the shaft. Above 0 it is carried from tick to tick and never
  /// recomputed from geometry, which would add energy.
  double stretch_m = 0;
  double friction_N_per_m = 0;                             ///< stiffness in the last tick
  Eigen::Vector2d presliding_m = Eigen::Vector2d::Zero();  ///< along and around the shaft
  double tip_friction_N_per_m = 0;                         ///< stiffness in the last tick
  Eigen::Vector3d tip_slip_m = Eigen::Vector3d::Zero();    ///< elastic slip across the axis
  int hole = -1;                                           ///< hole that the tool is in; -1: none
  int embedded_from = 0, embedded_to = 0;  ///< slabs that the shaft fills, [from, to)
  std::uint64_t tick = 0;
  std::vector<CuttingHole> holes;  ///< fixed capacity; the oldest hole is forgotten first
  std::vector<SoftLayerState> layers;
  /// Work space of the walls' sums (walls.h). It affects results by rounding only.
  std::vector<std::uint32_t> wall_points;  ///< capacity for all points of a hole
  double wall_radius_m = 1e-6;
};

CuttingState make_cutting_state(std::size_t slabs, std::size_t holes, std::size_t layers = 0);

/// Removes all load: the tool is in no hole, and the proxy starts at the plate in the next tick. Cuts remain.
void release(CuttingState& state) noexcept;

struct CuttingResult {
  Wrench wrench_device = Wrench::Zero();  ///< on the plate, about its origin
  double tip_N = 0;                       ///< force of the tip, along the shaft
  double stored_J = 0;
  double cut_J = 0;        ///< front work of this tick
  double layer_N = 0;      ///< force of the soft layers, along the shaft
  double layer_cut_J = 0;  ///< work of cutting them in this tick, not contained in cut_J
  double front_m = 0;      ///< depth of the front, or of the next material below the tip
  double embedded_m = 0;   ///< embedded length of the shaft in all slabs
  /// Slabs whose bottom the front passed in this tick, [from, to): holes are to be cut into their meshes. Each
  /// slab is reported once for each hole through it; none if no hole can be remembered.
  int passed_from = 0, passed_to = 0;
  int steps = 0;        ///< number of Newton steps
  int evaluations = 0;  ///< number of evaluations of the potential
  bool has_converged = true;
};

/// Runs one tick. `slabs` has as many entries as each of `state.holes`. `T_device_plate`: pose at which the law
/// is evaluated; for a predicted pose the caller accounts for the difference.
void cutting_tick(const CuttingOptions& options, const Pose& T_device_plate,
                  std::span<const CuttingSlab> slabs, CuttingState& state,
                  CuttingResult& result) noexcept;

}  // namespace trocar::runtime
