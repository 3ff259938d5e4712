// SPDX-License-Identifier: Apache-2.0
// The mechanics of one tool in one body of bone, a tick at a time. A massless proxy of the tool is
// where one potential has a minimum: the coupling to the plate, the tip against a cutting front,
// friction along and around the shaft and of the tip across it, and the walls of its hole. All
// elements are elastic up to a limit and yield at it, and what yields only dissipates (incremental
// variational plasticity: Ortiz and Stainier, 1999). The front moves down to its first equilibrium,
// through as many slabs as the tick takes: the global minimum would break a shell long before its
// strength is reached.
//
// Contract (tests/runtime/cutting/cutting_law_test.cpp, cutting_energy_test.cpp, hole_test.cpp):
//  1. Passive. With the stored energy E, the wrench w on the device and its displacement dx between
//     two ticks, E' - E + cut_J <= -w . dx + dx' K dx / 2, in every tick, for any stiffness,
//     friction and number of Newton steps: no step raises the potential, and no element appears or
//     grows with energy. K is the coupling's stiffness; where that is rigid, the elements' at the
//     plate, to which the curvature of their paths adds if the plate turns.
//  2. The front's work is the integral of the strength over what it cut. It never moves back, and
//     moves only while the tip's force exceeds the strength there.
//  3. A wall that has yielded stays where it was pushed (slot.h).
//     What has not been cut is a wall from outside too (CuttingSlab::free).
//  4. A hole outlives withdrawal. A tool that comes within `same_hole_m` of a hole goes into it:
//  what
//     the hole has taken has no strength, and its walls and friction act. Elsewhere the tool makes
//     a new hole; of a tool half over an old one, CuttingSlab::share tells how much of it cuts.
//  5. Soft tissue over the bone has elements of its own (soft_layer.h); what cutting it took counts
//     in the inequality as cut_J does.
//  6. No allocation, lock or system call; at most `most_steps` Newton steps a tick.
//
// Depth is -z of {B}: the tool goes into the body downwards, within kMaxTilt_deg of upright.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "runtime/cutting/slot.h"
#include "runtime/cutting/soft_layer.h"
#include "runtime/mechanism/pose.h"

namespace trocar::runtime {

struct CuttingTool {
  Eigen::Vector3d tip_plate_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d inward_plate = -Eigen::Vector3d::UnitZ();  ///< unit, along the shaft to the tip
  double radius_m = 1e-3;                                    ///< where friction around it acts
};

/// From the plate to the proxy, about the plate's origin.
struct CuttingCoupling {
  bool is_rigid = false;  ///< the proxy is the plate
  double translation_N_per_m = 4000, rotation_Nm_per_rad = 20;
  /// The device's limits: beyond, the coupling's force is constant (Huber).
  double most_force_N = std::numeric_limits<double>::infinity();
  double most_moment_Nm = std::numeric_limits<double>::infinity();
};

struct CuttingOptions {
  CuttingTool tool;
  CuttingCoupling coupling;
  double tip_N_per_m = 20'000;  ///< of the tip against the front
  double presliding_m = 1e-4;   ///< along and around the shaft, at which friction slides
  /// Coulomb's coefficient of the tip across its axis, on the front that it presses on. Its limit
  /// is that of the force at the end of the last tick, reached after the second length.
  double tip_friction = 0, tip_presliding_m = 1e-4;
  /// Of the axis from a hole's region: nearer, the tool goes into that hole.
  double same_hole_m = 5e-5;
  double tolerance = 1e-6;   ///< of forces, relative to the largest of 1 N and the coupling's
  int most_steps = 12;       ///< Newton steps a tick
  double interval_s = 1e-3;  ///< since the last tick, for what is viscous
  /// Soft tissue over the bone, from above; at most as many as `CuttingState::layers`.
  std::span<const SoftLayer> layers;
};

/// What a slab opposes to the tool where it is now. `top_m` and below ascend from slab to slab.
struct CuttingSlab {
  double top_m = 0, bottom_m = 0;  ///< depth; equal: a sheet of no thickness
  /// Of the front with all of the tool's outline over what is not cut; linear in between.
  double strength_top_N = 0, strength_bottom_N = 0;
  /// Of the strength, above `share_to_m`: the part of the tool that is over what other holes have
  /// not taken. The geometry of the cuts tells.
  double share = 1, share_to_m = std::numeric_limits<double>::infinity();
  /// Of a sheet of no thickness: the length of shaft that its hole holds, for the figures below.
  double hole_m = 0;
  double friction_N_per_m = 0;                          ///< of embedded length
  double viscous_N_s_per_m2 = 0;                        ///< along the shaft, of embedded length
  double wall_N_per_m2 = 0, wall_strength_N_per_m = 0;  ///< sideways, of embedded depth
  double clearance_m = 0;                               ///< of a new hole around the shaft
  /// Where the axis is free of what is not cut, if the tool comes from beside: a wall is one from
  /// outside too. With another version (from 1) it replaces the hole's region, without energy; for
  /// a rigid coupling as soon as nothing presses there.
  const Slot* free = nullptr;
  std::uint32_t free_version = 0;
};

/// Gauss points of a hole's wall in each slab: two are exact for a rigid rod. Another number only
/// to measure what they bring (tests/bench/cutting_sweep).
#ifndef TROCAR_WALL_POINTS
#define TROCAR_WALL_POINTS 2
#endif
inline constexpr std::size_t kWallPoints = TROCAR_WALL_POINTS;

/// What one slab remembers of one hole.
struct CuttingHoleSlab {
  double cut_m = -std::numeric_limits<double>::infinity();  ///< above, the hole has taken all
  double embedded_m = 0;                                    ///< depth that the shaft fills now
  double wall_N_per_m = 0, wall_most_N = 0;   ///< at each Gauss point, in the last tick
  std::array<double, kWallPoints> depth_m{};  ///< of the Gauss points
  std::uint32_t free_version = 0;             ///< of CuttingSlab::free in `walls`
  std::array<Slot, kWallPoints> walls;
};

struct CuttingHole {
  int first = -1;               ///< slab at which it begins; -1: there is no hole
  std::uint64_t last_used = 0;  ///< tick
  std::vector<CuttingHoleSlab> slabs;
};

struct CuttingState {
  bool has_begun = false;
  Pose T_device_proxy;
  /// How far the tip is beyond the front, along the shaft; above 0 it is carried from tick to tick
  /// and never taken from geometry, which would put energy in.
  double stretch_m = 0;
  double friction_N_per_m = 0;                             ///< stiffness in the last tick
  Eigen::Vector2d presliding_m = Eigen::Vector2d::Zero();  ///< along, around
  double tip_friction_N_per_m = 0;                         ///< stiffness in the last tick
  Eigen::Vector3d tip_slip_m = Eigen::Vector3d::Zero();    ///< across the axis, elastic
  int hole = -1;                                           ///< that the tool is in; -1: none
  int embedded_from = 0, embedded_to = 0;  ///< slabs that the shaft fills, [from, to)
  std::uint64_t tick = 0;
  std::vector<CuttingHole> holes;  ///< as many as can be remembered; then the oldest is forgotten
  std::vector<SoftLayerState> layers;
  /// For the walls' sums (walls.h); no result depends on them but by rounding.
  std::vector<std::uint32_t> wall_points;  ///< room for all of a hole
  double wall_reach_m = 1e-6;
};

CuttingState make_cutting_state(std::size_t slabs, std::size_t holes, std::size_t layers = 0);

/// Takes all load off: the tool is in no hole, and the proxy is the plate in the next tick. What is
/// cut stays so.
void release(CuttingState& state) noexcept;

struct CuttingResult {
  Wrench wrench_device = Wrench::Zero();  ///< on the plate, about its origin
  double tip_N = 0;                       ///< of the tip, along the shaft
  double stored_J = 0;
  double cut_J = 0;        ///< front work of this tick
  double layer_N = 0;      ///< of the soft layers, along the shaft
  double layer_cut_J = 0;  ///< what cutting them took in this tick, not in cut_J
  double front_m = 0;      ///< depth of the front, or of the next material below the tip
  double embedded_m = 0;   ///< of the shaft, in all slabs
  /// Slabs whose bottom the front passed in this tick, [from, to): what is to be cut out of their
  /// meshes. Each once for each hole through it; none if no hole can be remembered.
  int passed_from = 0, passed_to = 0;
  int steps = 0;        ///< of Newton's method
  int evaluations = 0;  ///< of the potential
  bool has_converged = true;
};

/// One tick. `slabs` has as many entries as each of `state.holes`. `T_device_plate`: where the law
/// is to be evaluated; with a predicted pose the caller accounts for the difference.
void cutting_tick(const CuttingOptions& options, const Pose& T_device_plate,
                  std::span<const CuttingSlab> slabs, CuttingState& state,
                  CuttingResult& result) noexcept;

}  // namespace trocar::runtime
