// SPDX-License-Identifier: Apache-2.0
// Speed against error of the cutting law, and the table of published forces. In: a plan as JSON on stdin;
// out: JSON.
//
// Plan: {"slabs": [..], "reference_slabs": n, "most_steps": [..], "ticks": n, "repetitions": n,
//        "stability": {"sessions": n, "damping": [shares of K T / 2], "ratio": [K T^2 / M, ..]}}
//
// The program is built twice: cutting_sweep with the law's two Gauss points a slab, and
// cutting_sweep_midpoint with one.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "runtime/bone_cutting/material/slabs.h"
#include "tests/bench/published_forces.h"
#include "tests/bench/sweep_main.h"
#include "tests/support/body_slabs.h"

namespace trocar::test {
namespace {

using namespace trocar::runtime;
using nlohmann::json;

// CuttingOptions::wall_points of this program.
#ifdef TROCAR_SWEEP_MIDPOINT
constexpr std::size_t kSweptWallPoints = 1;
#else
constexpr std::size_t kSweptWallPoints = kMaxWallPoints;
#endif

constexpr double kBody_m = 0.032, kLength_m = 0.1, kIn_m = 0.025;
// The reference uses these options, with which a tick has converged.
constexpr int kReferenceSteps = 200;
constexpr double kReferenceTolerance = 1e-10;

// A hand that holds a point: the walls alone keep the tool from turning about it.
CuttingOptions guided_options() {
  CuttingOptions o;
  o.wall_points = kSweptWallPoints;
  o.tool.tip_plate_m = {0, 0, -kLength_m};
  o.tool.radius_m = 1.5e-3;
  o.coupling.translation_N_per_m = 2e5;
  o.coupling.rotation_Nm_per_rad = 0.2;
  return o;
}
CuttingOptions options() {
  CuttingOptions o;
  o.wall_points = kSweptWallPoints;
  o.tool.tip_plate_m = {0, 0, -kLength_m};
  o.tool.radius_m = 1.5e-3;
  return o;
}

// 32 mm of cancellous bone whose density varies by a share over 12 mm.
constexpr double kTexture = 0.2;
std::vector<CuttingSlab> body(int count, double texture = kTexture) {
  std::vector<BodySlice> slices(static_cast<std::size_t>(count));
  const double spacing = kBody_m / count;
  for (int i = 0; i < count; ++i) {
    BodySlice& s = slices[static_cast<std::size_t>(i)];
    s.depth_m = (i + 0.5) * spacing;
    // The slice's value is the mean of its slab.
    const double k = 2 * std::numbers::pi / 0.012, half = 0.5 * k * spacing;
    s.strength_N = 20 * (1 + texture * std::sin(k * s.depth_m) * std::sin(half) / half);
    s.friction_N_per_m = 300;
    s.wall_N_per_m2 = 5e6;
    s.wall_strength_N_per_m = 2e4;
  }
  return make_slabs(slices, {}, 0);
}

// Down its own axis, then swayed in its hole below the strength of the walls.
Pose guided(int tick, int ticks) {
  const int half = ticks / 2;
  Pose X;
  const double in = std::min(1.0, static_cast<double>(tick) / half) * (kIn_m + 0.002) - 0.002;
  const double t = std::max(0, tick - half) / static_cast<double>(half);
  X.q = from_rotation_vector({0, 0.02, 0});
  X.p_m = X.q * Eigen::Vector3d(0, 0, kLength_m - in);
  X.p_m.x() += 3e-4 * std::sin(12 * t);
  X.p_m.y() += 2e-4 * std::sin(9 * t);
  return X;
}

// Pushed, dragged sideways and turned, so that walls yield.
Pose dragged(int tick, int ticks) {
  const double t = 3.0 * tick / ticks, depth = 0.022 + 0.002 * t;
  Pose X;
  X.p_m = {0.002 * std::sin(3 * t), 0.001 * std::sin(2 * t), kLength_m - depth};
  X.q = from_rotation_vector({0.02 * std::sin(t), 0.01, 0.1 * std::sin(5 * t)});
  return X;
}

class Times {
 public:
  // The least of the repetitions from one state, so that interrupts do not show.
  void tick(const CuttingOptions& o, const Pose& X, const std::vector<CuttingSlab>& slabs,
            CuttingState& state, CuttingResult& out, int repetitions) {
    const CuttingState before = state;
    double least = 1e9;
    for (int k = 0; k < repetitions; ++k) {
      state = before;
      const auto start = std::chrono::steady_clock::now();
      cutting_tick(o, X, slabs, state, out);
      const std::chrono::duration<double, std::micro> took =
          std::chrono::steady_clock::now() - start;
      least = std::min(least, took.count());
    }
    us_.push_back(least);
  }
  double at(double share) {
    std::sort(us_.begin(), us_.end());
    return us_[static_cast<std::size_t>(share * static_cast<double>(us_.size() - 1))];
  }

 private:
  std::vector<double> us_;
};

struct Errors {
  double sum2 = 0, worst = 0, peak = 0;
  double side2 = 0, side_peak = 0;  // across the shaft, which stands all but upright
  int count = 0;
  void add(const Wrench& a, const Wrench& reference) {
    const Eigen::Vector3d error = (a - reference).head<3>();
    sum2 += error.squaredNorm();
    side2 += error.head<2>().squaredNorm();
    worst = std::max(worst, error.norm());
    peak = std::max(peak, reference.head<3>().norm());
    side_peak = std::max(side_peak, reference.head<2>().norm());
    ++count;
  }
  double rms() const { return std::sqrt(sum2 / std::max(count, 1)) / peak; }
  double side_rms() const { return std::sqrt(side2 / std::max(count, 1)) / side_peak; }
};

json row(const std::string& setting, int value, Times& times, const Errors& errors) {
  return {{"id", setting + " " + std::to_string(value) + ", " + std::to_string(kSweptWallPoints) +
                     " points"},
          {"setting", setting},
          {"value", value},
          {"points_a_slab", kSweptWallPoints},
          {"p50_us", times.at(0.5)},
          {"p999_us", times.at(0.999)},
          {"error_rms", errors.rms()},
          {"side_error_rms", errors.side_rms()},
          {"error_max", errors.worst / errors.peak}};
}

// The whole run with fewer slabs against the run with the finest.
json by_slabs(const json& plan) {
  const int ticks = plan.at("ticks"), repetitions = plan.at("repetitions");
  const auto run = [&](int count, double texture, Times* times, const CuttingOptions& o) {
    const auto slabs = body(count, texture);
    CuttingState state = make_cutting_state(slabs.size(), 1);
    CuttingResult out;
    std::vector<Wrench> wrenches;
    for (int k = 0; k < ticks; ++k) {
      if (times == nullptr)
        cutting_tick(o, guided(k, ticks), slabs, state, out);
      else
        times->tick(o, guided(k, ticks), slabs, state, out, repetitions);
      wrenches.push_back(out.wrench_device);
    }
    return wrenches;
  };
  CuttingOptions exact = guided_options();
  exact.max_steps = kReferenceSteps;
  exact.tolerance = kReferenceTolerance;
  // Bone without texture tells the walls' part: the force across the shaft.
  const int finest = plan.at("reference_slabs");
  const auto reference = run(finest, kTexture, nullptr, exact),
             reference_even = run(finest, 0, nullptr, exact);
  json rows = json::array();
  for (const int count : plan.at("slabs").get<std::vector<int>>()) {
    Times times;
    Errors errors, even;
    const auto wrenches = run(count, kTexture, &times, guided_options()),
               wrenches_even = run(count, 0, nullptr, guided_options());
    for (std::size_t k = 0; k < wrenches.size(); ++k) {
      errors.add(wrenches[k], reference[k]);
      even.add(wrenches_even[k], reference_even[k]);
    }
    rows.push_back(row("slabs", count, times, errors));
    rows.back()["side_error_rms"] = even.side_rms();
  }
  return rows;
}

// Each tick against a converged one from the same state: over a run, errors of one tick would grow,
// as a tool that is pushed along a path is not stable sideways.
json by_steps(const json& plan) {
  const int ticks = plan.at("ticks"), repetitions = plan.at("repetitions");
  const auto slabs = body(64);
  json rows = json::array();
  for (const int cap : plan.at("most_steps").get<std::vector<int>>()) {
    CuttingOptions o = options(), exact = options();
    o.max_steps = cap;
    exact.max_steps = kReferenceSteps;
    exact.tolerance = kReferenceTolerance;
    CuttingState state = make_cutting_state(slabs.size(), 1);
    CuttingResult out;
    Pose X = dragged(0, ticks);
    const double deep = X.p_m.z();
    for (int k = 0; k <= 600; ++k) {
      X.p_m.z() = deep + 0.024 * (1 - k / 600.0);
      cutting_tick(exact, X, slabs, state, out);
    }
    Times times;
    Errors errors;
    for (int k = 0; k < ticks; ++k) {
      CuttingState tried = state;
      times.tick(o, dragged(k, ticks), slabs, tried, out, repetitions);
      const Wrench wrench = out.wrench_device;
      cutting_tick(exact, dragged(k, ticks), slabs, state, out);
      errors.add(wrench, out.wrench_device);
    }
    rows.push_back(row("Newton steps", cap, times, errors));
  }
  return rows;
}

// A mass on a spring that a simulated hand moves up and down in a body, by the coupling alone.
struct HandSession {
  double damping_share = 0;  // of K T / 2
  double ratio = 0.1;        // K T^2 / M
  double ahead = 0;          // ticks by which the pose is predicted
};

// The most energy that the tissue has given to the hand beyond what the device's damping took (J).
double most_given_J(const HandSession& session, std::mt19937& random) {
  const auto uniform = [&](double a, double b) {
    return std::uniform_real_distribution<double>(a, b)(random);
  };
  constexpr double kTick_s = 1e-3, kSession_s = 0.6;
  constexpr int kSubsteps = 16;
  CuttingOptions o = options();
  o.coupling.translation_N_per_m = std::pow(10.0, uniform(3.3, 4.7));
  o.tip_N_per_m = std::pow(10.0, uniform(3.7, 6.3));
  auto slabs = body(32);
  const double scale = uniform(0.2, 2), friction = uniform(0, 300);
  for (CuttingSlab& slab : slabs) {
    slab.strength_top_N *= scale;
    slab.strength_bottom_N *= scale;
    slab.friction_N_per_m = friction;
  }
  const double K = o.coupling.translation_N_per_m, mass = K * kTick_s * kTick_s / session.ratio,
               damping = session.damping_share * K * kTick_s / 2,
               spring = mass * std::pow(2 * std::numbers::pi * uniform(1, 8), 2),
               depth = uniform(0.005, 0.03), pace = uniform(3, 30);
  CuttingState state = make_cutting_state(slabs.size(), 2);
  CuttingResult out;
  double z = kLength_m + 0.002, before = z, v = 0, given_J = 0, most_J = 0;
  for (int k = 0; k * kTick_s < kSession_s; ++k) {
    Pose X;
    X.p_m.z() = z + session.ahead * (z - before);
    before = z;
    cutting_tick(o, X, slabs, state, out);
    const double aim = kLength_m + 0.002 - depth * (1 - std::cos(pace * k * kTick_s)) / 2 - 0.002;
    for (int i = 0; i < kSubsteps; ++i) {
      const double dt = kTick_s / kSubsteps;
      v += dt * (out.wrench_device[2] + spring * (aim - z) - damping * v) / mass;
      z += dt * v;
      given_J += (out.wrench_device[2] - damping * v) * v * dt;
    }
    most_J = std::max(most_J, given_J);
  }
  return most_J;
}

// The worst of some sessions beside two bounds: damping of K T / 2, and for predicted poses
// K T^2 / M.
json stability(const json& plan) {
  json rows = json::array();
  const auto add = [&](const char* kind, double value, const HandSession& session) {
    std::mt19937 random(11);
    double worst_J = 0;
    for (int n = 0; n < plan.at("sessions").get<int>(); ++n)
      worst_J = std::max(worst_J, most_given_J(session, random));
    rows.push_back({{"kind", kind}, {"value", value}, {"given_J", worst_J}});
  };
  for (const double share : plan.at("damping").get<std::vector<double>>())
    add("damping", share, {.damping_share = share});
  for (const double ratio : plan.at("ratio").get<std::vector<double>>()) {
    add("predicted", ratio, {.ratio = ratio, .ahead = 1});
    add("held", ratio, {.ratio = ratio});
  }
  return rows;
}

json to_json(const std::map<std::string, Score>& scores) {
  json out = json::array();
  for (const auto& [name, score] : scores)
    out.push_back({{"name", name}, {"hits", score.hits}, {"rows", score.rows}});
  return out;
}

json table() {
  const auto rows = read_published_forces(TROCAR_PUBLISHED_FORCES);
  const WallPressure wall_pressure = fit(rows);
  std::vector<Prediction> predictions;
  predictions.reserve(rows.size());
  for (const PublishedForce& row : rows)
    predictions.push_back(predict(row, wall_pressure));
  const std::vector<double> left = leave_one_out(rows, predictions);
  json out = {{"wall_pressure", wall_pressure},
              {"rows", json::array()},
              {"by_mechanism", to_json(scores(rows, predictions, &PublishedForce::mechanism))},
              {"by_study", to_json(scores(rows, predictions, &PublishedForce::study))}};
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const PublishedForce& row = rows[i];
    const char* standing = row.standing == Standing::kFitted  ? "fitted"
                           : row.standing == Standing::kShown ? "not counted"
                                                              : "counted";
    out["rows"].push_back({{"id", row.id},
                           {"study", row.study},
                           {"mechanism", row.mechanism},
                           {"standing", standing},
                           {"is_hit", is_hit(row, predictions[i])},
                           {"unit", row.unit},
                           {"predicted_low", predictions[i].low},
                           {"predicted", predictions[i].median},
                           {"predicted_high", predictions[i].high},
                           {"published_low", row.low},
                           {"published_mean", row.mean},
                           {"published_high", row.high},
                           {"spread", row.spread},
                           {"left_one_out", std::isfinite(left[i]) ? json(left[i]) : json(nullptr)},
                           {"miss", row.miss},
                           {"tool", row.tool},
                           {"specimen", row.specimen},
                           {"assumed", row.assumed},
                           {"evidence", row.evidence},
                           {"source", row.source}});
  }
  return out;
}

json measure(const json& plan) {
  for (const char* key : {"ticks", "repetitions", "reference_slabs"})
    if (plan.at(key).get<int>() < 1) throw json::other_error::create(501, "a count below 1", &plan);
  json rows = by_slabs(plan);
  for (const json& each : by_steps(plan))
    rows.push_back(each);
  return {{"pareto", rows},
          {"published_forces", table()},
          {"stability", stability(plan.at("stability"))}};
}

}  // namespace
}  // namespace trocar::test

int main() {
  return trocar::test::sweep_main("cutting_sweep", trocar::test::measure);
}
