// SPDX-License-Identifier: Apache-2.0
// The mechanics of one tool in one bone volume, a tick at a time. A massless proxy of the tool moves to the minimum of a potential. The
// potential is the sum of these elements: the coupling of the proxy to the plate, the tip's spring against the cutting front, friction
// of the shaft along and around its axis, friction of the tip, the tip's resistance to being turned, and the walls of the hole. Each
// element is elastic up to a limit force and yields at it. Yielding only dissipates energy (incremental variational plasticity: Ortiz
// and Stainier, 1999). In a tick the front moves down to the first equilibrium that it reaches, possibly through several slabs. (A front
// that moved to the global minimum of the energy would cut through a hard layer, such as a cortical shell, long before the force reaches
// that layer's strength.)
//
// Contract (tests/runtime/bone_cutting/law/cutting_law_test.cpp, cutting_energy_test.cpp, hole_test.cpp):
//  1. The law is passive except for the energy introduced by the zero-order hold. Let E0 and E1 be the stored energies before and after the
//     tick, cut_J the work of cutting in the tick, w the wrench on the plate, dx the displacement of the plate since the last tick, dx^T
//     its transpose, and K the stiffness of the coupling. Then every tick satisfies
//       E1 - E0 + cut_J <= -w . dx + dx^T K dx / 2
//     for any stiffness, any friction and any number of Newton steps. There are two reasons: no Newton step raises the
//     potential, and an element that appears or gets stiffer gains no stored energy. If the coupling is rigid, K is
//     the stiffness of all other elements, expressed at the plate. If the plate rotates, this K has an additional
//     geometric term, because the points at which the elements act move on curved paths.
//  2. The front's work is the integral of the strength over the cut depth. The front never moves back, and
//     moves only while the tip's force exceeds the strength at the front.
//  3. A wall that has yielded stays where it was pushed (slot.h). Uncut material beside the tool is a wall as well (CuttingSlab::free).
//  4. A hole remains after the tool is withdrawn. If the tool's axis comes within `same_hole_m` of a hole, the tool is in that hole again:
//     the tip meets no resistance down to the depth already cut, and the hole's walls and friction act. Elsewhere the tool makes a new
//     hole. CuttingSlab::share reduces the strength for a tool that lies partly over an old hole. (In a session `share` is always 1,
//     because bone_contact.cpp multiplies the strengths by the coverage instead.)
//  5. Soft tissue over the bone has elements of its own (soft_layer.h). The work of cutting it,
//     `layer_cut_J`, is added to cut_J in the inequality.
//  6. On a sloping surface (CuttingOptions::slope) the tip's spring acts along the surface's normal. Its energy depends on its stretch
//     alone, and the stretch is carried from tick to tick. So when the surface under the tip changes its direction, the force changes its
//     direction, but the energy stays the same. With a rigid coupling a new slope takes effect in the next tick only. The wrench that was
//     rendered and the energy account then refer to the same slope.
//  7. No allocation, lock or system call; at most `most_steps` Newton steps in a tick.
//
// Depth is -z of {B}: the tool enters the bone downwards, within kMaxTilt_deg of upright.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "runtime/bone_cutting/law/slot.h"
#include "runtime/bone_cutting/law/soft_layer.h"
#include "runtime/device/pose.h"

namespace trocar::runtime {

struct CuttingTool {
  Eigen::Vector3d tip_plate_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d inward_plate =
      -Eigen::Vector3d::UnitZ();  ///< unit vector along the shaft to the tip
  double radius_m = 1e-3;         ///< radius at which friction around the shaft acts
};

/// Spring from the plate to the proxy, acting about the plate's origin.
struct CuttingCoupling {
  bool is_rigid = false;  ///< the proxy is the plate
  double translation_N_per_m = 4000, rotation_Nm_per_rad = 20;
  /// The device's limits. When the coupling reaches them, its force stays constant (Huber).
  double most_force_N = std::numeric_limits<double>::infinity();
  double most_moment_Nm = std::numeric_limits<double>::infinity();
};

/// Largest tangent of the angle between the shaft and the normal of the surface under the tip (60 degrees).
inline constexpr double kMaxSlope = 1.7320508075688772;

/// Largest number of Gauss points of a hole's wall in each slab.
inline constexpr std::size_t kMaxWallPoints = 2;

struct CuttingOptions {
  CuttingTool tool;
  CuttingCoupling coupling;
  double tip_N_per_m = 20'000;  ///< stiffness of the tip against the front
  double presliding_m =
      1e-4;  ///< displacement along and around the shaft at which the shaft begins to slide
  /// Coulomb friction coefficient between the tip and the material that it presses on. On a surface (`slope`) the friction acts in the
  /// surface, elsewhere across the tool's axis. Its limit is this coefficient times the normal force at the end of the last tick. It
  /// reaches the limit after a displacement of tip_presliding_m.
  double tip_friction = 0, tip_presliding_m = 1e-4;
  /// The force with which crushed bone holds a tip that is pulled back, as a fraction of the tip's largest recent force. Bone under a tip
  /// is crushed, not compressed elastically, so it does not push the tip out again (indentation of foams: L. Gibson, M. Ashby, Cellular
  /// Solids, 1997). The hold is a friction force that resists only withdrawal. It yields after tip_presliding_m, and it fades to 0 while
  /// the tip is raised by a diameter of the tool.
  double tip_hold = 0;
  /// The longer the core in a hollow tool is, the more it presses on the bore, like grain in a silo (H. Janssen, 1895). Friction is
  /// therefore multiplied by core_friction_factor(). `core_fraction`: the part of the shaft's friction that comes from a short core.
  /// `core_growth_per_m`: 2 mu kappa / r, with the radius r of the bore, its friction coefficient mu, and the ratio kappa of the pressure
  /// across the core to the pressure along it.
  double core_fraction = 0, core_growth_per_m = 0;
  /// Moment about the axis beyond which the tip turns in the material. The resistance acts while the tip is under load. It reaches this
  /// moment after a rotation that moves the outline by tip_presliding_m.
  double twist_Nm = 0;
  /// The tool enters a hole if its axis is at most this far from the hole's slot.
  double same_hole_m = 5e-5;
  /// Gradient of the depth of the surface that the tip presses on, by x and y of {B}. The gradient points downhill, and its length is the
  /// tangent of the slope. The tip's force then acts along the surface's normal, so that it pushes the tip downhill. None: bone surrounds
  /// the tip, and the force acts along the shaft. A new value takes effect in the next tick. The tangent of the angle between shaft and
  /// normal is limited to kMaxSlope.
  std::optional<Eigen::Vector2d> slope;
  double tolerance =
      1e-6;             ///< residual force, relative to the larger of 1 N and the coupling force
  int most_steps = 12;  ///< largest number of Newton steps in a tick
  /// Number of Gauss points of a hole's wall in each slab, constant during a session. Two points are exact for a rigid rod. The value 1
  /// exists only for the benchmark that compares one point with two (tests/bench/cutting_sweep.cpp).
  std::size_t wall_points = kMaxWallPoints;
  double interval_s = 1e-3;  ///< time since the last tick, for viscous elements
  /// Soft tissue over the bone, uppermost first; at most as many as `CuttingState::layers`.
  std::span<const SoftLayer> layers;
};

/// Resistance of one slab at the current position of the tool. Depths increase from slab to slab.
struct CuttingSlab {
  double top_m = 0, bottom_m = 0;  ///< depth; equal: a sheet of no thickness
  /// Force on the tip at which the front advances, at the slab's top and at its bottom; linear in between. The caller supplies these values
  /// for the tool's current position. They are not yet multiplied by `share`.
  double strength_top_N = 0, strength_bottom_N = 0;
  /// `share` is the fraction of the tool's outline that lies over material which other holes have not cut. It multiplies the strength from
  /// the slab's top down to the depth `share_to_m`. Below that depth the factor is 1.
  double share = 1, share_to_m = std::numeric_limits<double>::infinity();
  /// Only for a slab of thickness 0: its embedded length once the tip is below it. The values per length below are multiplied by
  /// this length.
  double hole_m = 0;
  double friction_N_per_m = 0;                          ///< shaft's friction per embedded length
  double viscous_N_s_per_m2 = 0;                        ///< along the shaft, per embedded length
  double wall_N_per_m2 = 0, wall_strength_N_per_m = 0;  ///< lateral, per embedded depth
  double clearance_m = 0;  ///< clearance of a new hole around the shaft
  /// The positions (x, y) of the axis at which the tool touches no uncut material. The boundary of this region acts as a wall on a tool
  /// that approaches the material from the side. Null: there is no such wall. When `free_version` changes (the first region has version 1),
  /// the new region replaces the slot of the hole without adding stored energy. With a rigid coupling it does so only when the shaft
  /// presses on no wall.
  const Slot* free = nullptr;
  std::uint32_t free_version = 0;
};

/// State of one hole in one slab.
struct CuttingHoleSlab {
  double cut_m = -std::numeric_limits<double>::infinity();  ///< depth down to which the hole is cut
  double embedded_m = 0;                                    ///< depth filled by the shaft
  double wall_N_per_m = 0, wall_most_N = 0;      ///< values of one Gauss point in the last tick
  std::array<double, kMaxWallPoints> depth_m{};  ///< depths of the Gauss points
  std::uint32_t free_version = 0;  ///< CuttingSlab::free_version that `walls` come from; 0: none
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
  /// Distance from the front to the tip, along the shaft. While it is positive, it is carried from tick to tick. It must not be recomputed
  /// from the geometry, because that would add energy.
  double stretch_m = 0;
  /// Index of the slab of thickness 0 on which the front rests; -1: none. Until the front cuts this slab, the front stays at the slab's
  /// depth. The depth is not recomputed from the stretch, even if the tool tilts.
  int bearing = -1;
  std::optional<Eigen::Vector2d> slope;  ///< CuttingOptions::slope of the last tick
  /// Depth by which the front has moved down because the tip slid down a slope. No bone surrounds the tool over this depth.
  double slid_m = 0;
  double friction_N_per_m = 0;                             ///< stiffness in the last tick
  Eigen::Vector2d presliding_m = Eigen::Vector2d::Zero();  ///< elastic slip along, around the shaft
  double tip_friction_N_per_m = 0;                         ///< stiffness in the last tick
  Eigen::Vector3d tip_slip_m = Eigen::Vector3d::Zero();    ///< elastic slip of the tip
  double hold_tip_N = 0;    ///< largest recent force of the tip on the bone around it
  double hold_depth_m = 0;  ///< largest depth of the tip since it was last free
  double hold_N_per_m = 0;  ///< stiffness of the hold in the last tick
  double hold_slip_m =
      0;  ///< elastic slip of the hold along the shaft, with the sign of stretch_m; at most 0
  double twist_N_per_m = 0;  ///< stiffness against the tip's rotation in the last tick
  double twist_slip_m = 0;   ///< elastic slip around the axis, at the tool's radius
  int hole = -1;             ///< hole that the tool is in; -1: none
  int embedded_from = 0, embedded_to = 0;  ///< slabs filled by the shaft, [from, to)
  std::uint64_t tick = 0;
  std::vector<CuttingHole> holes;  ///< fixed capacity; the oldest hole is forgotten first
  std::vector<SoftLayerState> layers;
  /// Working memory for the sums over the walls (walls.h). It affects results only by rounding.
  std::vector<std::uint32_t> wall_points;  ///< capacity for all points of a hole
  double wall_radius_m = 1e-6;
};

/// The factor by which the core increases the friction of a shaft with this embedded length. The exponent core_growth_per_m * embedded_m is
/// limited to kMaxCoreExponent.
double core_friction_factor(const CuttingOptions& options, double embedded_m) noexcept;
inline constexpr double kMaxCoreExponent = 4;

CuttingState make_cutting_state(std::size_t slabs, std::size_t holes, std::size_t layers = 0);

/// Removes all load. The tool is then in no hole, and the proxy starts at the plate in the next tick. Cuts remain.
void release(CuttingState& state) noexcept;

struct CuttingResult {
  Wrench wrench_device = Wrench::Zero();  ///< on the plate, about its origin
  double tip_N = 0;                       ///< force of the tip, along the shaft
  double stored_J = 0;
  double cut_J = 0;        ///< work of cutting bone in this tick
  double layer_N = 0;      ///< force of the soft layers, along the shaft
  double layer_cut_J = 0;  ///< work of cutting soft layers in this tick, not contained in cut_J
  double front_m = 0;      ///< depth of the front, or of the next material below the tip
  double embedded_m = 0;   ///< embedded length of the shaft in all slabs
  /// Slabs whose bottom the front passed in this tick, [from, to). The caller requests holes in their meshes. A slab is reported once for
  /// each hole through it. If CuttingState::holes is empty, the range is empty.
  int passed_from = 0, passed_to = 0;
  int steps = 0;        ///< number of Newton steps
  int evaluations = 0;  ///< number of evaluations of the potential
  bool has_converged = true;
};

/// Runs one tick. `slabs` has as many elements as `state.holes[i].slabs` for each hole i. `T_device_plate`: the pose at which the law is
/// evaluated. If this is a predicted pose, the caller must correct the energy account for the difference from the measured pose.
void cutting_tick(const CuttingOptions& options, const Pose& T_device_plate,
                  std::span<const CuttingSlab> slabs, CuttingState& state,
                  CuttingResult& result) noexcept;

}  // namespace trocar::runtime
