// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "runtime/mechanism/jacobian.h"
#include "runtime/mechanism/kinematics.h"
#include "runtime/mechanism/singularity.h"
#include "runtime/mechanism/torque_allocation.h"
#include "tests/bench/conditioning.h"
#include "tests/reference/mechanism/influence_jacobian.h"
#include "tests/support/device_workspace.h"

namespace trocar::test {
namespace {

using namespace runtime;
using nlohmann::json;
using testing_support::Random;
using testing_support::random_workspace_pose;
using testing_support::Workspace;
using Vector = std::array<Precise, 3>;

Vector operator+(const Vector& a, const Vector& b) {
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}
Vector operator-(const Vector& a, const Vector& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
Vector operator*(const Precise& s, const Vector& a) {
  return {s * a[0], s * a[1], s * a[2]};
}
Precise dot(const Vector& a, const Vector& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

struct PrecisePose {
  Vector p;
  std::array<Vector, 3> rows;  ///< rows of the rotation matrix
};

Vector apply(const std::array<Vector, 3>& rows, const Vector& v) {
  return {dot(rows[0], v), dot(rows[1], v), dot(rows[2], v)};
}

/// The pose in high precision, with the quaternion normalised.
PrecisePose precise(const Pose& T) {
  const Precise w = T.q.w(), x = T.q.x(), y = T.q.y(), z = T.q.z();
  const Precise s = 2 / (w * w + x * x + y * y + z * z);
  return {{T.p_m.x(), T.p_m.y(), T.p_m.z()},
          {{{1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)},
            {s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)},
            {s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)}}}};
}

/// Shifted along an axis of {B} (0..2), or rotated about it through the plate's origin (3..5).
PrecisePose moved(const PrecisePose& T, int freedom, const Precise& by) {
  PrecisePose out = T;
  const std::size_t k = static_cast<std::size_t>(freedom) % 3;
  if (freedom < 3) {
    out.p[k] += by;
    return out;
  }
  const std::size_t i = (k + 1) % 3, j = (k + 2) % 3;
  out.rows[i] = cos(by) * T.rows[i] - sin(by) * T.rows[j];
  out.rows[j] = sin(by) * T.rows[i] + cos(by) * T.rows[j];
  return out;
}

/// The motor angles th1 and th4 of a leg.
std::array<Precise, 2> motor_angles_of(const DeviceGeometry& g, const PrecisePose& T, int leg) {
  static constexpr std::array<std::array<int, 2>, kLegs> kTurn{{{1, 0}, {0, 1}, {-1, 0}, {0, -1}}};
  const auto [c, s] = kTurn[static_cast<std::size_t>(leg)];
  const Vector joint =
      T.p + apply(T.rows, {Precise(g.R_T_m) * c, Precise(g.R_T_m) * s, Precise(0)});
  const Vector C{c * joint[0] + s * joint[1], c * joint[1] - s * joint[0], joint[2]};
  const auto chain = [](const Precise& px, const Precise& py, const Precise& pn, const Precise& a,
                        const Precise& b, int branch) {
    const Precise span2 = px * px + py * py, reach2 = b * b - pn * pn;
    const Precise cosine = (span2 + a * a - reach2) / (2 * a * sqrt(span2));
    return Precise(atan2(py, px) + branch * acos(cosine));
  };
  const Precise th1 = chain(C[0] - g.R_B1_m, C[2] - g.z_A_m, C[1], g.l1_m, g.l2_m, g.branch_theta1);
  const Vector E{Precise(g.R_B1_m) + g.l1_m * cos(th1), Precise(0),
                 Precise(g.z_A_m) + g.l1_m * sin(th1)};
  const Vector D = E + Precise(g.l5_m) / g.l2_m * (C - E);
  const Vector B{g.R_B2_m * cos(Precise(g.d_rad)), g.R_B2_m * sin(Precise(g.d_rad)),
                 Precise(g.z_A_m) - g.H_B_m};
  const Vector q = D - B;
  return {th1, chain(q[0], q[1], q[2], g.l3_m, g.l4_m, g.branch_theta4)};
}

using PreciseJacobian = std::array<std::array<Precise, 6>, kMotors>;

/// Central differences with a step that suits 50 digits: good to about 30 digits, fewer near a
/// branch.
PreciseJacobian by_differences(const DeviceGeometry& g, const Pose& pose) {
  const Precise step("1e-17");
  const PrecisePose T = precise(pose);
  PreciseJacobian out;
  for (int freedom = 0; freedom < 6; ++freedom) {
    const PrecisePose plus = moved(T, freedom, step), minus = moved(T, freedom, -step);
    for (int leg = 0; leg < kLegs; ++leg) {
      const auto a = motor_angles_of(g, plus, leg), b = motor_angles_of(g, minus, leg);
      for (std::size_t which = 0; which < 2; ++which) {
        out[static_cast<std::size_t>(motor_index(leg, static_cast<int>(which)))]
           [static_cast<std::size_t>(freedom)] = (a[which] - b[which]) / (2 * step);
      }
    }
  }
  return out;
}

/// Row by row, relative to the row's largest entry.
double row_error(const Jacobian& G, const PreciseJacobian& exact) {
  double worst = 0;
  for (std::size_t i = 0; i < exact.size(); ++i) {
    Precise largest = 0, error = 0;
    for (std::size_t k = 0; k < 6; ++k) {
      const Precise& e = exact[i][k];
      largest = std::max(largest, Precise(abs(e)));
      error = std::max(
          error,
          Precise(abs(Precise(G(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k))) - e)));
    }
    worst = std::max(worst, static_cast<double>(Precise(error / largest)));
  }
  return worst;
}

/// Distance to the nearest pose where two branches meet; negative where a leg does not reach.
double branch_distance(const DeviceDescription& device, const Pose& T) {
  const InverseResult inverse = inverse_kinematics(device, T);
  if (!inverse.status) return -1;
  const JacobianResult G = jacobian(device, T, inverse.joints);
  if (!G.status) return -1;
  return measure_singularity(device, T, inverse.joints, G.G).nearest_branch_m;
}

/// A pose within `distance_m` of the end of a branch: by bisection from the workspace outwards to
/// where a leg no longer reaches.
Pose beside_branch(const DeviceDescription& device, Random& random, double distance_m) {
  const Pose from = random_workspace_pose(random);
  const Eigen::Vector3d along = random.direction();
  double low = 0, high = 0.4;
  for (int i = 0; i < 200 && high - low > 1e-17; ++i) {
    const double middle = (low + high) / 2;
    const Pose T{from.p_m + middle * along, from.q};
    (branch_distance(device, T) > distance_m ? low : high) = middle;
  }
  return {from.p_m + low * along, from.q};
}

}  // namespace

json jacobian_rows(int poses) {
  const DeviceDescription device = default_device_description();
  json rows = json::array();
  const auto measure = [&](const std::string& name, int count, auto&& make) {
    Random random(50);
    double compact = 0, influence = 0, nearest_m = 1;
    int done = 0, refused = 0;
    for (int n = 0; n < count; ++n) {
      const Pose T = make(random);
      const InverseResult inverse = inverse_kinematics(device, T);
      const JacobianResult a = jacobian(device, T, inverse.joints);
      const JacobianResult b = influence_jacobian(device, T, inverse.joints);
      if (!inverse.status || !a.status || !b.status) {
        ++refused;
        continue;
      }
      ++done;
      nearest_m =
          std::min(nearest_m, measure_singularity(device, T, inverse.joints, a.G).nearest_branch_m);
      const PreciseJacobian exact = by_differences(device.geometry, T);
      compact = std::max(compact, row_error(a.G, exact));
      influence = std::max(influence, row_error(b.G, exact));
    }
    json row = {{"id", name}, {"inputs", name}, {"count", done}, {"refused_as_singular", refused}};
    if (done > 0) {
      row["nearest_branch_m"] = nearest_m;
      row["error_compact"] = compact;
      row["error_influence"] = influence;
      row["bound"] = 8 * kEpsilon * (1 + device.geometry.l2_m / nearest_m);
    }
    rows.push_back(std::move(row));
  };
  measure("stated workspace", poses, [](Random& random) { return random_workspace_pose(random); });
  measure("wherever the legs reach", poses, [&](Random& random) {
    const Workspace wide = {.z_min_m = 0.05, .z_max_m = 0.24, .lateral_m = 0.08, .tilt_rad = 0.8};
    for (;;) {
      Pose T = random_workspace_pose(random, wide);
      if (branch_distance(device, T) > 0.002) return T;
    }
  });
  for (const auto& [name, distance_m] : {std::pair{"1 mm from a branch's end", 1e-3},
                                         {"1 um from a branch's end", 1e-6},
                                         {"1 nm from a branch's end", 1e-9},
                                         {"at a branch's end, to rounding", 0.0}}) {
    measure(name, std::max(1, poses / 4),
            [&, d = distance_m](Random& random) { return beside_branch(device, random, d); });
  }
  return rows;
}

}  // namespace trocar::test
