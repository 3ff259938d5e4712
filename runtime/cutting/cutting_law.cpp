// SPDX-License-Identifier: Apache-2.0
#include "runtime/cutting/cutting_law.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace trocar::runtime {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix32 = Eigen::Matrix<double, 3, 2>;

// Depths of the two Gauss points in a slab, as shares of its thickness.
constexpr std::array<double, 2> kGauss{0.21132486540518713, 0.78867513459481287};

// Energy, force and second derivative of a spring that yields at a force.
struct Huber {
  double energy = 0, force = 0, along = 0, across = 0;
};
Huber huber(double stiffness, double most, double length) noexcept {
  if (stiffness * length <= most)
    return {0.5 * stiffness * length * length, stiffness * length, stiffness, stiffness};
  return {most * length - 0.5 * most * most / stiffness, most, 0, most / length};
}

// Where the shaft meets the plane of a depth.
struct Crossing {
  Vector2d at_m;
  double along_m = 0;  // from the tip, along the inward axis
};

class Tick {
 public:
  Tick(const CuttingOptions& options, const Pose& plate, std::span<CuttingSlab> slabs,
       CuttingState& state) noexcept
      : o_(options), plate_(plate), slabs_(slabs), state_(state), start_(state.T_device_proxy) {
    axis_ = start_.q * o_.tool.inward_plate;
    tip_ = start_ * o_.tool.tip_plate_m;
    down_ = -axis_.z();
  }

  void run(CuttingResult& out) noexcept {
    find_front();
    embed();
    Pose X = start_;
    if (o_.coupling.is_rigid) {
      X = plate_;
      const double s = shift(X);
      const double dl = advance(o_.tip_N_per_m * (state_.stretch_m + s), o_.tip_N_per_m, out.cut_J);
      state_.stretch_m -= dl;
      front_ += dl * down_;
    } else {
      settle(X, out);
    }
    finish(X, out);
  }

 private:
  // The front: carried while it is loaded, else the next material below the tip.
  void find_front() noexcept {
    const double tip_m = -tip_.z();
    if (state_.stretch_m > 0) {
      front_ = tip_m - state_.stretch_m * down_;
      return;
    }
    front_ = std::numeric_limits<double>::infinity();
    for (const CuttingSlab& slab : slabs_) {
      const double from = std::max(slab.top_m, slab.cut_m);
      if (slab.cut_m >= slab.bottom_m || slab.bottom_m < tip_m ||
          std::max(slab.strength_top_N, slab.strength_bottom_N) <= 0)
        continue;
      front_ = std::max(from, tip_m);
      break;
    }
    state_.stretch_m = std::min((tip_m - front_) / down_, 0.0);
  }

  // Embedded lengths, and with them the stiffness of friction and walls. What grows keeps its force,
  // so that its energy falls; what is new is free of force.
  void embed() noexcept {
    const double low = std::min(front_, -tip_.z());
    for (std::size_t i = 0; i < slabs_.size(); ++i) {
      const CuttingSlab& slab = slabs_[i];
      CuttingHole& hole = state_.holes[i];
      const double before = hole.embedded_m;
      hole.embedded_m =
          std::clamp(low - slab.top_m, 0.0, slab.bottom_m - slab.top_m) / down_;
      embedded_ += hole.embedded_m;
      if (hole.embedded_m <= 0) {
        hole.friction_N_per_m = hole.wall_N_per_m = 0;
        continue;
      }
      const double friction =
          slab.friction_N_per_m * hole.embedded_m / std::max(o_.presliding_m, 1e-9);
      if (friction > hole.friction_N_per_m)
        hole.presliding_m *= hole.friction_N_per_m / friction;
      hole.friction_N_per_m = friction;
      const double stretched = hole.presliding_m.norm();
      if (stretched > o_.presliding_m) hole.presliding_m *= o_.presliding_m / stretched;

      const double wall = 0.5 * slab.wall_N_per_m2 * hole.embedded_m;
      for (std::size_t g = 0; g < 2; ++g) {
        const Vector2d at = crossing(start_, i, g).at_m;
        Slot& slot = hole.walls[g];
        if (!slot.is_open()) {
          slot.open(at, slab.clearance_m);
        } else if (before <= 0) {
          slot.include(at);
        } else if (wall > hole.wall_N_per_m) {
          const Slot::Reach r = slot.reach(at);
          slot.include(at - r.away * (r.distance_m * hole.wall_N_per_m / wall));
        }
      }
      hole.wall_N_per_m = wall;
    }
  }

  Crossing crossing(const Pose& X, std::size_t slab, std::size_t gauss) const noexcept {
    return crossing(X * o_.tool.tip_plate_m, X.q * o_.tool.inward_plate, slab, gauss);
  }
  Crossing crossing(const Vector3d& tip, const Vector3d& axis, std::size_t slab,
                    std::size_t gauss) const noexcept {
    const CuttingSlab& s = slabs_[slab];
    const double depth = s.top_m + kGauss[gauss] * (s.bottom_m - s.top_m);
    const double along = (-depth - tip.z()) / axis.z();
    return {(tip + along * axis).head<2>(), along};
  }

  double shift(const Pose& X) const noexcept { return axis_.dot(X * o_.tool.tip_plate_m - tip_); }

  // Along and around the shaft since the tick's start.
  Vector2d slide(const Pose& X) const noexcept {
    return {shift(X), o_.tool.radius_m * axis_.dot(rotation_vector(X.q * start_.q.conjugate()))};
  }

  struct Derivatives {
    Vector6 g = Vector6::Zero();
    Matrix6 H = Matrix6::Zero();  // without the tip
    Vector6 along = Vector6::Zero();
    double coupling_N = 0;
  };

  double coupling_energy(const Pose& X, Derivatives* d) const noexcept {
    if (o_.coupling.is_rigid) return 0;
    const Vector3d e = plate_.p_m - X.p_m, r = rotation_vector(plate_.q * X.q.conjugate());
    const double le = e.norm(), lr = r.norm();
    const Huber t = huber(o_.coupling.translation_N_per_m, o_.coupling.most_force_N, le);
    const Huber m = huber(o_.coupling.rotation_Nm_per_rad, o_.coupling.most_moment_Nm, lr);
    if (d != nullptr) {
      const auto add = [d](int at, const Vector3d& v, double length, const Huber& h, double k) {
        const Vector3d unit = length > 0 ? Vector3d(v / length) : Vector3d::Zero();
        d->g.segment<3>(at) -= h.force * unit;
        // A little of the stiffness stays where the force is constant, so that H has an inverse.
        d->H.block<3, 3>(at, at) += std::max(h.across, 1e-6 * k) * Eigen::Matrix3d::Identity() +
                                    (h.along - h.across) * unit * unit.transpose();
        if (h.along == 0) d->H.block<3, 3>(at, at) += 1e-6 * k * unit * unit.transpose();
      };
      add(0, e, le, t, o_.coupling.translation_N_per_m);
      add(3, r, lr, m, o_.coupling.rotation_Nm_per_rad);
      d->coupling_N = t.force;
    }
    return t.energy + m.energy;
  }

  double friction_energy(const Pose& X, Derivatives* d) const noexcept {
    const Vector2d moved = slide(X);
    double energy = 0;
    Vector2d g = Vector2d::Zero();
    Matrix2d H = Matrix2d::Zero();
    for (std::size_t i = 0; i < slabs_.size(); ++i) {
      const CuttingHole& hole = state_.holes[i];
      if (hole.friction_N_per_m <= 0) continue;
      const Vector2d w = hole.presliding_m + moved;
      const double length = w.norm();
      const Huber h =
          huber(hole.friction_N_per_m, hole.friction_N_per_m * o_.presliding_m, length);
      energy += h.energy;
      if (d == nullptr || length <= 0) {
        if (d != nullptr) H += h.across * Matrix2d::Identity();
        continue;
      }
      const Vector2d unit = w / length;
      g += h.force * unit;
      H += h.across * Matrix2d::Identity() + (h.along - h.across) * unit * unit.transpose();
    }
    if (d != nullptr) {
      Eigen::Matrix<double, 6, 2> J = Eigen::Matrix<double, 6, 2>::Zero();
      J.col(0) = d->along;
      J.col(1).tail<3>() = o_.tool.radius_m * axis_;
      d->g += J * g;
      d->H += J * H * J.transpose();
    }
    return energy;
  }

  // The walls' derivatives are sums over the Gauss points of polynomials in the distance from the
  // tip: a crossing moves by N' (u + turn x (lever + along * axis)).
  double wall_energy(const Pose& X, Derivatives* d) const noexcept {
    const Vector3d tip = X * o_.tool.tip_plate_m, axis = X.q * o_.tool.inward_plate;
    double energy = 0;
    Vector2d g0 = Vector2d::Zero(), g1 = g0;
    Matrix2d H0 = Matrix2d::Zero(), H1 = H0, H2 = H0;
    for (std::size_t i = 0; i < slabs_.size(); ++i) {
      const CuttingHole& hole = state_.holes[i];
      if (hole.wall_N_per_m <= 0) continue;
      const double most = 0.5 * slabs_[i].wall_strength_N_per_m * hole.embedded_m;
      for (std::size_t k = 0; k < 2; ++k) {
        const Crossing c = crossing(tip, axis, i, k);
        const Slot::Reach r = hole.walls[k].reach(c.at_m);
        if (r.distance_m <= 0) {
          // On the brink: the wall's stiffness helps the next step.
          continue;
        }
        const Huber h = huber(hole.wall_N_per_m, most, r.distance_m);
        energy += h.energy;
        if (d == nullptr) continue;
        const Vector2d g = h.force * r.away;
        const double across = h.across * r.bend;
        const Matrix2d H = across * Matrix2d::Identity() +
                           (h.along - across) * r.away * r.away.transpose();
        g0 += g;
        g1 += c.along_m * g;
        H0 += H;
        H1 += c.along_m * H;
        H2 += c.along_m * c.along_m * H;
      }
    }
    if (d != nullptr && energy > 0) {
      const Vector3d lever = tip - X.p_m;
      Matrix32 N = Matrix32::Zero();
      N(0, 0) = N(1, 1) = 1;
      N(2, 0) = -axis.x() / axis.z();
      N(2, 1) = -axis.y() / axis.z();
      Matrix32 C0, C1;
      for (int c = 0; c < 2; ++c) {
        const Vector3d n = N.col(c);
        C0.col(c) = lever.cross(n);
        C1.col(c) = axis.cross(n);
      }
      d->g.head<3>() += N * g0;
      d->g.tail<3>() += C0 * g0 + C1 * g1;
      const Matrix32 NH0 = N * H0, NH1 = N * H1;
      d->H.topLeftCorner<3, 3>() += NH0 * N.transpose();
      const Eigen::Matrix3d mixed = NH0 * C0.transpose() + NH1 * C1.transpose();
      d->H.topRightCorner<3, 3>() += mixed;
      d->H.bottomLeftCorner<3, 3>() += mixed.transpose();
      d->H.bottomRightCorner<3, 3>() += C0 * H0 * C0.transpose() + C0 * H1 * C1.transpose() +
                                        C1 * H1 * C0.transpose() + C1 * H2 * C1.transpose();
    }
    return energy;
  }

  double tip_energy(const Pose& X) const noexcept {
    const double d = state_.stretch_m + shift(X);
    return d > 0 ? 0.5 * o_.tip_N_per_m * d * d : 0;
  }

  double potential(const Pose& X, Derivatives* d) const noexcept {
    if (d != nullptr) {
      *d = {};
      d->along.head<3>() = axis_;
      d->along.tail<3>() = (X * o_.tool.tip_plate_m - X.p_m).cross(axis_);
    }
    double V = coupling_energy(X, d) + friction_energy(X, d) + wall_energy(X, d) + tip_energy(X);
    if (d != nullptr) d->g += d->along * tip_force(X);
    return V;
  }

  double tip_force(const Pose& X) const noexcept {
    return o_.tip_N_per_m * std::max(state_.stretch_m + shift(X), 0.0);
  }

  static Pose moved(const Pose& X, const Vector6& step) noexcept {
    return {X.p_m + step.head<3>(),
            (from_rotation_vector(step.tail<3>()) * X.q).normalized()};
  }

  static double size_of(const Vector6& g) noexcept {
    // A moment counts as its force at 0.1 m.
    return std::max(g.head<3>().cwiseAbs().maxCoeff(), g.tail<3>().cwiseAbs().maxCoeff() / 0.1);
  }

  double allowed(const Derivatives& d) const noexcept {
    return o_.tolerance * std::max(1.0, d.coupling_N);
  }

  // Newton's method with a line search at a fixed front. Returns the potential at its end.
  double minimise(Pose& X, Derivatives& d, CuttingResult& out) const noexcept {
    double V = potential(X, &d);
    out.has_converged = false;
    while (true) {
      if (size_of(d.g) <= allowed(d)) {
        out.has_converged = true;
        return V;
      }
      if (out.steps >= o_.most_steps) return V;
      ++out.steps;
      Matrix6 H = d.H;
      if (tip_force(X) > 0) H += o_.tip_N_per_m * d.along * d.along.transpose();
      const Vector6 step = -H.ldlt().solve(d.g);
      const double slope = d.g.dot(step);
      if (!(slope < 0)) return V;
      constexpr int kMostHalvings = 12;
      constexpr double kLeastDecrease = 1e-4;
      double share = 1;
      bool better = false;
      const double before = V;
      for (int k = 0; k < kMostHalvings && !better; ++k, share *= 0.5) {
        const Pose at = moved(X, share * step);
        Derivatives there;
        V = potential(at, &there);
        better = V <= before + kLeastDecrease * share * slope;
        if (better) X = at, d = there;
      }
      if (!better) {
        out.has_converged = size_of(d.g) <= 1e3 * allowed(d);
        return before;
      }
    }
  }

  // How far along the shaft the front moves if the tip's force falls from R by K_s a metre, and the
  // work of it. Lowers cut_m of the slabs passed.
  double advance(double R, double K_s, double& work_J) noexcept {
    double x = 0;
    for (CuttingSlab& slab : slabs_) {
      const double at = front_ + x * down_;
      const double from = std::max(slab.top_m, slab.cut_m);
      if (slab.cut_m >= slab.bottom_m || slab.bottom_m < at ||
          (slab.top_m < slab.bottom_m && slab.bottom_m <= at))
        continue;
      if (from > at) {
        // Nothing to cut up to there.
        const double gap = (from - at) / down_;
        if (R - K_s * (x + gap) <= 0) return std::max(x, std::min(x + gap, R / K_s));
        x += gap;
      }
      const double begin = std::max(from, at), thickness = slab.bottom_m - slab.top_m;
      const double slope_depth =
          thickness > 0 ? (slab.strength_bottom_N - slab.strength_top_N) / thickness : 0;
      const double Y = slab.strength_top_N + slope_depth * (begin - slab.top_m);
      const double slope = slope_depth * down_;
      const double excess = R - K_s * x - Y;
      if (excess <= 0) return x;
      const double length = (slab.bottom_m - begin) / down_;
      double dl = length;
      if (K_s + slope > 0) dl = std::min(excess / (K_s + slope), length);
      work_J += dl * (Y + 0.5 * slope * dl);
      x += dl;
      const bool through = dl >= length;
      slab.cut_m = through ? slab.bottom_m : begin + dl * down_;
      if (!through) return x;
    }
    return std::max(x, R / K_s);
  }

  void settle(Pose& X, CuttingResult& out) noexcept {
    Derivatives d;
    minimise(X, d, out);
    constexpr int kMostAdvances = 24;
    for (int k = 0; k < kMostAdvances; ++k) {
      const double R = tip_force(X);
      if (R <= 0) return;
      const double soft = d.along.dot(Vector6(d.H.ldlt().solve(d.along)));
      const double K_s = 1 / (1 / o_.tip_N_per_m + std::max(soft, 0.0));
      const double dl = advance(R, K_s, out.cut_J);
      if (dl <= 0) return;
      state_.stretch_m -= dl;
      front_ += dl * down_;
      if (K_s * dl <= allowed(d)) return;  // less than Newton's method leaves undetermined
      minimise(X, d, out);
      if (out.steps >= o_.most_steps) return;
    }
  }

  void finish(const Pose& X, CuttingResult& out) noexcept {
    Derivatives d;
    potential(X, &d);
    const double coupling = coupling_energy(X, nullptr);
    if (o_.coupling.is_rigid) {
      out.wrench_device = -d.g;
    } else {
      Derivatives only;
      coupling_energy(X, &only);
      out.wrench_device = only.g;
    }
    // What has yielded stays so.
    const Vector2d slid = slide(X);
    double stored = coupling;
    for (std::size_t i = 0; i < slabs_.size(); ++i) {
      CuttingHole& hole = state_.holes[i];
      if (hole.friction_N_per_m > 0) {
        hole.presliding_m += slid;
        const double length = hole.presliding_m.norm();
        if (length > o_.presliding_m) hole.presliding_m *= o_.presliding_m / length;
        stored += 0.5 * hole.friction_N_per_m * hole.presliding_m.squaredNorm();
      }
      if (hole.wall_N_per_m <= 0) continue;
      const double most = 0.5 * slabs_[i].wall_strength_N_per_m * hole.embedded_m;
      for (std::size_t k = 0; k < 2; ++k) {
        const Vector2d at = crossing(X, i, k).at_m;
        Slot::Reach r = hole.walls[k].reach(at);
        const double kept = most / hole.wall_N_per_m;
        if (r.distance_m > kept) {
          hole.walls[k].include(at - kept * r.away);
          r.distance_m = kept;
        }
        stored += 0.5 * hole.wall_N_per_m * r.distance_m * r.distance_m;
      }
    }
    out.tip_N = tip_force(X);
    stored += tip_energy(X);
    out.stored_J = stored;
    state_.stretch_m += shift(X);
    state_.T_device_proxy = X;
    out.front_m = front_;
    out.embedded_m = embedded_;
  }

  const CuttingOptions& o_;
  const Pose& plate_;
  std::span<CuttingSlab> slabs_;
  CuttingState& state_;
  const Pose start_;
  Vector3d axis_, tip_;
  double down_ = 1, front_ = 0, embedded_ = 0;
};

}  // namespace

void cutting_tick(const CuttingOptions& options, const Pose& T_device_plate,
                  std::span<CuttingSlab> slabs, CuttingState& state,
                  CuttingResult& result) noexcept {
  result = {};
  if (!state.has_begun) {
    state.has_begun = true;
    state.T_device_proxy = T_device_plate;
  }
  Tick(options, T_device_plate, slabs, state).run(result);
}

}  // namespace trocar::runtime
