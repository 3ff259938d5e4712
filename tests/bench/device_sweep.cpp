// SPDX-License-Identifier: Apache-2.0
// device_sweep < PLAN.json > ANSWER.json: the built-in device compared with the same one with three
// legs, and the torque allocation compared with clipping. The plan is made by
// scripts/lib/report/sections/device.py. Exit codes as everywhere.
//
// PLAN: {"poses": 20000,                     random poses of the stated workspace
//        "tilts_deg": [..],                  and as many at each of these tilts
//        "maps": [{"extent_m", "heights_m": [..], "points", "tilt_deg", "tilts"}],
//        "forces_N": [..], "wrenches": 2000, random wrenches at each force
//        "timed": 20000, "kinematics_poses": 1000}
#include <algorithm>
#include <chrono>
#include <cmath>
#include <iostream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "runtime/mechanism/torque_allocation.h"
#include "tests/bench/kinematics_rows.h"
#include "tests/bench/sweep_main.h"
#include "tests/reference/mechanism/leg_ring.h"
#include "tests/support/device_workspace.h"

namespace {

using namespace trocar;
using namespace trocar::runtime;
using nlohmann::json;
using testing_support::Random;
using testing_support::random_workspace_pose;

constexpr double kDeg = std::numbers::pi / 180;
constexpr double kForce_N = 35;            // the experiments' puncture force
constexpr double kBounds[] = {0.02, 0.1};  // of the inverse condition; the loop stops at the first

double quantile(const std::vector<double>& sorted, double q) {
  if (sorted.empty()) return std::nan("");
  const auto at = static_cast<std::size_t>(q * static_cast<double>(sorted.size()));
  return sorted[std::min(at, sorted.size() - 1)];
}

// Results, one number for each pose.
struct Survey {
  std::vector<double> inverse_condition, smallest_per_m, torque_Nm;
  int unreachable = 0;

  json row(const std::string& id) {
    for (auto* values : {&inverse_condition, &smallest_per_m, &torque_Nm})
      std::sort(values->begin(), values->end());
    const auto poses = static_cast<double>(inverse_condition.size());
    json out = {{"id", id},
                {"reachable_poses", inverse_condition.size()},
                {"unreachable_poses", unreachable},
                {"inverse_condition_min", quantile(inverse_condition, 0)},
                {"inverse_condition_p1", quantile(inverse_condition, 0.01)},
                {"inverse_condition_median", quantile(inverse_condition, 0.5)},
                {"smallest_singular_value_min_per_m", quantile(smallest_per_m, 0)},
                {"smallest_singular_value_median_per_m", quantile(smallest_per_m, 0.5)},
                {"torque_for_35N_median_Nm", quantile(torque_Nm, 0.5)},
                {"torque_for_35N_max_Nm", quantile(torque_Nm, 1)}};
    for (const double bound : kBounds) {
      const auto below =
          std::lower_bound(inverse_condition.begin(), inverse_condition.end(), bound) -
          inverse_condition.begin();
      out["share_below_" + json(bound).dump() + "_percent"] =
          100 * static_cast<double>(below) / poses;
    }
    return out;
  }
};

template <int Legs>
void add(const DeviceDescription& device, const Pose& T, Survey& survey) {
  const auto solved = LegRing<Legs>::solve(device, T);
  if (!solved.status) {
    ++survey.unreachable;
    return;
  }
  const auto s = LegRing<Legs>::singular_values(solved.G, kCharacteristicLength_m);
  survey.inverse_condition.push_back(s[5] / s[0]);
  survey.smallest_per_m.push_back(s[5]);
  // The largest minimum-norm torque for that force in the worst direction, motor by motor.
  const Eigen::Matrix<double, 6, 6> normal = solved.G.transpose() * solved.G;
  const Eigen::Matrix<double, 2 * Legs, 6> inverse = solved.G * reference::inverse(normal);
  survey.torque_Nm.push_back(kForce_N * inverse.template leftCols<3>().rowwise().norm().maxCoeff());
}

template <int Legs>
json surveys(const DeviceDescription& device, const json& plan) {
  const int poses = plan.at("poses");
  json out = json::array();
  Random random(71);
  Survey stated;
  for (int n = 0; n < poses; ++n)
    add<Legs>(device, random_workspace_pose(random), stated);
  out.push_back(stated.row("stated workspace"));
  for (const double tilt_deg : plan.at("tilts_deg")) {
    Survey tilted;
    for (int n = 0; n < poses; ++n) {
      Pose T = random_workspace_pose(random);
      T.q = from_rotation_vector(tilt_deg * kDeg * random.direction());
      add<Legs>(device, T, tilted);
    }
    json row = tilted.row(json(tilt_deg).dump() + " deg");
    row["tilt_deg"] = tilt_deg;
    out.push_back(std::move(row));
  }
  return out;
}

// Directions spread evenly over the sphere (a Fibonacci lattice).
std::vector<Eigen::Vector3d> spread(int count) {
  std::vector<Eigen::Vector3d> out;
  for (int i = 0; i < count; ++i) {
    const double z = 1 - (2 * i + 1.0) / count,
                 azimuth = i * std::numbers::pi * (3 - std::sqrt(5.0));
    const double rho = std::sqrt(1 - z * z);
    out.emplace_back(rho * std::cos(azimuth), rho * std::sin(azimuth), z);
  }
  return out;
}

// Four digits after the point are enough for maps.
double shown(double inverse_condition) {
  return std::round(inverse_condition * 1e4) / 1e4;
}

template <int Legs>
json map_of(const DeviceDescription& device, const json& plan, double z_m) {
  const double extent_m = plan.at("extent_m");
  const int points = plan.at("points");
  const double tilt_rad = plan.at("tilt_deg").get<double>() * kDeg;
  const auto axes = spread(plan.at("tilts"));
  const auto at = [&](Pose T, const Eigen::Vector3d& rotation) {
    T.q = from_rotation_vector(rotation);
    const auto solved = LegRing<Legs>::solve(device, T);
    if (!solved.status) return 0.0;
    const auto s = LegRing<Legs>::singular_values(solved.G, kCharacteristicLength_m);
    return s[5] / s[0];
  };
  json upright = json::array(), tilted = json::array();
  for (int row = 0; row < points; ++row) {
    json upright_row = json::array(), tilted_row = json::array();
    for (int column = 0; column < points; ++column) {
      Pose T;
      T.p_m = {extent_m * (2.0 * column / (points - 1) - 1),
               extent_m * (2.0 * row / (points - 1) - 1), z_m};
      double worst = at(T, Eigen::Vector3d::Zero());
      upright_row.push_back(shown(worst));
      for (const Eigen::Vector3d& axis : axes)
        worst = std::min(worst, at(T, tilt_rad * axis));
      tilted_row.push_back(shown(worst));
    }
    upright.push_back(std::move(upright_row));
    tilted.push_back(std::move(tilted_row));
  }
  return {{"z_m", z_m},
          {"extent_m", extent_m},
          {"tilt_deg", plan.at("tilt_deg")},
          {"upright", std::move(upright)},
          {"tilted", std::move(tilted)}};
}

template <int Legs>
json ring(const DeviceDescription& device, const json& plan) {
  json maps = json::array();
  for (const json& each : plan.at("maps")) {
    for (const double z_m : each.at("heights_m"))
      maps.push_back(map_of<Legs>(device, each, z_m));
  }
  return {{"id", std::to_string(Legs) + " legs, " + std::to_string(2 * Legs) + " motors"},
          {"rows", surveys<Legs>(device, plan)},
          {"maps", std::move(maps)}};
}

struct Task {
  Jacobian G;
  Wrench wanted;
};
Task random_task(Random& random, const DeviceDescription& device, double force_N) {
  const Pose T = random_workspace_pose(random);
  Task task;
  task.G = LegRing<kLegs>::solve(device, T).G;
  task.wanted << force_N * random.direction(), 0.05 * force_N * random.in_ball();
  return task;
}

double angle_deg(const Wrench& a, const Wrench& b) {
  const double cosine = a.head<3>().dot(b.head<3>()) / (a.head<3>().norm() * b.head<3>().norm());
  return std::acos(std::clamp(cosine, -1.0, 1.0)) / kDeg;
}

json allocation(const DeviceDescription& device, const json& plan) {
  const double limit_Nm = device.motor_peak_torque_Nm;
  const int count = plan.at("wrenches");
  json rows = json::array();
  Random random(72);
  for (const double force_N : plan.at("forces_N")) {
    int exact = 0, feasible = 0, clipped_exact = 0, clipped_nearly = 0;
    double scale_sum = 0, residual = 0, largest = 0;
    std::vector<double> bend_deg, bend_ours_deg;
    for (int n = 0; n < count; ++n) {
      const Task task = random_task(random, device, force_N);
      const AllocationResult ours = allocate_torques(task.G, task.wanted, limit_Nm);
      exact += ours.scale == 1;
      scale_sum += ours.scale;
      residual = std::max(residual, (ours.wrench_device - ours.scale * task.wanted).norm());
      largest = std::max(largest, ours.tau_motor_Nm.cwiseAbs().maxCoeff() / limit_Nm);
      bend_ours_deg.push_back(angle_deg(ours.wrench_device, task.wanted));
      // The limits are widened so that the working limits become the limits themselves.
      feasible += allocate_torques(task.G, task.wanted, limit_Nm / (1 - kTorqueReserve)).scale == 1;

      const MotorVector least = task.G * (task.G.transpose() * task.G).ldlt().solve(task.wanted);
      const MotorVector clipped = least.cwiseMin(limit_Nm).cwiseMax(-limit_Nm);
      if (clipped == least) {
        ++clipped_exact;
        bend_deg.push_back(0);
      } else {
        bend_deg.push_back(angle_deg(task.G.transpose() * clipped, task.wanted));
        clipped_nearly += bend_deg.back() < 1;
      }
    }
    std::sort(bend_deg.begin(), bend_deg.end());
    std::sort(bend_ours_deg.begin(), bend_ours_deg.end());
    const double percent = 100.0 / count;
    rows.push_back({{"id", json(force_N).dump() + " N"},
                    {"force_N", force_N},
                    {"exact_percent", exact * percent},
                    {"feasible_percent", feasible * percent},
                    {"minimum_norm_fits_percent", clipped_exact * percent},
                    {"clipped_but_within_1deg_percent", clipped_nearly * percent},
                    {"mean_scale", scale_sum / count},
                    {"residual_max", residual},
                    {"largest_torque_of_limit", largest},
                    {"direction_error_max_deg", bend_ours_deg.back()},
                    {"clipping_direction_error_median_deg", quantile(bend_deg, 0.5)},
                    {"clipping_direction_error_p95_deg", quantile(bend_deg, 0.95)},
                    {"clipping_direction_error_max_deg", bend_deg.back()}});
  }
  return rows;
}

// Every task runs several times in a row. Its shortest time is the work itself; its first time
// includes cold caches.
json times(const DeviceDescription& device, int count) {
  constexpr int kRepetitions = 7;
  Random random(73);
  std::vector<double> least_us[3], all_us, first_us;
  double sink = 0;
  for (int n = 0; n < count; ++n) {
    const Task task = random_task(random, device, random.between(10, 150));
    double least = 1e9;
    std::size_t kind = 0;
    for (int r = 0; r < kRepetitions; ++r) {
      const auto start = std::chrono::steady_clock::now();
      const AllocationResult result =
          allocate_torques(task.G, task.wanted, device.motor_peak_torque_Nm);
      const double us =
          std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start)
              .count();
      sink += result.scale;
      kind = static_cast<std::size_t>(result.kind);
      least = std::min(least, us);
      if (r == 0) first_us.push_back(us);
    }
    all_us.push_back(least);
    if (kind < 3) least_us[kind].push_back(least);
  }
  if (!(sink >= 0)) std::cerr << "no result\n";
  json rows = json::array();
  const auto put = [&rows](const char* id, std::vector<double>& values) {
    std::sort(values.begin(), values.end());
    rows.push_back({{"id", id},
                    {"wrenches", values.size()},
                    {"median_us", quantile(values, 0.5)},
                    {"p999_us", quantile(values, 0.999)},
                    {"max_us", quantile(values, 1)}});
  };
  put("all", all_us);
  put("minimum norm", least_us[0]);
  put("null space", least_us[1]);
  put("scaled", least_us[2]);
  put("all, first call with interruptions", first_us);
  return rows;
}

json measure(const json& plan) {
  const DeviceDescription device = default_device_description();
  return {{"rings", json::array({ring<4>(device, plan), ring<3>(device, plan)})},
          {"allocation", allocation(device, plan)},
          {"times", times(device, plan.at("timed"))},
          {"kinematics", test::kinematics_rows(device, plan.at("kinematics_poses"))},
          {"torque_reserve_percent", 100 * kTorqueReserve}};
}

}  // namespace

int main() {
  return trocar::test::sweep_main("device_sweep", measure);
}
