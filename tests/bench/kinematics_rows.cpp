// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/kinematics_rows.h"

#include <algorithm>
#include <chrono>
#include <string>
#include <vector>

#include "runtime/mechanism/jacobian.h"
#include "runtime/mechanism/kinematics.h"
#include "tests/reference/mechanism/influence_jacobian.h"
#include "tests/support/device_workspace.h"

namespace trocar::test {
namespace {

using namespace runtime;
using nlohmann::json;
using testing_support::Random;
using testing_support::random_workspace_pose;

constexpr int kPasses = 15;

struct Sample {
  Pose pose,
      before;  ///< `before`: half a millimetre and half a degree away, as in the previous tick
  InverseResult inverse;
  std::array<double, kEncoders> encoder_rad;
  MotorVector motor_rad;
};

/// Translation in m plus rotation in rad times 0.05 m.
double distance_m(const Pose& a, const Pose& b) {
  return (a.p_m - b.p_m).norm() +
         kCharacteristicLength_m * rotation_vector(a.q.conjugate() * b.q).norm();
}

/// The time of a call in the median pass.
template <typename Call>
double median_us(const std::vector<Sample>& samples, Call&& call) {
  std::vector<double> us;
  double sink = 0;
  for (int pass = 0; pass < kPasses; ++pass) {
    const auto start = std::chrono::steady_clock::now();
    for (const Sample& sample : samples)
      sink += call(sample);
    us.push_back(std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start)
                     .count() /
                 static_cast<double>(samples.size()));
  }
  std::nth_element(us.begin(), us.begin() + kPasses / 2, us.end());
  return sink == sink ? us[kPasses / 2] : 0;  // uses the sum, so that the compiler keeps the calls
}

}  // namespace

json kinematics_rows(const DeviceDescription& device, int poses) {
  Random random(81);
  std::vector<Sample> samples(static_cast<std::size_t>(poses));
  for (Sample& s : samples) {
    s.pose = random_workspace_pose(random);
    s.before.p_m = s.pose.p_m + 5e-4 * random.in_ball();
    s.before.q = from_rotation_vector(0.0087 * random.in_ball()) * s.pose.q;
    s.inverse = inverse_kinematics(device, s.pose);
    s.encoder_rad = encoder_angles(s.inverse.joints);
    s.motor_rad = motor_angles(s.inverse.joints);
  }
  double forward_m = 0, motors_m = 0, influence = 0;
  int iterations = 0, failures = 0;
  for (const Sample& s : samples) {
    const ForwardResult by_all = forward_kinematics(device, s.encoder_rad);
    const ForwardResult by_motors = forward_kinematics_from_motors(device, s.motor_rad, s.before);
    const JacobianResult compact = jacobian(device, s.pose, s.inverse.joints);
    const JacobianResult paper = influence_jacobian(device, s.pose, s.inverse.joints);
    if (!s.inverse.status || !by_all.status || !by_motors.status || !compact.status ||
        !paper.status) {
      ++failures;
      continue;
    }
    forward_m = std::max(forward_m, distance_m(by_all.T_device_plate, s.pose));
    motors_m = std::max(motors_m, distance_m(by_motors.T_device_plate, s.pose));
    iterations = std::max(iterations, by_motors.iterations);
    influence = std::max(influence, (compact.G - paper.G).norm() / paper.G.norm());
  }
  const auto row = [&](const std::string& id, double us) {
    return json{{"id", id}, {"poses", poses}, {"failures", failures}, {"median_us", us}};
  };
  json rows = json::array();
  rows.push_back(row("inverse, 24 angles", median_us(samples, [&](const Sample& s) {
                       return inverse_kinematics(device, s.pose).joints.theta_rad[0][0];
                     })));
  rows.push_back(row("forward, 12 encoders", median_us(samples, [&](const Sample& s) {
                       return forward_kinematics(device, s.encoder_rad).T_device_plate.p_m.x();
                     })));
  rows.back()["pose_error_max_m"] = forward_m;
  rows.push_back(row(
      "forward, 8 motors from the last pose", median_us(samples, [&](const Sample& s) {
        return forward_kinematics_from_motors(device, s.motor_rad, s.before).T_device_plate.p_m.x();
      })));
  rows.back()["pose_error_max_m"] = motors_m;
  rows.back()["iterations_max"] = iterations;
  rows.push_back(row("Jacobian, compact form", median_us(samples, [&](const Sample& s) {
                       return jacobian(device, s.pose, s.inverse.joints).G(0, 0);
                     })));
  rows.push_back(
      row("Jacobian, the paper's influence coefficients", median_us(samples, [&](const Sample& s) {
            return influence_jacobian(device, s.pose, s.inverse.joints).G(0, 0);
          })));
  rows.back()["difference_from_compact_max"] = influence;
  return rows;
}

}  // namespace trocar::test
