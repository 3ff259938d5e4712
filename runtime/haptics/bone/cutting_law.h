// SPDX-License-Identifier: Apache-2.0
// The mechanics of one tool in one bone volume.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "runtime/device/device.h"
#include "runtime/haptics/bone/walls.h"

namespace trocar::runtime {

// Inverse of a symmetric 6 x 6 matrix, computed from blocks of 3 x 3.

/// Computes the inverse of a symmetric matrix. Returns false if the matrix is not positive
/// definite.
inline bool invert(const Eigen::Matrix3d& A, Eigen::Matrix3d& inverse) noexcept {
  const double c00 = A(1, 1) * A(2, 2) - A(1, 2) * A(1, 2),
               c01 = A(0, 2) * A(1, 2) - A(0, 1) * A(2, 2),
               c02 = A(0, 1) * A(1, 2) - A(0, 2) * A(1, 1),
               c11 = A(0, 0) * A(2, 2) - A(0, 2) * A(0, 2),
               c12 = A(0, 1) * A(0, 2) - A(0, 0) * A(1, 2),
               c22 = A(0, 0) * A(1, 1) - A(0, 1) * A(0, 1);
  const double det = A(0, 0) * c00 + A(0, 1) * c01 + A(0, 2) * c02;
  const double size = A(0, 0) * A(1, 1) * A(2, 2);
  if (!(A(0, 0) > 0 && c22 > 1e-12 * A(0, 0) * A(1, 1) && det > 1e-12 * size)) return false;
  const double per = 1 / det;
  inverse << c00 * per, c01 * per, c02 * per, c01 * per, c11 * per, c12 * per, c02 * per, c12 * per,
      c22 * per;
  return true;
}

class BlockInverse {
 public:
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  using Vector6 = Eigen::Matrix<double, 6, 1>;

  /// Computes the inverse of `A`. Returns false if `A` is not positive definite.
  bool of(const Matrix6& A) noexcept {
    const Eigen::Matrix3d A01 = A.topRightCorner<3, 3>();
    if (!invert(A.topLeftCorner<3, 3>(), first_)) return false;
    across_ = first_ * A01;
    return invert(A.bottomRightCorner<3, 3>() - A01.transpose() * across_, second_);
  }
  /// Returns the inverse times `b`. Precondition: the last call of the member function `of`
  /// returned true.
  Vector6 times(const Vector6& b) const noexcept {
    Vector6 x;
    x.tail<3>() = second_ * (b.tail<3>() - across_.transpose() * b.head<3>());
    x.head<3>() = first_ * b.head<3>() - across_ * x.tail<3>();
    return x;
  }

 private:
  Eigen::Matrix3d first_, across_, second_;
};

// Computes the mechanics of one tool in one bone volume, tick by tick. In each tick a massless
// proxy of the tool moves to a minimum of a potential. The potential is the sum of the energies
// of these elements:
//  - the coupling, a spring between the proxy and the plate
//  - the tip's spring against the cutting front (the depth down to which bone has been cut)
//  - friction of the shaft along and around its axis
//  - friction of the tip, its resistance to being turned, and the hold of crushed bone on the tip
//  - the walls of the hole
//  - layers of soft tissue over the bone
// Each element is elastic up to a limit force. At this force the element yields, and yielding only
// dissipates energy (incremental variational plasticity: Ortiz and Stainier, 1999). In a tick the
// front moves down to its first equilibrium, possibly through several slabs. This is the first
// depth at which the tip's force no longer exceeds the strength of the bone. (A front that moved to
// the global minimum of the energy would cut through a hard layer, such as a cortical shell, long
// before the force reaches that layer's strength.)
//
// Contract:
//  1. The law is passive except for the energy introduced by the zero-order hold. Let w be the
//     wrench on the plate that the previous tick computed and that is held until this tick, dx the
//     displacement of the plate since the previous tick, dx^T its transpose, and K the stiffness of
//     the coupling. Let E0 and E1 be the stored energies before and after this tick, and cut_J the
//     work of cutting in this tick. Then every tick satisfies
//       E1 - E0 + cut_J <= -w . dx + dx^T K dx / 2
//     with the largest tangent of a coupling that stiffens,
//     for any stiffness, any friction and any number of Newton steps. There are two reasons: no
//     Newton step raises the potential, and an element that appears or gets stiffer gains no stored
//     energy. If the coupling is rigid, K is the stiffness of all other elements, expressed at the
//     plate. If the plate rotates, this K has an additional geometric term, because the points at
//     which the elements act move on curved paths.
//  2. The work of cutting is the integral of the strength over the cut depth. The front never moves
//     back. The front cuts bone only while the tip's force exceeds the strength at the front, and
//     at most most_cut_m() of bone in a tick, so that a soft coupling does not let it leap; the
//     rest waits in the springs. Gaps do not count.
//  3. A wall that has yielded stays where it was pushed (walls.h). Uncut material beside the tool is
//     a wall as well (CuttingSlab::free).
//  4. A hole remains after the tool is withdrawn. If the tool's axis comes within `same_hole_m` of
//     a hole, the tool is in that hole again: the tip meets no resistance down to the depth already
//     cut, and the hole's walls and friction act. Elsewhere the tool makes a new hole.
//     CuttingSlab::share reduces the strength for a tool that lies partly over an old hole. (In a
//     session `share` is always 1, because bone_contact.cpp multiplies the strengths by the
//     coverage instead.)
//  5. Soft tissue over the bone has elements of its own (walls.h). The work of cutting soft
//     tissue, `layer_cut_J`, is added to cut_J in the inequality.
//  6. On a sloping surface (CuttingOptions::slope) the tip's spring acts along the surface's
//     normal. The spring's energy depends only on its stretch, and the stretch is carried from tick
//     to tick. So when the surface under the tip changes its direction, the force changes its
//     direction, but the energy stays the same. A new slope replaces the old one at the end of the
//     tick. With a rigid coupling the wrench of the tick is computed after that, so that this
//     wrench and the inequality of the next tick (contract 1) refer to the same slope.
//  7. Inside bone a bevelled tip (CuttingTool::bevel_plate) is pushed to one side. As on a slope,
//     the energy of the tip's spring depends only on its stretch, and the stretch grows by the
//     displacement of the tip along the direction of the force. So when the tip drifts to the side,
//     the stretch falls, and the energy that the spring loses is the work on the wall. The stretch
//     is also the distance from the front down to the tip, so the front moves down
//     as the stretch falls.
//  8. A tick does not allocate, lock or call the system, and takes at most `max_steps` Newton
//     steps.
//
// Depth is -z of {B}: the tool enters the bone downwards, tilted by at most kMaxTilt_deg (scene.h).

struct CuttingTool {
  Eigen::Vector3d tip_plate_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d inward_plate =
      -Eigen::Vector3d::UnitZ();  ///< unit vector along the shaft towards the tip
  double radius_m = 1e-3;         ///< radius at which friction around the shaft acts
  /// Bevel of the tip: a vector perpendicular to `inward_plate` that points to the side on which
  /// the bevel's face is. Its length is the ratio of the tip's lateral force to its force along the
  /// shaft, at most kMaxSlope. Inside bone the force on the tool acts along -(inward_plate +
  /// bevel_plate). Zero: the tip is not pushed to one side.
  Eigen::Vector3d bevel_plate = Eigen::Vector3d::Zero();
};

/// Spring from the plate to the proxy, acting about the plate's origin.
struct CuttingCoupling {
  bool is_rigid = false;  ///< there is no spring: the proxy has the plate's pose
  double translation_N_per_m = 4000, rotation_Nm_per_rad = 20;  ///< largest tangents
  /// Tangents and force up to which the springs are linear (StiffeningSpring); 0: linear springs.
  double soft_N_per_m = 0, knee_N = 0, soft_Nm_per_rad = 0, knee_Nm = 0;
  /// Largest force and moment of the coupling, chosen so that the device can render them. A spring
  /// that is stretched beyond its limit keeps this force or moment (walls.h).
  double max_force_N = std::numeric_limits<double>::infinity();
  double max_moment_Nm = std::numeric_limits<double>::infinity();

  StiffeningSpring translation() const noexcept {
    return {soft_N_per_m > 0 ? soft_N_per_m : translation_N_per_m, translation_N_per_m, knee_N};
  }
  StiffeningSpring rotation() const noexcept {
    return {soft_Nm_per_rad > 0 ? soft_Nm_per_rad : rotation_Nm_per_rad, rotation_Nm_per_rad,
            knee_Nm};
  }
};

/// Largest tangent of the angle between the shaft and the normal of the surface under the tip: the
/// tangent of 60 degrees.
inline constexpr double kMaxSlope = 1.7320508075688772;

inline constexpr double kMostCut_m = 1.4e-3, kMostCut_m_per_s = 1.4;
/// Largest length of bone that is cut in a tick: the larger of the two, so that at low rates the
/// front keeps up with a fast hand.
inline double most_cut_m(double interval_s) noexcept {
  return std::max(kMostCut_m, kMostCut_m_per_s * interval_s);
}

/// Largest number of Gauss points of a hole's wall in each slab. The wall acts on the shaft at
/// these points.
inline constexpr std::size_t kMaxWallPoints = 2;

struct CuttingOptions {
  CuttingTool tool;
  CuttingCoupling coupling;
  double tip_N_per_m = 20'000;  ///< stiffness of the tip against the front
  /// Displacement along and around the shaft at which the shaft begins to slide.
  double presliding_m = 1e-4;
  /// `tip_friction` is the Coulomb friction coefficient between the tip and the material that the
  /// tip presses on. On a surface (`slope`) the friction acts in the surface, elsewhere it acts
  /// across the tool's axis. The friction's limit is the coefficient times the normal force at the
  /// end of the last tick. The friction reaches this limit after a displacement of
  /// `tip_presliding_m`. (For a bevelled tip, too, `tip_friction` acts across the axis inside bone,
  /// because the friction of the bevel's face is already part of the strength.)
  double tip_friction = 0, tip_presliding_m = 1e-4;
  /// Crushed bone holds a tip that is pulled back. The hold is this fraction of the tip's largest
  /// recent force. (Bone under a tip is crushed, not compressed elastically, so it does not push
  /// the tip out again; indentation of foams: L. Gibson, M. Ashby, Cellular Solids, 1997.) The hold
  /// is a friction force that resists only withdrawal. The hold yields after a displacement of
  /// tip_presliding_m, and fades to 0 while the tip is raised by a diameter of the tool. If the tip
  /// has broken through to a place where no bone holds it, it has left the crushed bone, and there
  /// is no hold.
  double tip_hold = 0;
  /// The core in a hollow tool presses on the bore, like grain in a silo (H. Janssen, 1895). The
  /// longer the core is, the larger is the pressure. The shaft's friction is therefore multiplied
  /// by core_friction_factor(). `core_fraction`: fraction of the shaft's friction that acts on the
  /// bore while the core is too short to raise the pressure. `core_growth_per_m`: 2 mu kappa / r,
  /// with the radius r of the bore, its friction coefficient mu, and the ratio kappa of the
  /// pressure across the core to that along the core.
  double core_fraction = 0, core_growth_per_m = 0;
  /// Moment about the axis at which the tip turns in the material. The material resists rotation
  /// only while the tip is under load. The resistance reaches this moment after a rotation that
  /// moves the outline by tip_presliding_m.
  double torsion_Nm = 0;
  /// The tool enters a hole if its axis is at most this far from the hole's slot (walls.h).
  double same_hole_m = 5e-5;
  /// Gradient of the depth of the surface that the tip presses on, with respect to x and y of {B}.
  /// The gradient points downhill, and its length is the tangent of the slope. The tip's force acts
  /// along the surface's normal, so that it pushes the tip downhill. None: bone surrounds the tip,
  /// and the force acts along the shaft. A new value takes effect at the end of the tick (contract
  /// 6). The tangent of the angle between shaft and normal is limited to kMaxSlope.
  std::optional<Eigen::Vector2d> slope;
  /// Largest residual force of Newton's method, relative to the larger of 1 N and the coupling
  /// force.
  double tolerance = 1e-6;
  int max_steps = 24;  ///< largest number of Newton steps in a tick
  /// Number of Gauss points of a hole's wall in each slab, constant during a session. Two points
  /// are exact, because the displacement of a rigid shaft is linear in depth. The value 1 exists
  /// only for the benchmark that compares one point with two (tests/bench/cutting_bench.cpp).
  std::size_t wall_points = kMaxWallPoints;
  double interval_s = 1e-3;  ///< time since the last tick, for viscous elements
  /// Soft tissue over the bone, uppermost first. The number of layers is at most that of
  /// CuttingState::layers.
  std::span<const SoftLayer> layers;
};

/// Resistance of one slab at the current position of the tool. Depths increase from slab to slab.
struct CuttingSlab {
  double top_m = 0, bottom_m = 0;  ///< depths; equal if the slab has no thickness
  /// Strength, which is the force on the tip at which the front advances, at the slab's top and at
  /// its bottom. In between it is linear in depth. The caller supplies the strengths for the tool's
  /// current position, not multiplied by `share`.
  double strength_top_N = 0, strength_bottom_N = 0;
  /// The slab can have walls of cortical bone at its faces. From the slab's top down to the depth
  /// `upper_wall_to_m`, and from the depth `lower_wall_from_m` down to the slab's bottom, the
  /// strength is `cortex_N` instead.
  double cortex_N = 0;
  double upper_wall_to_m = -std::numeric_limits<double>::infinity(),
         lower_wall_from_m = std::numeric_limits<double>::infinity();
  /// `share` is the fraction of the area of the tool's outline that lies over material which other
  /// holes have not cut. It multiplies the strength from the slab's top down to the depth
  /// `share_to_m`. Below that depth the factor is 1.
  double share = 1, share_to_m = std::numeric_limits<double>::infinity();
  /// Only for a slab of thickness 0: the length that counts as embedded while the tip is below the
  /// slab. The following values per length are multiplied by this length.
  double hole_m = 0;
  double friction_N_per_m = 0;    ///< friction of the shaft per embedded length
  double viscous_N_s_per_m2 = 0;  ///< viscous friction of the shaft per embedded length
  /// Stiffness of the wall across the shaft, and the force at which the wall yields, both per
  /// embedded depth.
  double wall_N_per_m2 = 0, wall_strength_N_per_m = 0;
  double clearance_m = 0;  ///< clearance of a new hole around the shaft
  /// The positions (x, y) of the axis at which the tool touches no uncut material. The boundary of
  /// this region acts as a wall on a tool that approaches the material from the side. Null: there
  /// is no such wall. When `free_version` changes (the first region has version 1), the new region
  /// replaces the slot of the hole without adding stored energy. With a rigid coupling this
  /// replacement waits until the shaft presses on no wall.
  const Slot* free = nullptr;
  std::uint32_t free_version = 0;
};

/// State of one hole in one slab.
struct CuttingHoleSlab {
  double cut_m = -std::numeric_limits<double>::infinity();  ///< depth down to which the hole is cut
  /// Vertical length of the slab that the shaft fills, or CuttingSlab::hole_m if the shaft passes a
  /// slab of thickness 0.
  double embedded_m = 0;
  /// Stiffness of the wall at one Gauss point, and force at which the wall yields there. Both are
  /// those of the last tick.
  double wall_N_per_m = 0, wall_most_N = 0;
  std::array<double, kMaxWallPoints> depth_m{};  ///< depths of the Gauss points
  std::uint32_t free_version = 0;  ///< CuttingSlab::free_version of the region in `walls`; 0: none
  std::array<Slot, kMaxWallPoints> walls;  ///< slot of the hole at each Gauss point
};

struct CuttingHole {
  int first = -1;               ///< slab in which the hole begins; -1: there is no hole
  std::uint64_t last_used = 0;  ///< last tick in which the tool was in the hole
  std::vector<CuttingHoleSlab> slabs;
};

struct CuttingState {
  bool has_begun = false;  ///< false: in the next tick the proxy starts at the plate
  Pose T_device_proxy;
  /// Distance along the shaft from the front down to the tip, negative if the tip is above the
  /// front. A positive stretch loads the tip's spring. The stretch is carried from tick to tick and
  /// must not be recomputed from the geometry, because this would add energy.
  double stretch_m = 0;
  /// Index of the slab of thickness 0 on which the front rests; -1: none. Until the front cuts this
  /// slab, the front stays at the slab's depth. The depth is not recomputed from the stretch, even
  /// if the tool tilts.
  int bearing = -1;
  double front_m = 0;                    ///< depth of the front at the end of the last tick
  std::optional<Eigen::Vector2d> slope;  ///< CuttingOptions::slope of the last tick
  /// Depth by which the front has moved down because the tip slid down a slope. No bone surrounds
  /// the tool over this depth.
  double slid_m = 0;
  double friction_N_per_m = 0;  ///< stiffness of the shaft's friction in the last tick
  /// Elastic slip of the shaft's friction (the deflection of the friction's spring): along the
  /// shaft, and around the shaft at the tool's radius.
  Eigen::Vector2d presliding_m = Eigen::Vector2d::Zero();
  double tip_friction_N_per_m = 0;  ///< stiffness of the tip's friction in the last tick
  Eigen::Vector3d tip_slip_m = Eigen::Vector3d::Zero();  ///< elastic slip of the tip's friction
  /// Largest recent force of the tip on the bone. It decays towards the present force while the
  /// front advances by about a diameter of the tool. It is 0 after an advance that ends where no
  /// bone holds the tip: in a gap, in a hole, or below all bone.
  double hold_tip_N = 0;
  double hold_depth_m = 0;  ///< largest depth of the tip since hold_tip_N became positive
  double hold_N_per_m = 0;  ///< stiffness of the hold in the last tick
  /// Elastic slip of the hold along the shaft: negative while the hold resists withdrawal, else 0.
  double hold_slip_m = 0;
  double torsion_N_per_m = 0;  ///< stiffness against the tip's rotation in the last tick
  double torsion_slip_m = 0;   ///< elastic slip of this rotation, at the tool's radius
  int hole = -1;               ///< index of the hole that the tool is in; -1: none
  int embedded_from = 0, embedded_to = 0;  ///< slabs that the shaft fills, [from, to)
  std::uint64_t tick = 0;                  ///< number of ticks so far
  std::vector<CuttingHole> holes;  ///< fixed size; a new hole replaces the least recently used one
  std::vector<SoftLayerState> layers;
  /// These two members are memory for the sums over the walls (walls.h). They affect results
  /// only by rounding.
  std::vector<std::uint32_t> wall_points;  ///< capacity for all points of a hole
  double wall_radius_m = 1e-6;
};

/// Returns the factor by which the core increases the friction of a shaft with this embedded
/// length. The exponent core_growth_per_m * embedded_m is limited to kMaxCoreExponent.
double core_friction_factor(const CuttingOptions& options, double embedded_m) noexcept;
inline constexpr double kMaxCoreExponent = 4;

/// Allocates the state for these numbers of slabs, remembered holes and soft layers.
CuttingState make_cutting_state(std::size_t slabs, std::size_t holes, std::size_t layers = 0);

/// Sets all forces on the tool to zero. Afterwards the tool is in no hole, and in the next tick the
/// proxy starts at the plate. The holes remain.
void release(CuttingState& state) noexcept;

struct CuttingResult {
  Wrench wrench_device = Wrench::Zero();  ///< wrench on the plate, about the plate's origin
  double tip_N = 0;                       ///< force on the tip, along the shaft
  double stored_J = 0;                    ///< energy that all elements store
  double cut_J = 0;                       ///< work of cutting bone in this tick
  double layer_N = 0;                     ///< force of the soft layers, along the shaft
  double layer_cut_J = 0;  ///< work of cutting soft layers in this tick, not contained in cut_J
  /// Soft layers that were punctured in this tick: bit i stands for layer i. A layer in which the
  /// tool entered a hole again is not among them.
  std::uint64_t layers_punctured = 0;
  /// Depth of the front. If the tip is not under load: depth of the next uncut bone below the tip,
  /// or infinity if there is none.
  double front_m = 0;
  double embedded_m = 0;  ///< embedded length of the shaft in all slabs
  /// Slabs whose bottom the front passed in this tick, [from, to). The caller requests holes in the
  /// meshes of these slabs. A slab is reported once for each hole through the slab. If
  /// CuttingState::holes is empty, the range is empty.
  int passed_from = 0, passed_to = 0;
  int steps = 0;        ///< number of Newton steps
  int evaluations = 0;  ///< number of evaluations of the potential
  bool has_converged = true;
};

/// Runs one tick. Precondition: `state` was made for as many slabs as `slabs` has.
/// `T_device_plate`: the pose at which the law is evaluated. If this is a predicted pose, dx in
/// contract 1 is the displacement between predicted poses. The caller then computes the work on the
/// real plate from the measured poses.
void cutting_tick(const CuttingOptions& options, const Pose& T_device_plate,
                  std::span<const CuttingSlab> slabs, CuttingState& state,
                  CuttingResult& result) noexcept;

}  // namespace trocar::runtime
