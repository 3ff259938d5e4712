// SPDX-License-Identifier: Apache-2.0
// One tick of the cutting law: working data, potential, and equilibrium.
#pragma once

#include <algorithm>

#include "runtime/haptics/bone/cutting_law.h"
#include "runtime/haptics/bone/walls.h"

namespace trocar::runtime {

// Working data of one tick of the cutting law. cutting_law.cpp passes it to the functions of
// holes.h, front.h and this header. Before the tick, bone_contact.cpp
// makes another object of this type, to ask holes.h which hole the tool is in.

struct Tick {
  const CuttingOptions& options;
  const Pose& plate;
  std::span<const CuttingSlab> slabs;
  CuttingState& state;
  std::span<const SoftLayer> layers;  ///< soft tissue over the bone; SoftLayerState in `state`

  /// The proxy's pose at the start of the tick. The proxy's displacement in the tick is measured
  /// from this pose. `axis` is the unit vector along the tool towards its tip, and `tip` is the
  /// tip, both at this pose and in {B}. `down` is the downward component of `axis`, and `back` is
  /// the inverse of the pose's rotation.
  Pose start{};
  Eigen::Quaterniond back = Eigen::Quaterniond::Identity();
  Eigen::Vector3d axis = -Eigen::Vector3d::UnitZ(), tip = Eigen::Vector3d::Zero();
  double down = 1;
  /// Vector along which the tip presses on the front, with a component of 1 along the axis. If the
  /// tip moves by the vector d, the stretch of the tip's spring (CuttingState::stretch_m) grows by
  /// the dot product of `press` and d. Inside bone `press` is the axis, or for a bevelled tip the
  /// sum of the axis and CuttingTool::bevel_plate, turned into {B}. On a surface `press` is
  /// parallel to the inward normal, up to the slope kMaxSlope (tilt_of_surface()).
  Eigen::Vector3d press = axis;
  /// The tip's friction acts perpendicular to this vector. On a surface the vector is `press`, and
  /// inside bone it is the axis.
  Eigen::Vector3d normal = axis;

  int hole = -1;  ///< index of the hole that the tool is in or would enter; -1: none
  double front_m = 0, first_front_m = 0;  ///< depth of the front now, and at the tick's start
  double cut_m = 0;                       ///< length of bone that was cut in this tick
  bool is_free = false;                   ///< after the front's last move, no bone holds the tip
  double embedded_m = 0;                  ///< embedded length of the shaft in all slabs
  double friction_N = 0;                  ///< friction force at which the shaft slides
  double viscous_N_s_per_m = 0;           ///< viscous friction along the shaft
  double tip_friction_N = 0;  ///< force at which the tip slides perpendicular to `normal`
  double hold_N = 0;          ///< force at which the tip slides back out of crushed bone
  double torsion_N = 0;       ///< moment at which the tip turns, divided by the tool's radius
  mutable WallModel walls{};  ///< cached sums of wall forces; call forget() if a wall changes

  /// Sets the pose `start` and the vectors that follow from it.
  void start_at(const Pose& X) noexcept {
    start = X;
    axis = X.q * options.tool.inward_plate;
    tip = X * options.tool.tip_plate_m;
    down = -axis.z();
    back = X.q.conjugate();
    press = normal = axis;
    if (state.slope)
      press = normal += tilt_of_surface(*state.slope);
    else if (has_bevel())
      press += X.q * options.tool.bevel_plate;
  }

  bool is_on_surface() const noexcept { return state.slope.has_value(); }
  bool has_bevel() const noexcept { return !options.tool.bevel_plate.isZero(0); }
  /// Depth down to which bone surrounds the tool.
  double filled_to_m() const noexcept {
    return std::min(front_m - std::max(state.slid_m, 0.0), -tip.z());
  }

  /// Changes CuttingState::tip_slip_m, the stretch of the spring of the tip's friction. Subtracts
  /// the component along `normal`, and limits the length to tip_presliding_m. Neither step raises
  /// the stored energy, so the law stays passive.
  void limit_tip_slip() noexcept {
    Eigen::Vector3d& slip = state.tip_slip_m;
    slip -= normal * (normal.dot(slip) / normal.squaredNorm());
    const double length = slip.norm();
    if (length > options.tip_presliding_m) slip *= options.tip_presliding_m / length;
  }

  /// Returns the difference `press` - `axis` on a surface with this slope. It is perpendicular to
  /// `axis`. Its length is the tangent of the angle between `axis` and the surface's inward normal,
  /// but at most kMaxSlope. `slope`: gradient of the surface's depth with respect to x and y.
  Eigen::Vector3d tilt_of_surface(const Eigen::Vector2d& slope) const noexcept {
    const Eigen::Vector3d upward(slope.x(), slope.y(), 1);
    const double along = upward.dot(axis);
    const Eigen::Vector3d across = upward - along * axis;
    return across / std::min({along, -across.norm() / kMaxSlope, -1e-9});
  }

  int slab_count() const noexcept { return static_cast<int>(slabs.size()); }
  const CuttingSlab& slab(int i) const noexcept { return slabs[static_cast<std::size_t>(i)]; }
  /// Index of the first slab whose bottom is at this depth or deeper; slab_count() if none is.
  int slab_at(double depth_m) const noexcept {
    const auto at = std::lower_bound(slabs.begin(), slabs.end(), depth_m,
                                     [](const CuttingSlab& s, double d) { return s.bottom_m < d; });
    return static_cast<int>(at - slabs.begin());
  }
  CuttingHole& hole_in_use() const noexcept {
    return state.holes[static_cast<std::size_t>(state.hole)];
  }
};

/// Intersection (x, y) of the tool's axis with the horizontal plane at a depth.
inline Eigen::Vector2d crossing(const Eigen::Vector3d& tip, const Eigen::Vector3d& axis,
                                double depth_m) noexcept {
  const double along = (-depth_m - tip.z()) / axis.z();
  return {tip.x() + along * axis.x(), tip.y() + along * axis.y()};
}

/// Depth of Gauss point `g` of a slab that has `points` Gauss points of equal weight.
inline double gauss_depth(const CuttingSlab& slab, std::size_t g,
                          std::size_t points = kMaxWallPoints) noexcept {
  constexpr std::array<double, kMaxWallPoints> kPlaceOfPoint{0.21132486540518713,
                                                             0.78867513459481287};
  const double part = points == 1 ? 0.5 : kPlaceOfPoint[g];
  return slab.top_m + part * (slab.bottom_m - slab.top_m);
}

// Evaluates the potential that the proxy minimises in a tick (the sum of the energies of all
// elements, cutting_law.h), and the potential's first and second derivatives with respect to the
// proxy's displacement. The displacement consists of a translation and of a rotation about the
// plate's origin, in {B}.

/// The potential and its derivatives at one pose.
struct Evaluation {
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  using Vector6 = Eigen::Matrix<double, 6, 1>;

  Pose X;
  /// The potential V in joules, and the parts that its elements contribute.
  double V = 0, coupling_J = 0, friction_J = 0, wall_J = 0, viscous_J = 0, layer_J = 0,
         tip_friction_J = 0, hold_J = 0, torsion_J = 0;
  double pressed_N_per_m = 0;        ///< sum of the stiffnesses of tip and soft layers
  double pressed_m = 0;              ///< growth of the tip's stretch since the start of the tick
  double tip_N = 0, coupling_N = 0;  ///< force on the tip, and force of the coupling
  /// Displacements of the shaft since the start of the tick, elastic ones included: along its axis,
  /// and around its axis at the tool's radius.
  Eigen::Vector2d slide = Eigen::Vector2d::Zero();
  Vector6 along = Vector6::Zero();                   ///< derivative of slide[0]
  Vector6 press = Vector6::Zero();                   ///< derivative of pressed_m
  Eigen::Vector3d around = Eigen::Vector3d::Zero();  ///< derivative of slide[1] for a rotation
  /// Displacement of the tip perpendicular to Tick::normal since the start of the tick.
  Eigen::Vector3d tip_slide = Eigen::Vector3d::Zero();
  Vector6 coupling = Vector6::Zero();  ///< derivative of coupling_J; also the wrench on the plate
  Vector6 g = Vector6::Zero();         ///< first derivative of V
  Matrix6 H = Matrix6::Zero();         ///< second derivative of V
  /// `walls_yield`: a wall is loaded beyond its strength. `is_saturated`: the coupling is at its
  /// largest force or moment.
  bool walls_yield = false, is_saturated = false;
};

/// Evaluates the potential at the proxy's pose X. If `majorise` is true, H is the second derivative
/// of a parabola that touches the potential at X and lies above the potential elsewhere, even where
/// elements yield (walls.h). The function adds 1 to `out.evaluations`.
void evaluate(const Tick& tick, const Pose& X, bool majorise, Evaluation& e,
              CuttingResult& out) noexcept;

// Finds the equilibrium of a tick by Newton's method. The proxy moves to a minimum of the potential
// for the present cutting front. The potential is the sum of the energies of all elements, such as
// coupling, friction and walls. The front then moves down to the first depth at
// which the tip's force does not exceed the strength of the bone; the front is then in equilibrium.
// No step raises the potential.

/// Moves the proxy, the front and the fronts of soft layers to the equilibrium. Precondition: `e`
/// is the potential at the start of the tick. On return `e` is the potential at the proxy's new
/// pose. If Newton's method did not converge, `out.has_converged` is false.
void settle(Tick& tick, Evaluation& e, CuttingResult& out) noexcept;

}  // namespace trocar::runtime
