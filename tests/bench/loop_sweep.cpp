// SPDX-License-Identifier: Apache-2.0
// Measures the stability of the loop: a simulated device is pressed into a synthetic sheet by a
// hand without damping, tick by tick as in a session. In: a plan as JSON on stdin; out: JSON. No
// result depends on the machine's speed.
//
// Plan: {"rates_Hz": [..], "walls": [{"rate_Hz", "stiffness_N_per_m", "pressed_N"}, ..],
//        "region": {"damping_N_s_per_m": [..], "bisections": n}, "traces": bool}
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/bench/sweep_main.h"
#include "tests/support/loop_rig.h"

namespace trocar::test {
namespace {

using nlohmann::json;

constexpr double kSettled_m = 0.1e-3;

std::string id_of(double rate_Hz, double stiffness_N_per_m, bool passivity) {
  char text[80];
  std::snprintf(text, sizeof text, "%.0f N/m at %.0f Hz %s", stiffness_N_per_m, rate_Hz,
                passivity ? "controlled" : "plain");
  return text;
}

/// Pressed within 0.5 s, held for 1.5 s.
json press(double rate_Hz, double stiffness_N_per_m, double pressed_N, bool passivity, bool trace) {
  RigOptions options;
  options.rate_Hz = rate_Hz;
  options.tissue.stiffness_N_per_m = stiffness_N_per_m;
  options.pressed_N = pressed_N;
  options.passivity = passivity;
  Rig rig(options);
  json points = json::array();
  for (int i = 1; i <= 400; ++i) {
    rig.run_until(0.00375 * i);
    if (trace) {
      points.push_back(
          {0.00375 * i, (kRigSheet_m - rig.device_->truth().T_device_plate.p_m.z()) * 1e3});
    }
  }
  const double residual_m = rig.run_until(2);
  json row = {{"id", id_of(rate_Hz, stiffness_N_per_m, passivity)},
              {"rate_Hz", rate_Hz},
              {"stiffness_N_per_m", stiffness_N_per_m},
              {"pressed_N", pressed_N},
              {"passivity_controller", passivity},
              {"residual_oscillation_mm", residual_m * 1e3},
              {"largest_force_N", rig.largest_N_},
              {"damping_added_max_N_s_per_m", rig.damping_max_},
              {"device_damping_N_s_per_m", rig.damping()},
              {"needed_damping_K_T_over_2_N_s_per_m", stiffness_N_per_m / rate_Hz / 2},
              {"energy_released_max_mJ", rig.state_.passivity.released_max_J * 1e3},
              {"fault", to_string(rig.state_.safety.fault)}};
  if (trace) row["depth_mm_at_s"] = std::move(points);
  return row;
}

/// The energy from the motors after the puncture, and over a whole press and lift.
json release(double rate_Hz, bool passivity) {
  RigOptions options;
  options.rate_Hz = rate_Hz;
  options.passivity = passivity;
  options.tissue.threshold_N = 35;
  options.pressed_N = 40;
  Rig broken(options);
  double at_release_J = 0;
  for (int i = 0; i < 0.8 * rate_Hz; ++i) {
    if (broken.tick().contact.punctured_now) at_release_J = broken.device_->truth().work.motors_J;
  }
  const double by_puncture_J = broken.device_->truth().work.motors_J - at_release_J;
  options.tissue.threshold_N = 1e6;
  options.pressed_N = 30;
  options.lifted_at_s = 1;
  Rig lifted(options);
  lifted.run_until(2);
  return {{"id", id_of(rate_Hz, 5000, passivity)},
          {"rate_Hz", rate_Hz},
          {"passivity_controller", passivity},
          {"given_after_puncture_mJ", by_puncture_J * 1e3},
          {"taken_before_puncture_mJ", -at_release_J * 1e3},
          {"given_by_press_and_lift_mJ", lifted.device_->truth().work.motors_J * 1e3}};
}

/// True if an oscillation decays, pressed with 10 N.
bool is_stable(double rate_Hz, double stiffness_N_per_m, double damping_N_s_per_m, bool passivity,
               double& device_damping_N_s_per_m) {
  RigOptions options;
  options.rate_Hz = rate_Hz;
  options.tissue.stiffness_N_per_m = stiffness_N_per_m;
  options.tissue.damping_N_s_per_m = damping_N_s_per_m;
  options.pressed_N = 10;
  options.going_down_s = 0.3;
  options.passivity = passivity;
  Rig rig(options);
  rig.run_until(0.6);
  const double before_m = rig.run_until(0.8);
  rig.run_until(1);
  const double after_m = rig.run_until(1.2);
  device_damping_N_s_per_m = rig.damping();
  if (rig.state_.safety.fault != Fault::kNone || rig.result_.contact.force_N <= 0) return false;
  return after_m < kSettled_m || after_m < 0.95 * before_m;
}

/// The largest stable stiffness between 100 N/m and 1 MN/m, by bisection of its logarithm.
json region(double rate_Hz, double damping_N_s_per_m, bool passivity, int bisections) {
  double low = std::log(100.0), high = std::log(1e6), device_damping = 0, at_pose = 0;
  for (int i = 0; i < bisections; ++i) {
    const double middle = (low + high) / 2;
    const bool stable = is_stable(rate_Hz, std::exp(middle), damping_N_s_per_m, passivity, at_pose);
    if (stable) device_damping = at_pose;
    (stable ? low : high) = middle;
  }
  char text[80];
  std::snprintf(text, sizeof text, "%.0f Hz B %g %s", rate_Hz, damping_N_s_per_m,
                passivity ? "controlled" : "plain");
  return {{"id", text},
          {"rate_Hz", rate_Hz},
          {"wall_damping_N_s_per_m", damping_N_s_per_m},
          {"passivity_controller", passivity},
          {"largest_stable_stiffness_N_per_m", std::exp(low)},
          {"device_damping_N_s_per_m", device_damping},
          {"bound_stiffness_N_per_m",
           std::max(0.0, 2 * rate_Hz * (device_damping - damping_N_s_per_m))}};
}

json measure(const json& plan) {
  json answer = {{"walls", json::array()}, {"releases", json::array()}, {"region", json::array()}};
  for (const json& wall : plan.at("walls")) {
    for (const bool passivity : {false, true}) {
      answer["walls"].push_back(press(wall.at("rate_Hz"), wall.at("stiffness_N_per_m"),
                                      wall.at("pressed_N"), passivity, plan.at("traces")));
    }
  }
  for (const double rate_Hz : plan.at("rates_Hz").get<std::vector<double>>()) {
    for (const bool passivity : {false, true}) {
      answer["releases"].push_back(release(rate_Hz, passivity));
      for (const double damping :
           plan.at("region").at("damping_N_s_per_m").get<std::vector<double>>()) {
        answer["region"].push_back(
            region(rate_Hz, damping, passivity, plan.at("region").at("bisections")));
      }
    }
  }
  return answer;
}

}  // namespace
}  // namespace trocar::test

int main() {
  return trocar::test::sweep_main("loop_sweep", trocar::test::measure);
}
