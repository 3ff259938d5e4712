// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "runtime/mechanism/jacobian.h"
#include "runtime/mechanism/kinematics.h"
#include "runtime/mechanism/torque_allocation.h"
#include "tests/bench/conditioning.h"
#include "tests/reference/decompositions/decompositions.h"
#include "tests/support/device_workspace.h"

namespace trocar::test {
namespace {

using namespace runtime;
using nlohmann::json;
using testing_support::Random;
using testing_support::random_workspace_pose;

using Row = std::vector<Precise>;
using Matrix = std::vector<Row>;

Precise dot(const Row& a, const Row& b) {
  Precise sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    sum += a[i] * b[i];
  return sum;
}

/// A x = b by elimination with row pivots; nothing if A is singular.
std::optional<Row> solve(Matrix A, Row b) {
  const std::size_t n = b.size();
  for (std::size_t k = 0; k < n; ++k) {
    std::size_t pivot = k;
    for (std::size_t r = k + 1; r < n; ++r)
      if (abs(A[r][k]) > abs(A[pivot][k])) pivot = r;
    if (abs(A[pivot][k]) < Precise("1e-40")) return std::nullopt;
    std::swap(A[k], A[pivot]);
    std::swap(b[k], b[pivot]);
    for (std::size_t r = k + 1; r < n; ++r) {
      const Precise factor = A[r][k] / A[k][k];
      for (std::size_t c = k; c < n; ++c)
        A[r][c] -= factor * A[k][c];
      b[r] -= factor * b[k];
    }
  }
  for (std::size_t k = n; k-- > 0;) {
    for (std::size_t c = k + 1; c < n; ++c)
      b[k] -= A[k][c] * b[c];
    b[k] /= A[k][k];
  }
  return b;
}

/// The optimum that torque_allocation.h defines, found by enumeration.
struct Exact {
  Row c;                    ///< minimum-norm torques of the wanted wrench
  std::array<Row, 2> null;  ///< an orthonormal basis of the torques without wrench
  Row working, stiffness;   ///< limits and stiffness of each motor
  Precise scale = 1;
  Row tau;
};

/// c = G (G^T G)^-1 wanted; the null space from projections of two motors' axes.
bool take_spaces(const Jacobian& G, const Wrench& wanted, Exact& out) {
  Matrix normal(6, Row(6));
  Matrix g(kMotors, Row(6));
  for (std::size_t i = 0; i < kMotors; ++i)
    for (std::size_t k = 0; k < 6; ++k)
      g[i][k] = G(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k));
  for (std::size_t i = 0; i < 6; ++i)
    for (std::size_t k = 0; k < 6; ++k)
      for (const Row& row : g)
        normal[i][k] += row[i] * row[k];
  const auto pseudo_inverse = [&](const Row& w) -> std::optional<Row> {
    const auto x = solve(normal, w);
    if (!x) return std::nullopt;
    Row tau;
    for (const Row& row : g)
      tau.push_back(dot(row, *x));
    return tau;
  };
  Row w;
  for (int k = 0; k < 6; ++k)
    w.emplace_back(wanted[k]);
  const auto c = pseudo_inverse(w);
  if (!c) return false;
  out.c = *c;
  std::size_t found = 0;
  for (std::size_t motor = 0; motor < kMotors && found < 2; ++motor) {
    Row axis(kMotors, 0);
    axis[motor] = 1;
    const auto in_range = pseudo_inverse(g[motor]);
    if (!in_range) return false;
    for (std::size_t i = 0; i < kMotors; ++i)
      axis[i] -= (*in_range)[i];
    if (found == 1) {
      const Precise along = dot(axis, out.null[0]);
      for (std::size_t i = 0; i < kMotors; ++i)
        axis[i] -= along * out.null[0][i];
    }
    const Precise length = sqrt(dot(axis, axis));
    if (length < Precise("0.1")) continue;
    for (Precise& a : axis)
      a /= length;
    out.null[found++] = axis;
  }
  return found == 2;
}

/// The largest scale, at most 1, for which c scale + N y keeps the working limits: a linear
/// programme of three unknowns, solved by checking all its vertices.
Precise largest_scale(const Exact& e) {
  Matrix rows;  // row . (scale, y) <= limit
  Row limits;
  for (std::size_t i = 0; i < kMotors; ++i) {
    for (const int sign : {1, -1}) {
      rows.push_back({sign * e.c[i], sign * e.null[0][i], sign * e.null[1][i]});
      limits.push_back(e.working[i]);
    }
  }
  rows.push_back({1, 0, 0});
  limits.emplace_back(1);
  Precise best = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    for (std::size_t j = i + 1; j < rows.size(); ++j) {
      for (std::size_t k = j + 1; k < rows.size(); ++k) {
        const auto x = solve({rows[i], rows[j], rows[k]}, {limits[i], limits[j], limits[k]});
        if (!x || (*x)[0] <= best) continue;
        bool feasible = true;
        for (std::size_t r = 0; r < rows.size() && feasible; ++r)
          feasible = dot(rows[r], *x) <= limits[r] * (1 + Precise("1e-35"));
        if (feasible) best = (*x)[0];
      }
    }
  }
  return best;
}

Row torques(const Exact& e, const std::array<Precise, 2>& y) {
  Row tau(kMotors);
  for (std::size_t i = 0; i < kMotors; ++i)
    tau[i] = e.scale * e.c[i] + y[0] * e.null[0][i] + y[1] * e.null[1][i];
  return tau;
}

/// Law 5 of torque_allocation.h, by Newton's method with halved steps until the slope is
/// zero.
bool take_least_cost(Exact& e) {
  const auto excess = [&](const Row& tau, std::size_t i) {
    return tau[i] > e.working[i]    ? Precise(tau[i] - e.working[i])
           : tau[i] < -e.working[i] ? Precise(tau[i] + e.working[i])
                                    : Precise(0);
  };
  const auto cost = [&](const std::array<Precise, 2>& y) {
    const Row tau = torques(e, y);
    Precise sum = y[0] * y[0] + y[1] * y[1];
    for (std::size_t i = 0; i < kMotors; ++i)
      sum += e.stiffness[i] * excess(tau, i) * excess(tau, i);
    return sum;
  };
  std::array<Precise, 2> y{0, 0};
  for (int iteration = 0; iteration < 200; ++iteration) {
    const Row tau = torques(e, y);
    Matrix H{{1, 0}, {0, 1}};
    Row slope{-y[0], -y[1]};
    for (std::size_t i = 0; i < kMotors; ++i) {
      const Precise x = excess(tau, i);
      if (x == 0) continue;
      for (std::size_t a = 0; a < 2; ++a) {
        for (std::size_t b = 0; b < 2; ++b)
          H[a][b] += e.stiffness[i] * e.null[a][i] * e.null[b][i];
        slope[a] -= e.stiffness[i] * x * e.null[a][i];
      }
    }
    if (abs(slope[0]) + abs(slope[1]) < Precise("1e-32") * (1 + dot(tau, tau))) {
      e.tau = tau;
      return true;
    }
    const auto step = solve(H, slope);
    if (!step) return false;
    Precise part = 1;
    const Precise here = cost(y);
    std::array<Precise, 2> next{};
    for (int halvings = 0; halvings < 100; ++halvings, part /= 2) {
      next = {y[0] + part * (*step)[0], y[1] + part * (*step)[1]};
      if (cost(next) < here) break;
    }
    y = next;
  }
  return false;
}

std::optional<Exact> exact_allocation(const Jacobian& G, const Wrench& wanted,
                                      const MotorVector& limit) {
  Exact e;
  if (!take_spaces(G, wanted, e)) return std::nullopt;
  Precise norm2 = 0;
  for (int i = 0; i < kMotors; ++i)
    norm2 += Precise(limit[i]) * limit[i];
  bool within = true;
  for (int i = 0; i < kMotors; ++i) {
    const Precise reserve = kTorqueReserve;
    e.working.push_back((1 - reserve) * limit[i]);
    e.stiffness.push_back(norm2 / (reserve * reserve * limit[i] * limit[i]));
    within = within && abs(e.c[static_cast<std::size_t>(i)]) <= e.working.back();
  }
  if (within) {
    e.tau = e.c;
    return e;
  }
  e.scale = largest_scale(e);
  return take_least_cost(e) ? std::optional(e) : std::nullopt;
}

struct Input {
  Jacobian G;
  Wrench wanted;
  MotorVector limit;
};

Wrench wrench_of(Random& random, double force_N, double moment_Nm) {
  Wrench w;
  w << force_N * random.direction(), moment_Nm * random.in_ball();
  return w;
}

Jacobian jacobian_at(const Pose& T) {
  const DeviceDescription device = default_device_description();
  return jacobian(device, T, inverse_kinematics(device, T).joints).G;
}

/// The inverse condition computed from singular values, independently of inverse_condition().
double inverse_condition_of(const Jacobian& G) {
  Jacobian scaled = G;
  scaled.rightCols<3>() /= kCharacteristicLength_m;
  const Eigen::VectorXd values = reference::singular_values(scaled);
  return values[5] / values[0];
}

/// A map that nearly cancels the plate's motion along one random direction.
Jacobian nearly_singular(Random& random, double relative) {
  Jacobian G = jacobian_at(random_workspace_pose(random));
  const SingularRange range = singular_range(G);
  // Nearly cancels the motion along a random direction.
  Wrench along = wrench_of(random, 1, 1);
  along.tail<3>() /= kCharacteristicLength_m;
  along.normalize();
  const MotorVector image = G * along;
  G -= (1 - relative * range.smallest / range.largest) * image * along.transpose();
  return G;
}

/// The error bound: a number of rounding errors, times their largest amplification.
constexpr double kRoundings = 64;

}  // namespace

json allocation_rows(int inputs) {
  json rows = json::array();
  const auto measure = [&](const std::string& name, int count, auto&& make) {
    Random random(60);
    double torque_error = 0, scale_error = 0, wrench_error = 0, least_condition = 1;
    double over_bound = 0;
    int kinds[3] = {}, unanswered = 0;
    for (int n = 0; n < count; ++n) {
      const Input in = make(random);
      const AllocationResult got = allocate_torques(in.G, in.wanted, in.limit);
      const auto exact = exact_allocation(in.G, in.wanted, in.limit);
      if (got.kind == AllocationKind::kRefused || !exact) {
        ++unanswered;
        continue;
      }
      ++kinds[static_cast<int>(got.kind)];
      Precise difference = 0, size = 0;
      for (int i = 0; i < kMotors; ++i) {
        const Precise& t = exact->tau[static_cast<std::size_t>(i)];
        difference = std::max(difference, Precise(abs(Precise(got.tau_motor_Nm[i]) - t)));
        size = std::max(size, Precise(abs(t)));
      }
      // The wrench that the torques really give, against scale * wanted.
      Precise off = 0, wanted = 0;
      for (int k = 0; k < 6; ++k) {
        const Precise length = k < 3 ? 1.0 : 1 / kCharacteristicLength_m;
        Precise given = 0;
        for (int i = 0; i < kMotors; ++i)
          given += Precise(in.G(i, k)) * got.tau_motor_Nm[i];
        const Precise goal = Precise(got.scale) * in.wanted[k];
        off = std::max(off, Precise(abs(given - goal) * length));
        wanted = std::max(wanted, Precise(abs(goal) * length));
      }
      // The largest change of the torques if every number changes by a relative eps (law 6).
      const double condition = inverse_condition_of(in.G);
      const double spread = in.limit.norm() / in.limit.minCoeff();
      const bool direct = got.kind == AllocationKind::kMinimumNorm;
      const double slope = direct ? 1 : (2 + 1.5 * spread / kTorqueReserve) * (1 + spread);
      const double unit = kRoundings * kEpsilon / condition;
      least_condition = std::min(least_condition, condition);
      const auto note = [&over_bound](const Precise& error, double bound, double& worst) {
        worst = std::max(worst, static_cast<double>(error));
        over_bound = std::max(over_bound, static_cast<double>(error) / bound);
      };
      note(difference / size, unit * slope, torque_error);
      note(abs(Precise(got.scale) / exact->scale - 1), unit * (direct ? 1 : spread), scale_error);
      note(off / wanted, unit * (direct ? 1 : spread), wrench_error);
    }
    rows.push_back({{"id", name},
                    {"inputs", name},
                    {"count", count - unanswered},
                    {"unanswered", unanswered},
                    {"minimum_norm", kinds[0]},
                    {"null_space", kinds[1]},
                    {"scaled", kinds[2]},
                    {"inverse_condition_least", least_condition},
                    {"torque_error", torque_error},
                    {"scale_error", scale_error},
                    {"wrench_error", wrench_error},
                    {"largest_part_of_bound", over_bound},
                    {"bound", 1}});
  };
  const MotorVector equal = MotorVector::Constant(6);
  const auto somewhere = [](Random& random) { return jacobian_at(random_workspace_pose(random)); };
  measure("35 N and 0.5 N m, within the limits", inputs, [&](Random& random) {
    return Input{somewhere(random), wrench_of(random, 35, 0.5), equal};
  });
  measure("20 to 200 N, about the limits", inputs, [&](Random& random) {
    const double force_N = random.between(20, 200);
    return Input{somewhere(random), wrench_of(random, force_N, 2), equal};
  });
  measure("upright in the middle, where null-space rows are parallel", inputs, [&](Random& random) {
    Pose T;
    T.p_m.z() = random.between(0.095, 0.205);
    return Input{jacobian_at(T), wrench_of(random, random.between(20, 200), 2), equal};
  });
  measure("limits from 1e-3 to 1e3 N m", inputs, [&](Random& random) {
    MotorVector limit;
    for (int i = 0; i < kMotors; ++i)
      limit[i] = std::pow(10, random.between(-3, 3));
    return Input{somewhere(random), wrench_of(random, random.between(1, 100), 1), limit};
  });
  measure("1e-6 N", std::max(1, inputs / 4), [&](Random& random) {
    return Input{somewhere(random), wrench_of(random, 1e-6, 1e-8), equal};
  });
  measure("1e9 N", std::max(1, inputs / 4), [&](Random& random) {
    return Input{somewhere(random), wrench_of(random, 1e9, 1e7), equal};
  });
  for (const auto& [name, relative] :
       {std::pair{"nearly singular, one direction shrunk to 1e-2", 1e-2},
        {"nearly singular, one direction shrunk to 1e-4", 1e-4},
        {"nearly singular, one direction shrunk to 1e-6", 1e-6}}) {
    measure(name, inputs, [&, r = relative](Random& random) {
      const Jacobian G = nearly_singular(random, r);
      return Input{G, wrench_of(random, 35, 0.5), equal};
    });
  }
  return rows;
}

}  // namespace trocar::test
