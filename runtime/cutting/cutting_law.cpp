// SPDX-License-Identifier: Apache-2.0
#include "runtime/cutting/cutting_law.h"

#include <algorithm>
#include <cmath>

namespace trocar::runtime {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix32 = Eigen::Matrix<double, 3, 2>;

constexpr double kRounding_J = 1e-15;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Depths of the two Gauss points in a slab, as shares of its thickness.
constexpr std::array<double, 2> kGauss{0.21132486540518713, 0.78867513459481287};

// Energy, force and second derivatives of a spring that yields at a force. With `majorise` the one
// along is that of a parabola which lies above the energy everywhere.
struct Huber {
  double energy = 0, force = 0, along = 0, across = 0;
};
Huber huber(double stiffness, double most, double length, bool majorise) noexcept {
  if (stiffness * length <= most)
    return {0.5 * stiffness * length * length, stiffness * length, stiffness, stiffness};
  const double across = most / length;
  return {most * length - 0.5 * most * most / stiffness, most, majorise ? across : 0, across};
}

// The inverse of a symmetric matrix; false if it is not positive definite.
bool invert(const Matrix3d& A, Matrix3d& inverse) noexcept {
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

// The inverse of a symmetric 6 x 6 matrix, by blocks.
class Inverse {
 public:
  // False if the matrix is not positive definite.
  bool of(const Matrix6& A) noexcept {
    const Matrix3d A01 = A.topRightCorner<3, 3>();
    if (!invert(A.topLeftCorner<3, 3>(), first_)) return false;
    across_ = first_ * A01;
    return invert(A.bottomRightCorner<3, 3>() - A01.transpose() * across_, second_);
  }
  Vector6 times(const Vector6& b) const noexcept {
    Vector6 x;
    x.tail<3>() = second_ * (b.tail<3>() - across_.transpose() * b.head<3>());
    x.head<3>() = first_ * b.head<3>() - across_ * x.tail<3>();
    return x;
  }

 private:
  Matrix3d first_, across_, second_;
};

class Tick {
 public:
  Tick(const CuttingOptions& options, const Pose& plate, std::span<const CuttingSlab> slabs,
       CuttingState& state) noexcept
      : o_(options), plate_(plate), slabs_(slabs), state_(state) {
    start_at(state.T_device_proxy);
  }

  void run(CuttingResult& out) noexcept {
    ++state_.tick;
    choose_hole();
    find_front();
    enter_or_leave();
    embed();
    Evaluation e;
    if (o_.coupling.is_rigid) {
      evaluate(plate_, false, e, out);
      const Advance a = scan(e.tip_N, o_.tip_N_per_m);
      if (a.length_m > 0) {
        take(a, out);
        evaluate(plate_, false, e, out);
      }
    } else {
      evaluate(start_, false, e, out);
      settle(e, out);
    }
    finish(e, out);
  }

 private:
  // Slides are measured from a pose, along the shaft's direction there.
  void start_at(const Pose& X) noexcept {
    start_ = X;
    axis_ = X.q * o_.tool.inward_plate;
    tip_ = X * o_.tool.tip_plate_m;
    down_ = -axis_.z();
    back_ = X.q.conjugate();
  }

  // All of the potential at one pose.
  struct Evaluation {
    Pose X;
    double V = 0, coupling_J = 0, friction_J = 0, wall_J = 0;
    double tip_N = 0, coupling_N = 0;
    Vector2d slide = Vector2d::Zero();   // since the tick's start: along, around
    Vector6 along = Vector6::Zero();     // derivative of slide[0]
    Vector3d around = Vector3d::Zero();  // of slide[1], for turns
    Vector6 coupling = Vector6::Zero();
    Vector6 g = Vector6::Zero();
    Matrix6 H = Matrix6::Zero();
    bool walls_yield = false, is_saturated = false;  // the coupling, at its limits
  };

  // How far the front goes along the shaft, with its work and the strength before its end.
  struct Advance {
    double length_m = 0, work_J = 0, strength_N = 0;
    bool ends_free = false;  // in no material
  };

  Vector2d crossing(const Vector3d& tip, const Vector3d& axis, double depth_m) const noexcept {
    const double along = (-depth_m - tip.z()) / axis.z();
    return {tip.x() + along * axis.x(), tip.y() + along * axis.y()};
  }
  Vector2d axis_at(double depth_m) const noexcept { return crossing(tip_, axis_, depth_m); }
  static double gauss_depth(const CuttingSlab& slab, std::size_t g) noexcept {
    return slab.top_m + kGauss[g] * (slab.bottom_m - slab.top_m);
  }

  int slab_count() const noexcept { return static_cast<int>(slabs_.size()); }
  // The first slab whose bottom is at a depth or below.
  int slab_at(double depth_m) const noexcept {
    const auto at = std::lower_bound(slabs_.begin(), slabs_.end(), depth_m,
                                     [](const CuttingSlab& s, double d) { return s.bottom_m < d; });
    return static_cast<int>(at - slabs_.begin());
  }

  // True if the axis meets a slab within or beside the region of the hole there.
  bool is_near(const CuttingHoleSlab& slab, std::size_t i) const noexcept {
    return slab.walls[0].is_open() &&
           slab.walls[0].reach(axis_at(gauss_depth(slabs_[i], 0))).distance_m <= o_.same_hole_m;
  }

  // hole_: that the tool is in, or would enter.
  void choose_hole() noexcept {
    hole_ = state_.hole;
    if (hole_ >= 0) return;
    const int next = slab_at(-tip_.z());
    for (std::size_t h = 0; h < state_.holes.size(); ++h) {
      const CuttingHole& hole = state_.holes[h];
      if (hole.first < 0) continue;
      // At the slab below the tip, or at the sheet above it, of no thickness, that it has passed.
      for (const int slab : {std::max(next, hole.first), next - 1}) {
        if (slab < hole.first || slab >= slab_count()) continue;
        const auto i = static_cast<std::size_t>(slab);
        if (!is_near(hole.slabs[i], i)) continue;
        hole_ = static_cast<int>(h);
        return;
      }
    }
  }

  // Depth above which a slab has nothing to cut for the tool where it is.
  double cut_of(int slab) const noexcept {
    if (hole_ < 0) return -kInfinity;
    const auto i = static_cast<std::size_t>(slab);
    const CuttingHoleSlab& s = state_.holes[static_cast<std::size_t>(hole_)].slabs[i];
    return s.embedded_m > 0 || is_near(s, i) ? s.cut_m : -kInfinity;
  }

  // The front: carried while it is loaded, else the next material below the tip.
  void find_front() noexcept {
    const double tip_m = -tip_.z();
    if (state_.stretch_m > 0) {
      front_ = first_front_ = tip_m - state_.stretch_m * down_;
      return;
    }
    front_ = kInfinity;
    // A sheet of no thickness is not passed by rounding.
    for (int i = slab_at(tip_m - 1e-9); i < slab_count(); ++i) {
      const CuttingSlab& slab = slabs_[static_cast<std::size_t>(i)];
      if (std::max(slab.strength_top_N, slab.strength_bottom_N) <= 0) continue;
      const double cut = cut_of(i);
      if (cut >= slab.bottom_m) continue;
      if (slab.share <= 0 && slab.share_to_m >= slab.bottom_m) continue;
      front_ = std::max({slab.top_m, cut, tip_m});
      if (slab.share <= 0) front_ = std::max(front_, slab.share_to_m);
      front_ = std::min(front_, slab.bottom_m);
      break;
    }
    first_front_ = front_;
    state_.stretch_m = std::min((tip_m - front_) / down_, 0.0);
  }

  // The tool is in a hole as long as it is below the top of the hole's first slab.
  void enter_or_leave() noexcept {
    const double low = std::min(front_, -tip_.z());
    if (state_.hole >= 0) {
      CuttingHole& hole = state_.holes[static_cast<std::size_t>(state_.hole)];
      if (low > slabs_[static_cast<std::size_t>(hole.first)].top_m) {
        hole.last_used = state_.tick;
        return;
      }
      for (int i = state_.embedded_from; i < state_.embedded_to; ++i)
        hole.slabs[static_cast<std::size_t>(i)].embedded_m = 0;
      state_.embedded_from = state_.embedded_to = 0;
      state_.hole = -1;
      return;
    }
    const int slab = slab_at(low);
    if (slab < slab_count() && low > slabs_[static_cast<std::size_t>(slab)].top_m) enter(slab);
  }

  void enter(int slab) noexcept {
    if (hole_ < 0 && !state_.holes.empty()) {
      const auto oldest =
          std::min_element(state_.holes.begin(), state_.holes.end(),
                           [](const auto& a, const auto& b) { return a.last_used < b.last_used; });
      hole_ = static_cast<int>(oldest - state_.holes.begin());
      oldest->first = slab;
      for (CuttingHoleSlab& s : oldest->slabs) {
        s.cut_m = -kInfinity;
        s.embedded_m = 0;
        s.free_version = 0;
        for (Slot& wall : s.walls)
          wall.close();
      }
    }
    if (hole_ < 0) return;
    state_.hole = hole_;
    CuttingHole& hole = state_.holes[static_cast<std::size_t>(hole_)];
    hole.first = std::min(hole.first, slab);
    hole.last_used = state_.tick;
  }

  // Embedded lengths, and with them the stiffness of friction and walls. What grows keeps its
  // force, so that its energy falls; what is new is free of force.
  void embed() noexcept {
    const double low = std::min(front_, -tip_.z());
    double friction = 0;
    int from = 0, to = 0;
    if (state_.hole >= 0) {
      CuttingHole& hole = state_.holes[static_cast<std::size_t>(state_.hole)];
      from = hole.first;
      to = from;
      while (to < slab_count() && slabs_[static_cast<std::size_t>(to)].top_m < low)
        ++to;
      for (int i = from; i < std::max(to, state_.embedded_to); ++i)
        embed(static_cast<std::size_t>(i), low, hole.slabs[static_cast<std::size_t>(i)]);
      for (int i = from; i < to; ++i) {
        const auto k = static_cast<std::size_t>(i);
        embedded_ += hole.slabs[k].embedded_m;
        friction += slabs_[k].friction_N_per_m * hole.slabs[k].embedded_m;
      }
    }
    state_.embedded_from = from;
    state_.embedded_to = to;
    embedded_ /= down_;
    friction_N_ = friction / down_;
    const double stiffness = friction_N_ / std::max(o_.presliding_m, 1e-9);
    if (stiffness > state_.friction_N_per_m)
      state_.presliding_m *= state_.friction_N_per_m / stiffness;
    state_.friction_N_per_m = stiffness;
  }

  void embed(std::size_t i, double low, CuttingHoleSlab& s) const noexcept {
    const CuttingSlab& slab = slabs_[i];
    const double before = s.embedded_m;
    s.embedded_m = std::clamp(low - slab.top_m, 0.0, slab.bottom_m - slab.top_m);
    s.wall_most_N = 0.5 * slab.wall_strength_N_per_m * s.embedded_m;
    const double stiffness = 0.5 * slab.wall_N_per_m2 * s.embedded_m;
    bool has_new_free = slab.free != nullptr && s.free_version != slab.free_version;
    // A rigid tool's wrench is the wall's own: held over the tick, it would not know another wall.
    if (has_new_free && before > 0 && o_.coupling.is_rigid) {
      for (std::size_t g = 0; g < 2; ++g)
        has_new_free = has_new_free && s.walls[g].reach(axis_at(s.depth_m[g])).distance_m <= 0;
    }
    if (s.embedded_m > 0 && (before <= 0 || stiffness > s.wall_N_per_m || has_new_free)) {
      // A tool that comes back beside its hole has left it: it is where the tool is now.
      const bool is_new = before <= 0 && !is_near(s, i);
      if (is_new) s.cut_m = slab.top_m + s.embedded_m;
      for (std::size_t g = 0; g < 2; ++g) {
        s.depth_m[g] = gauss_depth(slab, g);
        const Vector2d at = axis_at(s.depth_m[g]);
        Slot& wall = s.walls[g];
        if (is_new || has_new_free) {
          const double pressed = before > 0 ? wall.reach(at).distance_m : 0;
          if (has_new_free)
            wall = *slab.free;
          else
            wall.open(at, slab.clearance_m);
          const Slot::Reach r = wall.reach(at);
          if (r.distance_m > pressed) wall.include(at - r.away * pressed);
        }
        if (before <= 0) {
          wall.include(at);
        } else {
          const Slot::Reach r = wall.reach(at);
          wall.include(at - r.away * (r.distance_m * s.wall_N_per_m / stiffness));
        }
      }
    }
    if (has_new_free && s.embedded_m > 0) s.free_version = slab.free_version;
    s.wall_N_per_m = stiffness;
  }

  void evaluate(const Pose& X, bool majorise, Evaluation& e, CuttingResult& out) const noexcept {
    ++out.evaluations;
    e.X = X;
    e.g.setZero();
    e.H.setZero();
    const Vector3d axis = X.q * o_.tool.inward_plate, lever = X.q * o_.tool.tip_plate_m;
    const Vector3d tip = X.p_m + lever;
    add_coupling(majorise, e);
    add_axial(tip, lever, majorise, e);
    add_walls(tip, axis, lever, majorise, e);
    const double stretch = state_.stretch_m + e.slide[0];
    e.V = e.coupling_J + e.friction_J + e.wall_J +
          (stretch > 0 ? 0.5 * o_.tip_N_per_m * stretch * stretch : 0);
  }

  void add_coupling(bool majorise, Evaluation& e) const noexcept {
    e.coupling_J = e.coupling_N = 0;
    e.is_saturated = false;
    e.coupling.setZero();
    if (o_.coupling.is_rigid) return;
    const auto add = [&](int at, const Vector3d& v, double k, double most) {
      const double length = v.norm();
      const Huber h = huber(k, most, length, majorise);
      e.coupling_J += h.energy;
      e.is_saturated = e.is_saturated || k * length > most;
      // A little of the stiffness stays where the force is constant, so that H has an inverse.
      for (int i = 0; i < 3; ++i)
        e.H(at + i, at + i) += std::max(h.across, 1e-6 * k);
      if (length > 0) {
        const Vector3d unit = v / length;
        e.coupling.segment<3>(at) = -h.force * unit;
        const double less = h.across - std::max(h.along, 1e-6 * k);
        if (less > 0) e.H.block<3, 3>(at, at) -= less * unit * unit.transpose();
      }
      return h.force;
    };
    e.coupling_N =
        add(0, plate_.p_m - e.X.p_m, o_.coupling.translation_N_per_m, o_.coupling.most_force_N);
    add(3, rotation_vector(plate_.q * e.X.q.conjugate()), o_.coupling.rotation_Nm_per_rad,
        o_.coupling.most_moment_Nm);
    e.g += e.coupling;
  }

  // Tip and friction. The angle around the shaft is measured as 2 sin(angle / 2), whose derivative
  // is simple; the same measure is used throughout, so that energies agree.
  void add_axial(const Vector3d& tip, const Vector3d& lever, bool majorise,
                 Evaluation& e) const noexcept {
    const Eigen::Quaterniond turned = e.X.q * back_;
    const double sign = turned.w() < 0 ? -2 : 2;
    const Vector3d half = sign * turned.vec();
    e.slide = {axis_.dot(tip - tip_), o_.tool.radius_m * axis_.dot(half)};
    e.along << axis_, lever.cross(axis_);
    const double stretch = state_.stretch_m + e.slide[0];
    e.tip_N = o_.tip_N_per_m * std::max(stretch, 0.0);
    double axial = e.tip_N, stiffness = stretch > 0 ? o_.tip_N_per_m : 0;
    e.friction_J = 0;
    if (state_.friction_N_per_m > 0) {
      const Vector2d w = state_.presliding_m + e.slide;
      const double length = w.norm();
      const Huber h = huber(state_.friction_N_per_m, friction_N_, length, majorise);
      e.friction_J = h.energy;
      const Vector2d unit = length > 0 ? Vector2d(w / length) : Vector2d::Zero();
      const double less = h.across - h.along;
      axial += h.force * unit[0];
      stiffness += h.across - less * unit[0] * unit[0];
      const Vector3d around = e.around =
          0.5 * o_.tool.radius_m * (sign * turned.w() * axis_ + half.cross(axis_));
      e.g.tail<3>() += h.force * unit[1] * around;
      const double around2 = h.across - less * unit[1] * unit[1];
      e.H.bottomRightCorner<3, 3>() += around2 * around * around.transpose();
      const double mixed = -less * unit[0] * unit[1];
      if (mixed != 0) {
        const Eigen::Matrix<double, 6, 3> M = mixed * e.along * around.transpose();
        e.H.rightCols<3>() += M;
        e.H.bottomRows<3>() += M.transpose();
      }
    }
    e.g += axial * e.along;
    if (stiffness > 0) e.H += stiffness * e.along * e.along.transpose();
    // The tip's path is curved where the tool turns about the plate.
    if (axial != 0 && !majorise) {
      const Matrix3d M = 0.5 * axial * axis_ * lever.transpose();
      e.H.bottomRightCorner<3, 3>() += M + M.transpose();
      for (int i = 3; i < 6; ++i)
        e.H(i, i) -= axial * axis_.dot(lever);
    }
  }

  // A crossing moves by N' (u + turn x (lever + along * axis)): sums over the Gauss points of
  // polynomials in the distance from the tip make up the derivatives.
  void add_walls(const Vector3d& tip, const Vector3d& axis, const Vector3d& lever, bool majorise,
                 Evaluation& e) const noexcept {
    e.wall_J = 0;
    e.walls_yield = false;
    if (state_.hole < 0) return;
    const CuttingHole& hole = state_.holes[static_cast<std::size_t>(state_.hole)];
    const double per_z = -1 / axis.z(), mx = axis.x(), my = axis.y();
    double energy = 0, gx0 = 0, gy0 = 0, gx1 = 0, gy1 = 0;
    double k0 = 0, k1 = 0, k2 = 0;  // of walls that are as stiff in all directions
    double xx0 = 0, xy0 = 0, yy0 = 0, xx1 = 0, xy1 = 0, yy1 = 0, xx2 = 0, xy2 = 0, yy2 = 0;
    for (int i = state_.embedded_from; i < state_.embedded_to; ++i) {
      const CuttingHoleSlab& s = hole.slabs[static_cast<std::size_t>(i)];
      const double k = s.wall_N_per_m;
      if (k <= 0) continue;
      const double elastic_m = s.wall_most_N / k;
      for (std::size_t g = 0; g < 2; ++g) {
        const double t = (s.depth_m[g] + tip.z()) * per_z;
        const Slot& wall = s.walls[g];
        const Slot::Offset d = wall.offset({tip.x() + t * mx, tip.y() + t * my});
        const double d2 = d.x_m * d.x_m + d.y_m * d.y_m, clearance = wall.clearance_m();
        // A femtometre has no direction that could be computed.
        if (d2 <= std::max(clearance * clearance, 1e-30)) continue;
        double fx, fy;
        const double t2 = t * t;
        if (clearance <= 0 && d2 <= elastic_m * elastic_m) {
          energy += 0.5 * k * d2;
          fx = k * d.x_m;
          fy = k * d.y_m;
          if (d.beside_corner) {
            k0 += k;
            k1 += t * k;
            k2 += t2 * k;
          } else {
            const double per = k / d2, xx = per * d.x_m * d.x_m, xy = per * d.x_m * d.y_m,
                         yy = per * d.y_m * d.y_m;
            xx0 += xx;
            xy0 += xy;
            yy0 += yy;
            xx1 += t * xx;
            xy1 += t * xy;
            yy1 += t * yy;
            xx2 += t2 * xx;
            xy2 += t2 * xy;
            yy2 += t2 * yy;
          }
        } else {
          const double whole = std::sqrt(d2), distance = whole - clearance;
          const Huber h = huber(k, s.wall_most_N, distance, majorise);
          e.walls_yield = e.walls_yield || distance > elastic_m;
          energy += h.energy;
          const double ux = d.x_m / whole, uy = d.y_m / whole;
          fx = h.force * ux;
          fy = h.force * uy;
          const double across = d.beside_corner ? h.across * distance / whole : 0;
          const double more = h.along - across;
          k0 += across;
          k1 += t * across;
          k2 += t2 * across;
          const double xx = more * ux * ux, xy = more * ux * uy, yy = more * uy * uy;
          xx0 += xx;
          xy0 += xy;
          yy0 += yy;
          xx1 += t * xx;
          xy1 += t * xy;
          yy1 += t * yy;
          xx2 += t2 * xx;
          xy2 += t2 * xy;
          yy2 += t2 * yy;
        }
        gx0 += fx;
        gy0 += fy;
        gx1 += t * fx;
        gy1 += t * fy;
      }
    }
    e.wall_J = energy;
    if (energy <= 0) return;
    Matrix32 N, C0, C1;
    N << 1, 0, 0, 1, mx * per_z, my * per_z;
    for (int c = 0; c < 2; ++c) {
      const Vector3d n = N.col(c);
      C0.col(c) = lever.cross(n);
      C1.col(c) = axis.cross(n);
    }
    const Vector2d g0(gx0, gy0), g1(gx1, gy1);
    Eigen::Matrix2d H0, H1, H2;
    H0 << k0 + xx0, xy0, xy0, k0 + yy0;
    H1 << k1 + xx1, xy1, xy1, k1 + yy1;
    H2 << k2 + xx2, xy2, xy2, k2 + yy2;
    e.g.head<3>() += N * g0;
    e.g.tail<3>() += C0 * g0 + C1 * g1;
    const Matrix32 NH0 = N * H0, NH1 = N * H1, CH0 = C0 * H0 + C1 * H1, CH1 = C0 * H1 + C1 * H2;
    e.H.topLeftCorner<3, 3>() += NH0 * N.transpose();
    const Matrix3d mixed = NH0 * C0.transpose() + NH1 * C1.transpose();
    e.H.topRightCorner<3, 3>() += mixed;
    e.H.bottomLeftCorner<3, 3>() += mixed.transpose();
    e.H.bottomRightCorner<3, 3>() += CH0 * C0.transpose() + CH1 * C1.transpose();
  }

  static Pose moved(const Pose& X, const Vector6& step) noexcept {
    return {X.p_m + step.head<3>(), (from_rotation_vector(step.tail<3>()) * X.q).normalized()};
  }

  static double size_of(const Vector6& g) noexcept {
    // A moment counts as its force at 0.1 m.
    return std::max(g.head<3>().cwiseAbs().maxCoeff(), g.tail<3>().cwiseAbs().maxCoeff() / 0.1);
  }
  double allowed(const Evaluation& e) const noexcept {
    return o_.tolerance * std::max(1.0, e.coupling_N);
  }

  // One step of Newton's method that lowers the potential; false if none was found. Where the
  // tangent leads astray, beyond the limits of many elements, the majorising parabola's does not.
  bool step(Evaluation& e, CuttingResult& out) const noexcept {
    Evaluation next;
    constexpr double kLeastDecrease = 1e-4;
    constexpr int kMostHalvings = 10;
    for (const bool majorise : {false, true}) {
      if (majorise) evaluate(e.X, true, e, out);
      Inverse inverse;
      if (!inverse.of(e.H)) continue;
      const Vector6 towards = inverse.times(e.g);
      const double slope = -e.g.dot(towards);
      if (!(slope < 0)) continue;
      double share = 1;
      for (int k = 0; k < (majorise ? kMostHalvings : 2); ++k, share *= 0.25) {
        evaluate(moved(e.X, -share * towards), false, next, out);
        // Close to the minimum the potential cannot tell better from worse; the gradient can.
        if (next.V <= e.V + kLeastDecrease * share * slope ||
            (next.V <= e.V + kRounding_J && size_of(next.g) < size_of(e.g))) {
          e = next;
          return true;
        }
      }
    }
    return false;
  }

  void minimise(Evaluation& e, CuttingResult& out) const noexcept {
    while (true) {
      out.has_converged = size_of(e.g) <= allowed(e);
      if (out.has_converged || out.steps >= o_.most_steps) return;
      ++out.steps;
      if (!step(e, out)) {
        // As low as rounding lets it be.
        out.has_converged = size_of(e.g) <= 1e3 * allowed(e);
        return;
      }
    }
  }

  // How far the front moves until the tip's force, which falls from R by K_s a metre along the
  // shaft, is no more than the strength.
  Advance scan(double R, double K_s) const noexcept {
    Advance a;
    double at = front_;
    // Beside a boundary the slab below it counts.
    for (int i = slab_at(front_); i < slab_count(); ++i) {
      const CuttingSlab& slab = slabs_[static_cast<std::size_t>(i)];
      const double thickness = slab.bottom_m - slab.top_m;
      if (thickness > 0 && slab.bottom_m <= at) continue;
      const double cut = cut_of(i);
      if (cut >= slab.bottom_m) continue;
      const double slope_depth =
          thickness > 0 ? (slab.strength_bottom_N - slab.strength_top_N) / thickness : 0;
      // Above and below the depth to which other holes have taken a share.
      for (const bool shared : {true, false}) {
        const double top = shared ? slab.top_m : std::max(slab.top_m, slab.share_to_m);
        const double bottom = shared ? std::min(slab.bottom_m, slab.share_to_m) : slab.bottom_m;
        if (top > bottom || (thickness > 0 && bottom <= at)) continue;
        if (!shared && thickness <= 0) continue;  // a sheet is passed once
        const double share = shared ? slab.share : 1;
        const double from = std::max({top, cut, at});
        if (thickness > 0 && from >= bottom) continue;
        if (from > at) {  // nothing to cut up to there
          const double gap = (from - at) / down_;
          if (R - K_s * (a.length_m + gap) <= 0) return to_rest(a, R, K_s);
          a.length_m += gap;
          at = from;
        }
        const double Y = share * (slab.strength_top_N + slope_depth * (at - slab.top_m));
        const double slope = share * slope_depth * down_;
        const double excess = R - K_s * a.length_m - Y;
        if (excess <= 0) return a;
        const double length = (bottom - at) / down_;
        double dl = length;
        if (K_s + slope > 0) dl = std::min(excess / (K_s + slope), length);
        a.work_J += dl * (Y + 0.5 * slope * dl);
        a.strength_N = Y + slope * dl;
        a.length_m += dl;
        if (dl < length) return a;
        at = bottom;
      }
    }
    return to_rest(a, R, K_s);
  }
  static Advance to_rest(Advance a, double R, double K_s) noexcept {
    a.length_m = std::max(a.length_m, R / K_s);
    a.strength_N = 0;
    a.ends_free = true;
    return a;
  }

  void take(const Advance& a, CuttingResult& out) noexcept {
    out.cut_J += a.work_J;
    state_.stretch_m -= a.length_m;
    front_ += a.length_m * down_;
    is_free_ = a.ends_free;
  }

  // What a step of the front changes.
  struct Front {
    double stretch_m, front_m, cut_J;
    bool is_free;
  };
  Front front(const CuttingResult& out) const noexcept {
    return {state_.stretch_m, front_, out.cut_J, is_free_};
  }
  void take_back(const Front& was, CuttingResult& out) noexcept {
    state_.stretch_m = was.stretch_m;
    front_ = was.front_m;
    out.cut_J = was.cut_J;
    is_free_ = was.is_free;
  }

  // The linear model of one evaluation: how all but the front moves for a force along the shaft,
  // and how fast the tip's force falls as the front advances.
  struct Model {
    Vector6 along = Vector6::Zero();
    double K_s = 0;
  };
  Model model_of(const Evaluation& e, const Inverse& inverse) const noexcept {
    Model m{inverse.times(e.along), o_.tip_N_per_m};
    if (e.tip_N > 0)
      m.K_s = std::clamp(m.K_s * (1 - m.K_s * e.along.dot(m.along)), 1e-9 * m.K_s, m.K_s);
    return m;
  }

  // Newton's step `-towards`. Friction that is elastic, but would slide in that step, is taken as
  // sliding: it is so in most ticks in which the tool moves.
  bool newton(const Evaluation& e, Inverse& inverse, Vector6& towards) const noexcept {
    if (!inverse.of(e.H)) return false;
    towards = inverse.times(e.g);
    if (state_.friction_N_per_m <= 0) return true;
    const Vector2d w = state_.presliding_m + e.slide;
    const double length = w.norm();
    if (length > o_.presliding_m) return true;
    const Vector2d next = w - Vector2d(e.along.dot(towards), e.around.dot(towards.tail<3>()));
    const double next_length = next.norm();
    if (next_length <= o_.presliding_m) return true;
    const Vector2d unit = next / next_length;
    Vector6 j = unit[0] * e.along;
    j.tail<3>() += unit[1] * e.around;
    const Matrix6 H = e.H - state_.friction_N_per_m * j * j.transpose();
    Inverse sliding;
    if (!sliding.of(H)) return true;
    inverse = sliding;
    towards = sliding.times(e.g + (friction_N_ - state_.friction_N_per_m * w.dot(unit)) * j);
    return true;
  }

  void settle(Evaluation& e, CuttingResult& out) noexcept {
    if (!step_together(e, out)) step_in_turn(e, out);
  }

  // Steps of proxy and front together, by the force that the linear model predicts for the tip.
  // False where it does not hold; then e and the front are as before the front's last step.
  bool step_together(Evaluation& e, CuttingResult& out) noexcept {
    Evaluation before = e;
    Front was = front(out);
    double least_N = 0;  // of the tip, if the front's last step did not go too far
    while (true) {
      out.has_converged = size_of(e.g) <= allowed(e);
      if (out.has_converged && e.tip_N <= 0) return true;
      Inverse inverse;
      Vector6 towards;
      if (!newton(e, inverse, towards)) return false;
      const Model m = model_of(e, inverse);
      const double R = e.tip_N - o_.tip_N_per_m * e.along.dot(towards);
      if (least_N > 0 && R < least_N - std::max(allowed(e), 1e-9 * least_N)) {
        take_back(was, out);
        e = before;
        return false;
      }
      Advance a;
      if (e.tip_N > 0 && R > 0) a = scan(R, m.K_s);
      // Less than Newton's method leaves undetermined.
      if (m.K_s * a.length_m <= allowed(e)) {
        if (out.has_converged) return true;
        a = {};
      } else if (e.is_saturated) {
        return false;
      }
      if (out.steps >= o_.most_steps) {
        out.has_converged = false;
        return true;
      }
      ++out.steps;
      const double V = e.V;
      const Pose X = moved(e.X, o_.tip_N_per_m * a.length_m * m.along - towards);
      if (a.length_m > 0) {
        before = e;
        was = front(out);
        least_N = a.strength_N;
        take(a, out);
      }
      evaluate(X, false, e, out);
      if (!(e.V + a.work_J <= V + kRounding_J)) {
        take_back(was, out);
        e = before;
        return false;
      }
    }
  }

  // Newton's method at a fixed front, and steps of the front by the tip's force then.
  void step_in_turn(Evaluation& e, CuttingResult& out) noexcept {
    minimise(e, out);
    constexpr int kMostAdvances = 24;
    for (int k = 0; k < kMostAdvances && e.tip_N > 0; ++k) {
      // A coupling at its limit lets the front run at a force that does not fall, until it is not
      // at its limit any more: its secant falls short of that place, its tangent would miss it. The
      // same for a tool that is about to tilt over, whose tangent has no inverse.
      Inverse inverse;
      bool has_model = !e.is_saturated && inverse.of(e.H);
      if (!has_model) {
        evaluate(e.X, true, e, out);
        has_model = inverse.of(e.H);
      }
      Model m;
      m.K_s = o_.tip_N_per_m;
      if (has_model) m = model_of(e, inverse);
      Advance a = scan(e.tip_N, m.K_s);
      if (a.length_m <= 0) return;
      const Evaluation before = e;
      const Front was = front(out);
      constexpr int kMostTries = 3;
      for (int tries = 0;; ++tries) {
        if (tries == kMostTries || out.steps >= o_.most_steps || !has_model) {
          // With the proxy where it was the tip's force falls fastest: this is never too far.
          a = scan(before.tip_N, o_.tip_N_per_m);
          take(a, out);
          evaluate(before.X, false, e, out);
          minimise(e, out);
          break;
        }
        take(a, out);
        ++out.steps;
        evaluate(moved(before.X, o_.tip_N_per_m * a.length_m * m.along), false, e, out);
        minimise(e, out);
        const double slack = std::max(allowed(e), 1e-9 * before.tip_N);
        const bool too_far = a.strength_N > 0 && e.tip_N < a.strength_N - slack;
        if (!too_far && e.V + a.work_J <= before.V + kRounding_J) break;
        const double secant = (before.tip_N - e.tip_N) / a.length_m;
        take_back(was, out);
        a = scan(before.tip_N, std::clamp(secant, m.K_s, o_.tip_N_per_m));
        e = before;
      }
      if (m.K_s * a.length_m <= allowed(e))
        return;  // less than Newton's method leaves undetermined
      if (out.steps >= o_.most_steps) {
        out.has_converged =
            out.has_converged && scan(e.tip_N, m.K_s).length_m * m.K_s <= allowed(e);
        return;
      }
    }
  }

  void finish(const Evaluation& e, CuttingResult& out) noexcept {
    out.wrench_device = e.coupling;
    out.stored_J = e.V - e.friction_J - e.wall_J;
    // What has yielded stays so.
    if (state_.friction_N_per_m > 0) {
      state_.presliding_m += e.slide;
      const double length = state_.presliding_m.norm();
      if (length > o_.presliding_m) state_.presliding_m *= o_.presliding_m / length;
      out.stored_J += 0.5 * state_.friction_N_per_m * state_.presliding_m.squaredNorm();
    } else {
      state_.presliding_m.setZero();
    }
    const Vector3d tip = e.X * o_.tool.tip_plate_m, axis = e.X.q * o_.tool.inward_plate;
    out.stored_J += e.walls_yield ? yield_walls(tip, axis) : e.wall_J;
    out.tip_N = is_free_ ? 0 : e.tip_N;
    state_.stretch_m += e.slide[0];
    // What rounding leaves of a tip in no material.
    if (is_free_) state_.stretch_m = std::min(state_.stretch_m, 0.0);
    state_.T_device_proxy = e.X;
    out.front_m = front_;
    out.embedded_m = embedded_;
    if (front_ > first_front_) record_cut(tip, axis, out);
    if (o_.coupling.is_rigid) {
      // The derivative of what is stored now, with the shaft as it is now.
      start_at(e.X);
      Evaluation now;
      evaluate(e.X, false, now, out);
      out.wrench_device = -now.g;
    }
  }

  double yield_walls(const Vector3d& tip, const Vector3d& axis) noexcept {
    double stored = 0;
    CuttingHole& hole = state_.holes[static_cast<std::size_t>(state_.hole)];
    for (int i = state_.embedded_from; i < state_.embedded_to; ++i) {
      CuttingHoleSlab& s = hole.slabs[static_cast<std::size_t>(i)];
      if (s.wall_N_per_m <= 0) continue;
      const double kept = s.wall_most_N / s.wall_N_per_m;
      for (std::size_t g = 0; g < 2; ++g) {
        const Vector2d at = crossing(tip, axis, s.depth_m[g]);
        Slot::Reach r = s.walls[g].reach(at);
        if (r.distance_m > kept) {
          s.walls[g].include(at - kept * r.away);
          r.distance_m = kept;
        }
        stored += 0.5 * s.wall_N_per_m * r.distance_m * r.distance_m;
      }
    }
    return stored;
  }

  // What lies above the front is cut, in the hole that the tool is in or now begins.
  void record_cut(const Vector3d& tip, const Vector3d& axis, CuttingResult& out) noexcept {
    for (int i = slab_at(first_front_); i < slab_count(); ++i) {
      const CuttingSlab& slab = slabs_[static_cast<std::size_t>(i)];
      if (slab.top_m >= front_) break;
      if (state_.hole < 0) enter(i);
      if (state_.hole < 0) return;
      CuttingHoleSlab& s =
          state_.holes[static_cast<std::size_t>(state_.hole)].slabs[static_cast<std::size_t>(i)];
      if (s.embedded_m <= 0 && !is_near(s, static_cast<std::size_t>(i))) {
        s.cut_m = -kInfinity;
        for (std::size_t g = 0; g < 2; ++g)
          s.walls[g].open(crossing(tip, axis, gauss_depth(slab, g)), slab.clearance_m);
      }
      const double passed = slab.bottom_m - 1e-9;  // by rounding the front may stop just above
      const bool was_passed = s.cut_m >= passed;
      s.cut_m = std::max(s.cut_m, std::min(front_, slab.bottom_m));
      if (!was_passed && s.cut_m >= passed) {
        if (out.passed_from == out.passed_to) out.passed_from = i;
        out.passed_to = i + 1;
      }
    }
  }

  const CuttingOptions& o_;
  const Pose& plate_;
  std::span<const CuttingSlab> slabs_;
  CuttingState& state_;
  Pose start_;
  Eigen::Quaterniond back_;
  Vector3d axis_, tip_;
  int hole_ = -1;
  bool is_free_ = false;
  double down_ = 1, front_ = 0, first_front_ = 0, embedded_ = 0, friction_N_ = 0;
};

}  // namespace

CuttingState make_cutting_state(std::size_t slabs, std::size_t holes) {
  CuttingState state;
  state.holes.resize(holes);
  for (CuttingHole& hole : state.holes)
    hole.slabs.resize(slabs);
  return state;
}

void cutting_tick(const CuttingOptions& options, const Pose& T_device_plate,
                  std::span<const CuttingSlab> slabs, CuttingState& state,
                  CuttingResult& result) noexcept {
  result = {};
  if (!state.has_begun) {
    state.has_begun = true;
    state.T_device_proxy = T_device_plate;
  }
  Tick(options, T_device_plate, slabs, state).run(result);
}

}  // namespace trocar::runtime
