// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/torque_allocation.h"

#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;
using NullSpace = Eigen::Matrix<double, kMotors, 2>;  // orthonormal columns: G^T N = 0

// Rotation's columns are scaled to metres before factoring; the answer does not
// depend on it, the rounding does.
constexpr double kPlateLength_m = 0.05;
constexpr double kSmallestRank = 1e-9;  // of R's diagonal, relative: G counts as rank deficient

double cross(const Vector2d& a, const Vector2d& b) noexcept {
  return a.x() * b.y() - a.y() * b.x();
}

// min over z of max_i |tau_i + n_i . z| / limit_i, the least load to which the
// null space can bring the most loaded motor. A minimax over two unknowns is
// settled by three of its terms; for three rows the one combination that
// eliminates z, lambda = (n_j x n_k, n_k x n_i, n_i x n_j), bounds the load from
// below by |lambda . tau| / |lambda| . limit with equality at their own optimum
// (de la Vallee-Poussin; also this linear programme's dual vertices). Exact.
double least_load(const MotorVector& tau, const NullSpace& N, const MotorVector& limit) noexcept {
  double load = 0;
  for (int i = 0; i < kMotors; ++i) {
    for (int j = i + 1; j < kMotors; ++j) {
      const double lambda_k = cross(N.row(i).transpose(), N.row(j).transpose());
      for (int k = j + 1; k < kMotors; ++k) {
        const double lambda_i = cross(N.row(j).transpose(), N.row(k).transpose());
        const double lambda_j = cross(N.row(k).transpose(), N.row(i).transpose());
        const double weight = std::abs(lambda_i) * limit[i] + std::abs(lambda_j) * limit[j] +
                              std::abs(lambda_k) * limit[k];
        const double demand = std::abs(lambda_i * tau[i] + lambda_j * tau[j] + lambda_k * tau[k]);
        // Three nearly parallel rows say nothing that other triples do not.
        if (weight > 1e-14 * (limit[i] + limit[j] + limit[k]))
          load = std::max(load, demand / weight);
      }
    }
  }
  return load;
}

// A convex polygon of null-space coordinates. Each half plane adds at most one vertex.
struct Polygon {
  std::array<Vector2d, 4 + 2 * kMotors> vertex;
  int size = 0;
};

// Keeps what satisfies n . y <= bound (Sutherland and Hodgman, one edge).
void clip(Polygon& polygon, const Vector2d& n, double bound) noexcept {
  Polygon kept;
  for (int i = 0; i < polygon.size; ++i) {
    const Vector2d& a = polygon.vertex[i];
    const Vector2d& b = polygon.vertex[i + 1 < polygon.size ? i + 1 : 0];
    const double over_a = n.dot(a) - bound, over_b = n.dot(b) - bound;
    const auto push = [&kept](const Vector2d& y) {
      if (kept.size < static_cast<int>(kept.vertex.size())) kept.vertex[kept.size++] = y;
    };
    if (over_a <= 0) push(a);
    if ((over_a < 0 && over_b > 0) || (over_a > 0 && over_b < 0)) {
      push(a + (over_a / (over_a - over_b)) * (b - a));
    }
  }
  polygon = kept;
}

// The point of a non-empty convex counter-clockwise polygon nearest to the origin.
Vector2d nearest_to_origin(const Polygon& polygon) noexcept {
  bool origin_inside = polygon.size > 2;
  Vector2d nearest = polygon.vertex[0];
  for (int i = 0; i < polygon.size; ++i) {
    const Vector2d& a = polygon.vertex[i];
    const Vector2d& b = polygon.vertex[i + 1 < polygon.size ? i + 1 : 0];
    const Vector2d edge = b - a;
    if (cross(edge, -a) < 0) origin_inside = false;
    const double length2 = edge.squaredNorm();
    const double along = length2 > 0 ? std::clamp(-a.dot(edge) / length2, 0.0, 1.0) : 0;
    const Vector2d candidate = a + along * edge;
    if (candidate.squaredNorm() < nearest.squaredNorm()) nearest = candidate;
  }
  return origin_inside ? Vector2d::Zero() : nearest;
}

// Null-space coordinates of least norm that bring tau + N y within the limits.
bool within_limits(const MotorVector& tau, const NullSpace& N, const MotorVector& limit,
                   Vector2d& y) noexcept {
  // |y| = |N y| <= |tau + N y| + |tau|: this square holds every feasible point.
  const double reach = 2 * (limit.norm() + tau.norm());
  Polygon polygon;
  polygon.size = 4;
  polygon.vertex[0] = {-reach, -reach};
  polygon.vertex[1] = {reach, -reach};
  polygon.vertex[2] = {reach, reach};
  polygon.vertex[3] = {-reach, reach};
  for (int i = 0; i < kMotors && polygon.size > 0; ++i) {
    const Vector2d n = N.row(i).transpose();
    clip(polygon, n, limit[i] - tau[i]);
    clip(polygon, -n, limit[i] + tau[i]);
  }
  if (polygon.size == 0) return false;
  y = nearest_to_origin(polygon);
  return true;
}

}  // namespace

AllocationResult allocate_torques(const Jacobian& G, const Wrench& wrench_device,
                                  const MotorVector& limit_Nm) noexcept {
  AllocationResult result;
  if (!G.allFinite() || !wrench_device.allFinite() || !limit_Nm.allFinite() ||
      !(limit_Nm.minCoeff() > 0)) {
    return result;
  }

  // G S = Q [R; 0] gives both parts of Eq. 18: the pseudo-inverse solution
  // Q1 R^-T S w and, in Q's last two columns, the null space.
  Jacobian scaled = G;
  scaled.rightCols<3>() /= kPlateLength_m;
  Wrench wanted = wrench_device;
  wanted.tail<3>() /= kPlateLength_m;
  const Eigen::HouseholderQR<Jacobian> qr(scaled);
  const auto diagonal = qr.matrixQR().diagonal().cwiseAbs();
  if (!(diagonal.minCoeff() > kSmallestRank * diagonal.maxCoeff())) return result;
  const Eigen::Matrix<double, kMotors, kMotors> Q = qr.householderQ();
  const Eigen::Matrix<double, 6, 6> R = qr.matrixQR().topRows<6>();
  const Wrench in_Q = R.triangularView<Eigen::Upper>().transpose().solve(wanted);
  const MotorVector minimum_norm = Q.leftCols<6>() * in_Q;
  if (!minimum_norm.allFinite()) return result;

  MotorVector& tau = result.tau_motor_Nm;
  if ((minimum_norm.array().abs() <= limit_Nm.array()).all()) {
    result.kind = Allocation::kMinimumNorm;
    result.scale = 1;
    tau = minimum_norm;
  } else {
    const NullSpace N = Q.rightCols<2>();
    const double load = least_load(minimum_norm, N, limit_Nm);
    const bool feasible = load <= 1 - kScaleMargin;
    result.kind = feasible ? Allocation::kNullSpace : Allocation::kScaled;
    result.scale = feasible ? 1 : (1 - kScaleMargin) / load;
    tau = result.scale * minimum_norm;
    Vector2d y;
    if (within_limits(tau, N, limit_Nm, y)) {
      tau += N * y;
    } else {
      // Rounding emptied the polygon (kScaleMargin is there against it): the
      // minimum-norm torques scaled down alone are always feasible.
      result.kind = Allocation::kScaled;
      result.scale = 1 / (minimum_norm.array().abs() / limit_Nm.array()).maxCoeff();
      tau = result.scale * minimum_norm;
    }
    // Active limits are met up to rounding; law 1 holds exactly.
    tau = tau.cwiseMin(limit_Nm).cwiseMax(-limit_Nm);
  }
  result.wrench_device = G.transpose() * tau;
  return result;
}

AllocationResult allocate_torques(const Jacobian& G, const Wrench& wrench_device,
                                  double limit_Nm) noexcept {
  return allocate_torques(G, wrench_device, MotorVector::Constant(limit_Nm).eval());
}

}  // namespace trocar::runtime
