// SPDX-License-Identifier: Apache-2.0
// device_bench: the four-legged device. Its workspace beside that of the same device with three
// legs; torque allocation beside clipping the pseudo-inverse; kinematics and Jacobian with their
// errors; the loop's stability against a hand without damping.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "runtime/device/four_legs/kinematics.h"
#include "runtime/device/four_legs/torque_allocation.h"
#include "tests/bench/bench.h"
#include "tests/reference/mechanism/influence_jacobian.h"
#include "tests/reference/mechanism/leg_ring.h"
#include "tests/support/device_workspace.h"
#include "tests/support/loop_rig.h"

namespace trocar::bench {
namespace {

using namespace trocar::runtime;
using testing_support::Random;
using testing_support::random_workspace_pose;

constexpr double kDeg = std::numbers::pi / 180;

const DeviceDescription& device() {
  static const DeviceDescription description = default_device_description();
  return description;
}

/// A work that takes the next of `samples` in each call.
template <typename Sample, typename Call>
auto cycling(std::shared_ptr<const std::vector<Sample>> samples, Call call) {
  return [samples = std::move(samples), call, next = std::size_t{0}]() mutable {
    benchmark::DoNotOptimize(call((*samples)[next++ % samples->size()]));
  };
}

// ---- workspace ----

template <int Legs>
void add_workspace(const std::string& method, double tilt_deg) {
  const auto poses = std::make_shared<std::vector<Pose>>();
  Random random(71);
  for (int n = 0; n < (quick ? 500 : 20'000); ++n) {
    Pose T = random_workspace_pose(random);
    if (tilt_deg > 0) T.q = from_rotation_vector(tilt_deg * kDeg * random.direction());
    poses->push_back(T);
  }
  const auto survey = [poses] {
    std::vector<double> condition;
    double torque_Nm = 0;
    for (const Pose& T : *poses) {
      const auto solved = LegRing<Legs>::solve(device(), T);
      if (!solved.status) continue;
      const auto s = LegRing<Legs>::singular_values(solved.G, kCharacteristicLength_m);
      condition.push_back(s[5] / s[0]);
      // The largest minimum-norm torque for 35 N in the worst direction, motor by motor.
      const Eigen::Matrix<double, 6, 6> normal = solved.G.transpose() * solved.G;
      const Eigen::Matrix<double, 2 * Legs, 6> inverse = solved.G * reference::inverse(normal);
      torque_Nm =
          std::max(torque_Nm, 35 * inverse.template leftCols<3>().rowwise().norm().maxCoeff());
    }
    std::sort(condition.begin(), condition.end());
    return Counters{
        {"unreachable", static_cast<double>(poses->size() - condition.size())},
        {"inverse_condition_min", condition.empty() ? 0 : condition.front()},
        {"inverse_condition_median", condition.empty() ? 0 : condition[condition.size() / 2]},
        {"torque_for_35N_max_Nm", torque_Nm}};
  };
  add("workspace/" + (tilt_deg > 0 ? std::to_string(int(tilt_deg)) + "-deg" : "stated") + "/" +
          method,
      benchmark::kMicrosecond,
      cycling<Pose>(poses, [](const Pose& T) { return LegRing<Legs>::solve(device(), T); }),
      survey);
}

// ---- kinematics ----

struct Sample {
  Pose pose;
  InverseResult inverse;
  std::array<double, kEncoders> encoder_rad;
};

/// Translation in m plus rotation in rad times 0.05 m.
double distance_m(const Pose& a, const Pose& b) {
  return (a.p_m - b.p_m).norm() +
         kCharacteristicLength_m * rotation_vector(a.q.conjugate() * b.q).norm();
}

void add_kinematics() {
  const auto samples = std::make_shared<std::vector<Sample>>(quick ? 200 : 1000);
  Random random(81);
  for (Sample& s : *samples) {
    s.pose = random_workspace_pose(random);
    s.inverse = inverse_kinematics(device(), s.pose);
    s.encoder_rad = encoder_angles(s.inverse.joints);
  }
  const auto inverse = [](const Sample& s) { return inverse_kinematics(device(), s.pose); };
  const auto by_encoders = [](const Sample& s) {
    return forward_kinematics(device(), s.encoder_rad);
  };
  const auto compact = [](const Sample& s) { return jacobian(device(), s.pose, s.inverse.joints); };
  const auto influence = [](const Sample& s) {
    return influence_jacobian(device(), s.pose, s.inverse.joints);
  };
  const auto worst_pose = [samples](const auto& forward, double bound_m) {
    return [samples, forward, bound_m] {
      double worst = 0;
      for (const Sample& s : *samples) {
        const ForwardResult found = forward(s);
        worst = std::max(worst, found.status ? distance_m(found.T_device_plate, s.pose) : 1);
      }
      check(worst < bound_m, "forward kinematics does not return the pose");
      return Counters{{"error_pose_m", worst}};
    };
  };
  const auto us = benchmark::kMicrosecond;
  add("kinematics/inverse/trocar", us, cycling<Sample>(samples, inverse));
  add("kinematics/forward/trocar-12-encoders", us, cycling<Sample>(samples, by_encoders),
      worst_pose(by_encoders, 1e-12));
  add("kinematics/jacobian/trocar", us, cycling<Sample>(samples, compact), [=] {
    double worst = 0;
    for (const Sample& s : *samples) {
      const Jacobian paper = influence(s).G;
      worst = std::max(worst, (compact(s).G - paper).norm() / paper.norm());
    }
    check(worst < 1e-11, "the Jacobian differs from the influence coefficients");
    return Counters{{"error_difference", worst}};
  });
  add("kinematics/jacobian/peer-influence-coefficients", us, cycling<Sample>(samples, influence));
}

// ---- torque allocation ----

struct Task {
  Jacobian G;
  Wrench wanted;
};

double angle_deg(const Wrench& a, const Wrench& b) {
  const double cosine = a.head<3>().dot(b.head<3>()) / (a.head<3>().norm() * b.head<3>().norm());
  return std::acos(std::clamp(cosine, -1.0, 1.0)) / kDeg;
}

MotorVector clipped(const Task& task, double limit_Nm) {
  const MotorVector least = task.G * (task.G.transpose() * task.G).ldlt().solve(task.wanted);
  return least.cwiseMin(limit_Nm).cwiseMax(-limit_Nm);
}

void add_allocation(double force_N) {
  const double limit_Nm = device().motor_peak_torque_Nm;
  const auto tasks = std::make_shared<std::vector<Task>>(quick ? 400 : 2000);
  Random random(72);
  for (Task& task : *tasks) {
    task.G = LegRing<kLegs>::solve(device(), random_workspace_pose(random)).G;
    task.wanted << force_N * random.direction(), 0.05 * force_N * random.in_ball();
  }
  const auto ours = [limit_Nm](const Task& task) {
    return allocate_torques(task.G, task.wanted, limit_Nm);
  };
  const auto clip = [limit_Nm](const Task& task) { return clipped(task, limit_Nm); };
  const double percent = 100.0 / static_cast<double>(tasks->size());
  const std::string stage = "allocation/" + std::to_string(int(force_N)) + "N/";
  add(stage + "trocar", benchmark::kMicrosecond, cycling<Task>(tasks, ours), [=] {
    double bend_deg = 0, residual = 0, exact = 0, scale = 0;
    for (const Task& task : *tasks) {
      const AllocationResult result = ours(task);
      bend_deg = std::max(bend_deg, angle_deg(result.wrench_device, task.wanted));
      residual = std::max(residual, (result.wrench_device - result.scale * task.wanted).norm());
      exact += result.scale == 1 ? percent : 0;
      scale += result.scale * percent / 100;
      check(result.tau_motor_Nm.cwiseAbs().maxCoeff() <= limit_Nm, "a torque is above its limit");
    }
    check(bend_deg < 1e-5 && residual < 1e-9, "an allocated wrench is bent");
    return Counters{
        {"error_direction_max_deg", bend_deg}, {"exact_percent", exact}, {"mean_scale", scale}};
  });
  add(stage + "peer-clipping", benchmark::kMicrosecond, cycling<Task>(tasks, clip), [=] {
    double bend_deg = 0, exact = 0;
    for (const Task& task : *tasks) {
      const Wrench given = task.G.transpose() * clip(task);
      const double bend = angle_deg(given, task.wanted);
      bend_deg = std::max(bend_deg, bend);
      exact += (given - task.wanted).norm() < 1e-9 * task.wanted.norm() ? percent : 0;
    }
    return Counters{{"error_direction_max_deg", bend_deg}, {"exact_percent", exact}};
  });
}

// ---- the loop ----

/// A hand without damping presses within 0.5 s and holds. Time: of the simulation.
void add_loop(double rate_Hz, double stiffness_N_per_m, bool is_led) {
  test::RigOptions options;
  options.rate_Hz = rate_Hz;
  options.tissue.stiffness_N_per_m = stiffness_N_per_m;
  options.is_led = is_led;
  const auto oscillation_m = [options] {
    test::Rig rig(options);
    rig.run_until(1.5);
    return rig.run_until(2);
  };
  add(
      "loop/" + std::to_string(int(stiffness_N_per_m / 1000)) + "kN-per-m-" +
          std::to_string(int(rate_Hz)) + "Hz/" + (is_led ? "trocar" : "peer-uncontrolled"),
      benchmark::kMillisecond, [oscillation_m] { benchmark::DoNotOptimize(oscillation_m()); },
      [oscillation_m, is_led] {
        const double mm = 1e3 * oscillation_m();
        check(is_led ? mm < 0.1 : mm > 1, "the controller does not decide about the oscillation");
        return Counters{{"error_oscillation_mm", mm}};
      });
}

void add_all(const std::vector<Input>& /*inputs*/) {
  for (const double tilt_deg : {0.0, 20.0, 40.0}) {
    add_workspace<4>("trocar-4-legs", tilt_deg);
    add_workspace<3>("peer-3-legs", tilt_deg);
  }
  add_kinematics();
  for (const double force_N : {10.0, 35.0, 60.0, 140.0})
    add_allocation(force_N);
  for (const bool is_led : {true, false}) {
    add_loop(500, 5000, is_led);
    add_loop(1000, 5000, is_led);
    add_loop(1000, 30'000, is_led);
  }
}

}  // namespace
}  // namespace trocar::bench

int main(int argc, char** argv) {
  return trocar::bench::bench_main(argc, argv, trocar::bench::add_all);
}
