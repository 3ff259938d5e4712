// SPDX-License-Identifier: Apache-2.0
// Soft layers, the walls of a hole and its slot, and the springs that yield.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace trocar::runtime {

// A spring that yields: it is elastic up to a limit force, and beyond that its force is constant.
// The spring's energy as a function of its extension is the function of Huber (1964).

/// Energy, force, and second derivatives of the energy along the spring and across it.
struct YieldSpring {
  double energy = 0, force = 0, along = 0, across = 0;
};

/// Evaluates a spring. `most`: the force at which the spring yields. `length`: the spring's
/// extension, at least 0. If `majorise` is true, the second derivative along the spring is that of
/// a parabola that touches the energy at `length` and lies above the energy everywhere else. (If
/// Newton's method fails with the true derivative, it uses this one.)
inline YieldSpring yield_spring(double stiffness, double most, double length,
                                bool majorise) noexcept {
  if (stiffness * length <= most)
    return {0.5 * stiffness * length * length, stiffness * length, stiffness, stiffness};
  const double across = most / length;
  return {most * length - 0.5 * most * most / stiffness, most, majorise ? across : 0, across};
}

// A spring that stiffens with its force, for the coupling between plate and proxy: a large force
// hides more noise, so it may be stiffer. The force is soft * r up to `knee`; beyond, it grows
// exponentially, with the tangent soft * F / knee, until the tangent is `stiff`; then it grows
// linearly with `stiff`; at the limit force it yields. The energy is the integral of the force.

struct StiffeningSpring {
  double soft = 0, stiff = 0;  ///< smallest and largest tangent; equal: a linear spring
  double knee = 0;             ///< force
};

/// As YieldSpring. `bound`: second derivative of a parabola that touches the energy at `length` and
/// lies above it everywhere else.
struct StiffeningForce {
  double energy = 0, force = 0, along = 0, across = 0, bound = 0;
  bool yields = false;
};
StiffeningForce stiffening_force(const StiffeningSpring& spring, double most,
                                 double length) noexcept;
/// Length at which the spring has a force, without a limit.
double length_at(const StiffeningSpring& spring, double force) noexcept;

// Layers of soft tissue over the bone, such as skin, a ligament or the dura. Before its puncture a
// layer is a stiffening spring. After the puncture the layer is cut at a constant force, and there
// is friction between the layer and the shaft (Okamura, Simone and O'Leary, IEEE Trans. Biomed.
// Eng. 51, 2004).
//
// Each layer is a spring of its own between the tip and the layer's front, which is the depth
// down to which the layer is cut. The forces of this spring and of the tip's spring in the bone add
// up. The two springs have separate stretches, because a layer stretches by millimetres and bone by
// micrometres. Let z be the layer's stretch: stretch_m plus the tip's displacement along the shaft
// in this tick, but at least 0. The layer's incremental potential is
//   W(z) = a1 z^2 / 2 + a2 z^3 / 3,
// which is convex in the displacement because a1, a2 >= 0. Two internal variables describe the
// layer: whether it is punctured, and the depth of its front. The puncture changes no energy. The
// front only moves down. This motion shortens z, so W can only decrease.
//
// Contract:
//  1. The energy inequality of cutting_law.h (contract 1) holds with `layer_cut_J` added on its left side.
//  2. If the tip came from above, the layer's force until the puncture is a1 z + a2 z^2. Here z is
//     the distance along the shaft from the layer's top down to the tip.
//  3. The tip presses directly only on the uppermost layer that it has not cut through. It presses
//     on all lower tissue through that layer. Therefore only that layer can be punctured or cut.
//     The force that punctures or cuts it is the sum of the layer's own force and the forces of all
//     tissue below. A thin layer close below a strong one can be cut in the same tick as the strong
//     one, if at that moment the force on the thin layer already exceeds its puncture force.
//  4. A punctured layer is cut down to its bottom at the force `cutting_N`. When it is cut
//     through, the layer exerts only friction in this hole. The hole remains after the tool is
//     withdrawn. A tool that returns within a tool radius of the hole enters the hole again.
//     Elsewhere the layer is uncut.
//  5. While the stretch of a layer is positive (the layer is loaded), it is carried from tick to
//     tick. Otherwise it is computed from the geometry in each tick.
//  6. No allocation. In one tick the fronts of layers advance at most kMaxLayerAdvances times. If
//     more advances are necessary, they follow in the next tick.

inline constexpr int kMaxLayerAdvances = 12;

struct SoftLayer {
  double top_m = 0, bottom_m = 0;  ///< depths while the layer is unstretched
  double stiffness_N_per_m = 0;    ///< a1, the stiffness of the unstretched layer
  double stiffening_N_per_m2 = 0;  ///< a2, which makes the layer stiffer when stretched
  /// The layer is punctured when the total force of this layer and all lower tissue exceeds this
  /// force.
  double puncture_N = 0;
  double cutting_N = 0;         ///< force of cutting after the puncture, at most puncture_N
  double friction_N_per_m = 0;  ///< friction of the shaft per cut depth
};

/// Force, energy and stiffness of a layer that is stretched by z.
struct SoftSpring {
  double energy_J = 0, force_N = 0, stiffness_N_per_m = 0;
};
inline SoftSpring soft_spring(const SoftLayer& layer, double z_m) noexcept {
  if (z_m <= 0) return {};
  const double a1 = layer.stiffness_N_per_m, a2 = layer.stiffening_N_per_m2;
  return {z_m * z_m * (0.5 * a1 + z_m * a2 / 3), z_m * (a1 + z_m * a2), a1 + 2 * z_m * a2};
}
/// Returns the stretch at which the layer's force is `force_N`. The stretch is at least 0, and
/// infinite if the layer has no stiffness.
double stretch_at(const SoftLayer& layer, double force_N) noexcept;

struct SoftHole {
  Eigen::Vector2d at_m = Eigen::Vector2d::Zero();  ///< position at the layer's top, x and y in {B}
  double cut_m = 0;                                ///< depth down to which the hole is cut
  std::uint64_t last_used = 0;                     ///< number of the tick of last use; 0: no hole
};

struct SoftLayerState {
  double stretch_m = 0;       ///< distance of the tip beyond the front, along the shaft
  bool is_punctured = false;  ///< the layer is punctured at the tool's position
  double cut_m = 0;           ///< depth of the front at the tool's position
  bool is_in = false;         ///< the tip is below the layer's top
  Eigen::Vector2d at_m = Eigen::Vector2d::Zero();  ///< position of the puncture
  std::vector<SoftHole> holes;  ///< fixed size; a new hole replaces the least recently used one
};

// Sums the forces and stiffnesses of the walls of the hole that the tool is in. Each slab has Gauss
// points at which the wall acts, and each Gauss point has a slot, which is the region in
// which the shaft's axis does not press on the wall. While the shaft stays close to a reference
// position, the nearest corner or edge of most slots stays the same. If this is so at a Gauss
// point, and if the wall does not yield there, the energy of the point is a quadratic function of
// the shaft's displacement. If the slot has a clearance, a point counts as quadratic only inside
// the clearance, where its energy is 0. The sum over all quadratic points is quadratic as well, and
// its coefficients are kept. Therefore usually only the first evaluation of a tick visits all
// points. Later evaluations visit only the few points whose energy is not quadratic.
//
// Contract: add_walls() adds the sum over all
// Gauss points, quadratic or not. Apart from rounding, the sum does not depend on the poses of
// earlier evaluations.

struct Tick;
struct Evaluation;

/// The axis of the shaft. The axis crosses the horizontal plane at depth d in the point
/// at_m + d * per_depth.
struct ShaftLine {
  Eigen::Vector2d at_m = Eigen::Vector2d::Zero(), per_depth = Eigen::Vector2d::Zero();
  Eigen::Vector2d crossing(double depth_m) const noexcept { return at_m + depth_m * per_depth; }
};

/// Sums over Gauss points: the energy, and the forces and stiffnesses multiplied by powers of the
/// depth. add_walls() computes the derivatives with respect to the proxy's six coordinates from
/// these sums.
class WallSums {
 public:
  double energy_J = 0;

  void add_force(double depth_m, const Eigen::Vector2d& force_N) noexcept {
    force_[0] += force_N;
    force_[1] += depth_m * force_N;
  }
  /// Adds a stiffness k that is the same in all horizontal directions.
  void add_in_all_directions(double depth_m, double k) noexcept {
    k_[0] += k;
    k_[1] += depth_m * k;
    k_[2] += depth_m * depth_m * k;
  }
  /// Adds the stiffness matrix k v v^T. If v is a unit vector, this is a spring k along v.
  void add_along(double depth_m, double k, const Eigen::Vector2d& v) noexcept {
    const Eigen::Vector2d scaled = k * v, squares = scaled.cwiseProduct(v);
    const double mixed = scaled.x() * v.y(), depth2 = depth_m * depth_m;
    squares_[0] += squares;
    squares_[1] += depth_m * squares;
    squares_[2] += depth2 * squares;
    mixed_[0] += mixed;
    mixed_[1] += depth_m * mixed;
    mixed_[2] += depth2 * mixed;
  }
  /// Returns the sums after the shaft has moved by `by`, assuming that the stiffness of every point
  /// stays constant.
  WallSums moved(const ShaftLine& by) const noexcept {
    const Eigen::Matrix2d S1 = stiffness(1);
    const Eigen::Vector2d more = stiffness(0) * by.at_m + S1 * by.per_depth,
                          more_below = S1 * by.at_m + stiffness(2) * by.per_depth;
    WallSums out = *this;
    out.energy_J +=
        (force_[0] + 0.5 * more).dot(by.at_m) + (force_[1] + 0.5 * more_below).dot(by.per_depth);
    out.force_[0] += more;
    out.force_[1] += more_below;
    return out;
  }

  /// Sum of the forces, each multiplied by its depth to the power of 0 or 1.
  const Eigen::Vector2d& force(std::size_t power) const noexcept { return force_[power]; }
  /// Sum of the stiffnesses, each multiplied by its depth to the power of 0, 1 or 2.
  Eigen::Matrix2d stiffness(std::size_t power) const noexcept {
    const Eigen::Vector2d& squares = squares_[power];
    Eigen::Matrix2d S;
    S << k_[power] + squares.x(), mixed_[power], mixed_[power], k_[power] + squares.y();
    return S;
  }

 private:
  std::array<double, 3> k_{}, mixed_{};
  std::array<Eigen::Vector2d, 2> force_{Eigen::Vector2d::Zero(), Eigen::Vector2d::Zero()};
  std::array<Eigen::Vector2d, 3> squares_{Eigen::Vector2d::Zero(), Eigen::Vector2d::Zero(),
                                          Eigen::Vector2d::Zero()};
};

/// Cached sums over the quadratic points. A point is quadratic if its energy is a quadratic
/// function while the shaft stays within a radius of the position that the shaft had at the last
/// visit of all points. The radius, CuttingState::wall_radius_m, is adapted to the motion of the
/// shaft in a tick. With a larger radius fewer points are quadratic. With a smaller radius all
/// points are visited more often.
class WallModel {
 public:
  /// Empties the cache. Call this when a wall has changed.
  void forget() noexcept { is_known_ = false; }
  /// Returns the sums over the quadratic points for the shaft at `line`. Afterwards the first
  /// others() entries of CuttingState::wall_points list the points that are not in the sums. Gauss
  /// point g of slab i is listed as kMaxWallPoints * i + g.
  WallSums at(const Tick& tick, const ShaftLine& line) noexcept;
  std::size_t others() const noexcept { return others_; }

 private:
  void learn(const Tick& tick, const ShaftLine& line) noexcept;

  bool is_known_ = false;
  ShaftLine line_;
  // reach_m_: the radius for which the sums hold. top_m_, bottom_m_: depths of the first and the
  // last point.
  double reach_m_ = 0, top_m_ = 0, bottom_m_ = 0;
  WallSums sums_;
  std::size_t others_ = 0;
};

/// Adds the walls to the energy and its derivatives in `e`. `lever`: vector from the plate's origin
/// to the tip. `majorise`: as for evaluate() (tick.h).
void add_walls(const Tick& tick, const Eigen::Vector3d& tip, const Eigen::Vector3d& axis,
               const Eigen::Vector3d& lever, bool majorise, Evaluation& e) noexcept;

// The slot of a hole: the region of one horizontal plane in which the tool's axis can be without
// the shaft pressing on the hole's wall. The region is the convex hull of at most kMaxCorners
// points, the corners, widened on all sides by the clearance (the gap between shaft and wall). The
// region can only grow, so that pushing the wall aside always costs energy. (A region that moved
// with the tool would close again behind the tool.)
//
// Contract:
//  1. reach(p).distance_m is the distance of p from the convex hull of the corners, minus the
//     clearance, but at least 0.
//  2. include(p) extends the region so that it contains p, unless p is less than a femtometre away
//     from it. The hull gets one more corner, which lies between p and the hull at the distance of
//     the clearance from p. Without clearance the result is the convex hull of the region and p. If
//     the hull then has more than kMaxCorners corners, one edge is removed by extending its two
//     neighbours until they intersect. The removed edge is the one whose removal adds the least
//     area to the hull. include() never increases the distance of any point from the region.

class Slot {
 public:
  static constexpr int kMaxCorners = 8;

  /// Sets the region to the disc around `at_m` whose radius is the clearance.
  void open(const Eigen::Vector2d& at_m, double clearance_m) noexcept;
  bool is_open() const noexcept { return size_ > 0; }
  void close() noexcept { size_ = 0; }

  /// Position of a point relative to the region.
  struct Reach {
    double distance_m = 0;
    Eigen::Vector2d away =
        Eigen::Vector2d::Zero();  ///< unit vector away from the region; zero inside
    /// Consider the curve of constant distance_m that passes through the point. `bend` is
    /// distance_m divided by the curve's radius of curvature: 1 next to a corner without clearance,
    /// and 0 next to an edge. `bend` is also the second derivative of distance_m^2 / 2 in the
    /// direction perpendicular to `away`.
    double bend = 0;
  };
  /// Returns the position of `p_m` relative to the region (contract 1).
  Reach reach(const Eigen::Vector2d& p_m) const noexcept;

  /// Vector from the nearest point of the hull to a point. The clearance is not subtracted. For a
  /// point inside the hull the vector is zero.
  struct Offset {
    double x_m = 0, y_m = 0;
    bool beside_corner = false;  ///< the nearest point of the hull is a corner
  };
  /// Returns the offset of `p_m`. To save time, the search starts at the edge or corner that was
  /// nearest to the previous point.
  Offset offset(const Eigen::Vector2d& p_m) const noexcept {
    if (size_ == 1) return {p_m.x() - corners_[0].x(), p_m.y() - corners_[0].y(), true};
    if (size_ == 2) {
      const Eigen::Vector2d edge = corners_[1] - corners_[0], to = p_m - corners_[0];
      const double along = to.dot(edge) / edge.squaredNorm();
      // If rounding has merged both corners, `along` is 0 / 0. This order of min and max gives 0.
      const double part = std::min(1.0, std::max(0.0, along));
      return {to.x() - part * edge.x(), to.y() - part * edge.y(), part != along};
    }
    if ((p_m - middle_m_).squaredNorm() < disc_m_ * disc_m_) return {};
    return offset_of_many(p_m);
  }

  /// Checks whether one and the same corner or edge of the hull is nearest to all points within
  /// `reach_m` of `p_m`. If so, calls corner(offset) or edge(offset, edge, squared length of the
  /// edge), and returns the result of that call. Here `offset` is the vector from the corner or
  /// edge to `p_m`, and `edge` is the vector along the edge. If all the points are inside the hull,
  /// returns true without a call. Returns false if no single corner or edge is nearest to all
  /// the points. A hull with more than two corners is checked only at the edge or corner where
  /// the search of offset() would start; if this does not decide the question, the function
  /// returns false, too.
  template <class Corner, class Edge>
  bool nearest(const Eigen::Vector2d& p_m, double reach_m, Corner&& corner,
               Edge&& edge) const noexcept {
    if (size_ == 1) return corner(p_m - corners_[0]);
    if (size_ == 2) {
      const Eigen::Vector2d to = p_m - corners_[0], side = corners_[1] - corners_[0];
      const double along = to.dot(side), length2 = side.squaredNorm(), beyond = along - length2,
                   reach2 = reach_m * reach_m * length2;
      if (along * along < reach2 || beyond * beyond < reach2) return false;
      if (along <= 0) return corner(to);
      if (beyond >= 0) return corner(to - side);
      return edge(to - (along / length2) * side, side, length2);
    }
    const Nearest n = nearest_of_many(p_m, reach_m);
    if (n.part == Nearest::kCorner) return corner(n.offset_m);
    if (n.part == Nearest::kEdge) return edge(n.offset_m, n.edge_m, n.edge_m.squaredNorm());
    return n.part == Nearest::kInside;
  }
  double clearance_m() const noexcept { return clearance_m_; }

  /// Extends the region (contract 2).
  void include(const Eigen::Vector2d& p_m) noexcept;

  int corners() const noexcept { return size_; }
  const Eigen::Vector2d& corner(int i) const noexcept {
    return corners_[static_cast<std::size_t>(i)];
  }

 private:
  Offset offset_of_many(const Eigen::Vector2d& p_m) const noexcept;
  /// Result of nearest_of_many(). kInside: all points are inside the hull. kCorner, kEdge: this
  /// corner or edge is nearest to all points. kSeveral: several parts are nearest, or the search
  /// could not decide.
  struct Nearest {
    enum { kInside, kCorner, kEdge, kSeveral } part = kSeveral;
    Eigen::Vector2d offset_m = Eigen::Vector2d::Zero(), edge_m = Eigen::Vector2d::Zero();
  };
  Nearest nearest_of_many(const Eigen::Vector2d& p_m, double reach_m) const noexcept;
  void find_disc() noexcept;

  // The members are ordered so that a slot with one or two corners uses a single cache line.
  int size_ = 0;
  // Edge nearest to the previous point. If a corner was nearest: the edge that begins there.
  mutable int last_edge_ = 0;
  double clearance_m_ = 0;
  Eigen::Vector2d middle_m_ = Eigen::Vector2d::Zero();
  double disc_m_ = 0;  // radius of a disc around middle_m_ that lies inside the hull
  std::array<Eigen::Vector2d, kMaxCorners> corners_;  // counter-clockwise
};

}  // namespace trocar::runtime
