// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/four_legs/torque_allocation.h"

#include <Eigen/QR>

namespace trocar::runtime {
namespace {

using Eigen::Vector2d;
using NullSpace = Eigen::Matrix<double, kMotors, 2>;  // orthonormal columns: G^T N = 0

constexpr double kParallel = 1e-8;
constexpr int kMaxSteps = 50;
constexpr int kMaxHalvings = 30;
constexpr double kMinRank = 1e-9;  // G lacks rank if R's diagonal is relatively smaller

double cross(const Vector2d& a, const Vector2d& b) noexcept {
  return a.x() * b.y() - a.y() * b.x();
}

// Returns min over z of max_i |tau_i + n_i . z| / limit_i, the smallest load of the most loaded
// motor that the null space allows. In a minimax over two unknowns, three terms determine the
// optimum. For three rows i, j, k, the combination lambda = (n_j x n_k, n_k x n_i, n_i x n_j)
// eliminates z. It bounds the load from below by |lambda . tau| / (|lambda| . limit), with equality
// at the optimum of these three rows (de la Vallee-Poussin; these are the dual vertices of this
// linear programme). The result is exact.
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
        // Three nearly parallel rows give an ill-conditioned bound. Other triples give
        // a better bound.
        if (weight > kParallel * (limit[i] + limit[j] + limit[k]))
          load = std::max(load, demand / weight);
      }
    }
  }
  return load;
}

// The minimisation of law 5 in null-space coordinates y: tau = c + N y, and the cost is |y|^2 +
// penalty. The cost is a convex, piecewise quadratic function of two unknowns.
struct Penalty {
  const MotorVector& c;
  const NullSpace& N;
  const MotorVector& working;
  const MotorVector& stiffness;

  // Returns the signed excess of every torque over its working limit.
  MotorVector excess(const Vector2d& y) const noexcept {
    const MotorVector tau = c + N * y;
    return tau - tau.cwiseMin(working).cwiseMax(-working);
  }
  double cost(const Vector2d& y, const MotorVector& excess_Nm) const noexcept {
    return y.squaredNorm() + stiffness.dot(excess_Nm.cwiseAbs2());
  }
  // Returns Newton's step from y, which is exact if no torque crosses its working limit on the way:
  // -H^-1 slope with H = 1 + sum s n n^T and slope = y + sum s e n. Penalties are up to (|limit| /
  // (reserve limit_min))^2 times as stiff as the rest. Therefore determinant and numerator are
  // expanded into terms that do not cancel:
  //   det H = 1 + sum s |n|^2 + sum over pairs s_i s_j (n_i x n_j)^2,
  //   adj H slope = slope + sum over i of s_i p_i (p_i . y + sum over j of s_j e_j p_i . n_j),
  // with p_i = n_i rotated by a right angle, so that p_i . n_i is exactly 0.
  Vector2d step(const Vector2d& y, const MotorVector& excess_Nm) const noexcept {
    double determinant = 1;
    Vector2d numerator = y;
    for (int i = 0; i < kMotors; ++i) {
      if (excess_Nm[i] == 0) continue;
      const Vector2d n = N.row(i).transpose();
      const Vector2d across(-n.y(), n.x());
      double along = across.dot(y), spread = 0;
      for (int j = 0; j < kMotors; ++j) {
        if (j == i || excess_Nm[j] == 0) continue;
        const double sine = cross(n, N.row(j).transpose());
        along += stiffness[j] * excess_Nm[j] * sine;
        spread += stiffness[j] * sine * sine;
      }
      determinant += stiffness[i] * (n.squaredNorm() + spread / 2);
      numerator += stiffness[i] * (excess_Nm[i] * n + along * across);
    }
    return -numerator / determinant;
  }
};

bool same_signs(const MotorVector& a, const MotorVector& b) noexcept {
  return ((a.array() > 0) == (b.array() > 0)).all() && ((a.array() < 0) == (b.array() < 0)).all();
}

// Finds the minimum by Newton's method. A full step within one quadratic region reaches
// the minimum. A step that would not lower the cost is halved. Random trials took at most
// a dozen steps.
Vector2d least_cost(const Penalty& penalty) noexcept {
  Vector2d y = Vector2d::Zero();
  MotorVector excess = penalty.excess(y);
  double cost = penalty.cost(y, excess);
  for (int iteration = 0; iteration < kMaxSteps; ++iteration) {
    Vector2d step = penalty.step(y, excess);
    MotorVector next = penalty.excess(y + step);
    if (same_signs(next, excess)) return y + step;
    double next_cost = penalty.cost(y + step, next);
    for (int halvings = 0; !(next_cost < cost) && halvings < kMaxHalvings; ++halvings) {
      step /= 2;
      next = penalty.excess(y + step);
      next_cost = penalty.cost(y + step, next);
    }
    if (!(next_cost < cost)) return y;  // a torque is at its working limit, up to rounding
    y += step;
    excess = next;
    cost = next_cost;
  }
  return y;
}

}  // namespace

AllocationResult allocate_torques(const Jacobian& G, const Wrench& wrench_device,
                                  const MotorVector& limit_Nm) noexcept {
  AllocationResult result;
  if (!G.allFinite() || !wrench_device.allFinite() || !limit_Nm.allFinite() ||
      !(limit_Nm.minCoeff() > 0)) {
    return result;
  }

  // S scales the columns of rotation to metres, which affects only the rounding, not the result. G
  // S = Q [R; 0] gives both parts of Eq. 18: the pseudo-inverse solution Q1 R^-T S w and, in Q's
  // last two columns, the null space.
  Jacobian scaled = G;
  scaled.rightCols<3>() /= kCharacteristicLength_m;
  Wrench wanted = wrench_device;
  wanted.tail<3>() /= kCharacteristicLength_m;
  const Eigen::HouseholderQR<Jacobian> qr(scaled);
  const auto diagonal = qr.matrixQR().diagonal().cwiseAbs();
  if (!(diagonal.minCoeff() > kMinRank * diagonal.maxCoeff())) return result;
  const Eigen::Matrix<double, kMotors, kMotors> Q = qr.householderQ();
  const Eigen::Matrix<double, 6, 6> R = qr.matrixQR().topRows<6>();
  const Wrench in_Q = R.triangularView<Eigen::Upper>().transpose().solve(wanted);
  const MotorVector minimum_norm = Q.leftCols<6>() * in_Q;
  if (!minimum_norm.allFinite()) return result;

  const MotorVector working = (1 - kTorqueReserve) * limit_Nm;
  MotorVector& tau = result.tau_motor_Nm;
  result.scale = 1;
  if ((minimum_norm.array().abs() <= working.array()).all()) {
    result.kind = AllocationKind::kMinimumNorm;
    tau = minimum_norm;
  } else {
    const NullSpace N = Q.rightCols<2>();
    const double load = least_load(minimum_norm, N, working);  // exact; 1 is just feasible
    result.kind = load <= 1 ? AllocationKind::kNullSpace : AllocationKind::kScaled;
    if (load > 1) result.scale = 1 / load;
    const MotorVector part = result.scale * minimum_norm;
    const MotorVector stiffness =
        (limit_Nm.norm() / kTorqueReserve * limit_Nm.cwiseInverse()).cwiseAbs2();
    tau = part + N * least_cost({part, N, working, stiffness});
    if (!(tau.array().abs() <= limit_Nm.array()).all()) {
      // Law 1 must hold despite rounding: the minimum-norm torques, scaled down, are feasible.
      result.kind = AllocationKind::kScaled;
      result.scale = 1 / (minimum_norm.array().abs() / working.array()).maxCoeff();
      tau = result.scale * minimum_norm;
    }
  }
  result.wrench_device = G.transpose() * tau;
  return result;
}

AllocationResult allocate_torques(const Jacobian& G, const Wrench& wrench_device,
                                  double limit_Nm) noexcept {
  return allocate_torques(G, wrench_device, MotorVector::Constant(limit_Nm).eval());
}

}  // namespace trocar::runtime
