// SPDX-License-Identifier: Apache-2.0
#include "runtime/check/device_trial.h"

#include "formats/base/text.h"
#include "runtime/session/pose_session.h"

namespace trocar::runtime {
namespace {

/// Stiffness of contact with cancellous bone, at which noise of the pose is stated as a force.
constexpr double kContact_N_per_m = 10'000;
/// Noise of the force at this stiffness that a hand feels as roughness.
constexpr double kRough_N = 0.2;
constexpr double kLostShare = 0.005;

/// A device that measures joint angles; another one measures a pose, of which the first three
/// values are a position.
bool has_encoders(const DeviceSpecification& specification) {
  return !specification.motors_and_joints().joint_limits_rad.empty();
}

/// Measures tick by tick, on the haptic thread.
class TrialLoop {
 public:
  TrialLoop(HandDevice& device, const SessionOptions& options, double push_N)
      : device_(device),
        push_N_(push_N),
        push_(push_N, 1 / options.rate_Hz),
        period_s_(1 / options.rate_Hz),
        ticks_(static_cast<std::uint64_t>(std::llround(options.duration_s * options.rate_Hz))) {}

  bool tick(const TickTiming& timing) noexcept {
    if (is_complete()) return false;
    late_.begin(timing, period_s_ * 1e9);
    const std::int64_t begin_ns = monotonic_ns();
    is_late_ = is_late_ || timing.missed_in_row > 0;
    double t_s = last_t_s_;
    const DeviceStatus status = device_.read(t_s);
    if (status == DeviceStatus::kOk && (!has_reading_ || t_s > last_t_s_)) {
      take(t_s, begin_ns);
    } else {
      device_.use_last_reading();
      if (status != DeviceStatus::kOk && status != DeviceStatus::kNoData) ++out.lost_ticks;
    }
    if (out.ticks < ticks_)
      device_.write_zero();
    else
      push();
    ++out.ticks;
    late_.spend(TickPart::kDevice, monotonic_ns() - begin_ns);
    device_.advance(period_s_);
    return true;
  }

  bool is_complete() const noexcept {
    return out.ticks >= ticks_ && (!(push_N_ > 0) || push_.is_done() || has_failed_);
  }

  DeviceTrial finish(RealtimeReport realtime) {
    out.realtime = std::move(realtime);
    out.late_ticks = late_.counts();
    for (const NoiseMeter& meter : values_)
      out.value_noise = std::max(out.value_noise, meter.deviation());
    for (const NoiseMeter& meter : position_)
      out.position_noise_m = std::max(out.position_noise_m, meter.deviation());
    if (out.was_pushed && !has_failed_) out.response = fit_response(push_.samples());
    return std::move(out);
  }

  DeviceTrial out;

 private:
  /// Gives the force of this tick to the device; none after any fault, or while no reading comes.
  void push() noexcept {
    constexpr double kLongestSilence_s = 0.01;
    silent_s_ += period_s_;
    has_failed_ = has_failed_ || out.fault != Fault::kNone || out.lost_ticks > 0 ||
                  !out.last_T_device_plate || silent_s_ > kLongestSilence_s + 1.5 * period_s_ ||
                  device_.check_own_workspace() != Fault::kNone;
    RenderInput input;
    if (!has_failed_) {
      out.was_pushed = true;
      input.wanted[0] = push_.take(out.last_T_device_plate->p_m.x());
    }
    input.dt_s = period_s_;
    double scale = 0;
    has_failed_ = has_failed_ || device_.render(input, scale) != Fault::kNone;
    if (has_failed_)
      device_.write_zero();
    else
      has_failed_ = device_.write() != DeviceStatus::kOk;
  }

  void take(double t_s, std::int64_t now_ns) noexcept {
    ++out.readings;
    PlatePose pose;
    const double since_s = has_reading_ ? t_s - last_t_s_ : period_s_;
    const FaultDetail found = device_.find_pose({has_reading_, since_s}, pose);
    if (found != Fault::kNone && out.fault == Fault::kNone) {
      out.fault = found;
      out.fault_t_s = static_cast<double>(out.ticks) * period_s_;
    }
    if (has_reading_) {
      out.state_interval.add(std::llround(since_s * 1e9));
      // A time in which the loop itself came late says nothing about the device.
      if (!is_late_) out.without_state.add(now_ns - last_ns_);
    }
    silent_s_ = 0;
    note_values(device_.measured());
    if (found == Fault::kNone) {
      out.last_T_device_plate = pose.T_device_plate;
      if (out.ticks < ticks_)
        for (std::size_t i = 0; i < position_.size(); ++i)
          position_[i].add(pose.T_device_plate.p_m[static_cast<Eigen::Index>(i)]);
    }
    if (!device_.keep_reading()) return;
    has_reading_ = true;
    is_late_ = false;
    last_t_s_ = t_s;
    last_ns_ = now_ns;
  }

  void note_values(const Measurement& now) noexcept {
    for (std::size_t i = 0; i < static_cast<std::size_t>(now.count); ++i) {
      const double value = now.value.at(i);
      if (!std::isfinite(value)) continue;
      if (out.ticks < ticks_) values_.at(i).add(value);
      const double step = has_reading_ ? std::abs(value - last_.value.at(i)) : 0;
      const bool counts = i < 3 || has_encoders(device_.specification());  // no quaternion
      if (counts && step > 0 && (out.smallest_step == 0 || step < out.smallest_step))
        out.smallest_step = step;
    }
    last_ = now;
  }

  HandDevice& device_;
  double push_N_;
  ResponsePush push_;
  bool has_failed_ = false;
  double silent_s_ = 0;
  double period_s_;
  std::uint64_t ticks_;
  LateTicks late_;
  std::array<NoiseMeter, kMaxMeasured> values_;
  std::array<NoiseMeter, 3> position_;
  Measurement last_;
  bool has_reading_ = false, is_late_ = false;
  double last_t_s_ = 0;
  std::int64_t last_ns_ = 0;
};

std::string times(const char* name, const Histogram& histogram) {
  if (histogram.samples() == 0) return text_line("%-16s none\n", name);
  return text_line("%-16s median %.3f ms, 99 %% within %.3f ms, most %.3f ms\n", name,
                   histogram.quantile_us(0.5) * 1e-3, histogram.quantile_us(0.99) * 1e-3,
                   histogram.max_us() * 1e-3);
}

/// Share of the states that the device link lost; 0 without packets.
double lost_share(const DeviceTrial& trial) noexcept {
  if (!trial.link || !trial.link->packets) return 0;
  const auto& [counts, missed] = *trial.link->packets;
  const double all = static_cast<double>(missed + counts.accepted());
  return all > 0 ? static_cast<double>(missed) / all : 0;
}

/// Angle between the plate's z axis and the scene's.
double tilt_rad(const Pose& T_device_plate) noexcept {
  const Eigen::Vector3d z = T_device_plate.q * Eigen::Vector3d::UnitZ();
  return std::atan2(z.head<2>().norm(), z.z());
}

/// The plate's position in the scene's axes, from the middle of the workspace if the device states one, and its tilt.
std::string describe_pose(const Pose& T_device_plate, const DeviceSpecification& specification) {
  Eigen::Vector3d at_m = T_device_plate.p_m;
  const std::optional<WorkspaceBox> box = specification.workspace();
  if (box) at_m -= (Eigen::Vector3d(box->min_m.data()) + Eigen::Vector3d(box->max_m.data())) / 2;
  return text_line("%-16s x %+.1f, y %+.1f, z %+.1f mm from %s, tilted by %.1f deg\n", "at the end",
                   at_m.x() * 1e3, at_m.y() * 1e3, at_m.z() * 1e3,
                   box ? "the middle of the workspace" : "the device's origin",
                   tilt_rad(T_device_plate) * kDegreesPerRadian);
}

/// Adds what would end a session at this pose in its first tick.
void add_pose_troubles(const Pose& T_device_plate, const DeviceSpecification& specification,
                       std::vector<std::string>& troubles) {
  if (const std::optional<WorkspaceBox> box = specification.workspace()) {
    const std::size_t before = troubles.size();
    for (std::size_t i = 0; i < 3; ++i) {
      const double at_m = T_device_plate.p_m[static_cast<Eigen::Index>(i)];
      const double middle_m = (box->min_m[i] + box->max_m[i]) / 2;
      if (at_m >= box->min_m[i] && at_m <= box->max_m[i]) continue;
      troubles.push_back(
          text_line("the handle is outside its workspace, at %c %+.1f mm from the middle, which is "
                    "reachable from %+.1f to %+.1f mm; a session would end at once (workspace): "
                    "compare workspace_min_m and workspace_max_m with what the device states, in m",
                    "xyz"[i], (at_m - middle_m) * 1e3, (box->min_m[i] - middle_m) * 1e3,
                    (box->max_m[i] - middle_m) * 1e3));
    }
    // The box of a turned device is smaller than the one around it, which was compared above.
    if (troubles.size() == before && specification.margins(T_device_plate).box_m < 0)
      troubles.push_back(specification.describe_fault(Fault::kWorkspace, T_device_plate) +
                         "; a session would end at once (workspace): compare workspace_min_m and "
                         "workspace_max_m with what the device states, in m");
  }
  const double tilt = tilt_rad(T_device_plate), most = SafetyLimits{}.plate_tilt_max_rad;
  if (tilt > most)
    troubles.push_back(
        text_line("the handle is tilted by %.1f deg, and more than %.1f deg end a session "
                  "(workspace): hold it upright; of a pose device, check turn_deg and that "
                  "quaternions have w "
                  "first",
                  tilt * kDegreesPerRadian, most * kDegreesPerRadian));
}

const char* noise_key(const DeviceSpecification& specification) {
  return has_encoders(specification) ? "encoder_noise_rad" : "position_noise_m";
}
double noise_at_rest(const DeviceTrial& trial, const DeviceSpecification& specification) {
  return has_encoders(specification) ? trial.value_noise : trial.position_noise_m;
}

std::string describe_numbers(const DeviceTrial& trial, const SessionOptions& options,
                             const DeviceSpecification& specification) {
  std::string out =
      text_line("%-16s %.6g Hz for %.3g s: %llu ticks, a new state in %llu of them\n", "rate",
                options.rate_Hz, static_cast<double>(trial.ticks) / options.rate_Hz,
                static_cast<unsigned long long>(trial.ticks),
                static_cast<unsigned long long>(trial.readings));
  out += times("between states", trial.state_interval);
  if (trial.link) {
    out += times("round trip", trial.link->round_trip);
    trial.link->round_trip.each_quarter_octave([&](double upper_us, std::uint64_t count) {
      out += text_line("%16s up to %9.3f ms: %llu\n", "", upper_us * 1e-3,
                       static_cast<unsigned long long>(count));
    });
    if (const auto& packets = trial.link->packets)
      out += text_line("%-16s %llu states lost (%.2f %%), %llu packets refused\n", "link",
                       static_cast<unsigned long long>(packets->states_missed),
                       100 * lost_share(trial),
                       static_cast<unsigned long long>(packets->counts.refused()));
  }
  out += times("waking late", trial.realtime.wake);
  out += text_line("%-16s %llu, at most %d in a row\n", "missed deadlines",
                   static_cast<unsigned long long>(trial.realtime.missed_deadlines),
                   trial.realtime.missed_in_row_max);
  out += text_line("%-16s %.3g in the measured values' unit, %.3g mm in the plate's position\n",
                   "noise at rest", trial.value_noise, trial.position_noise_m * 1e3);
  if (trial.last_T_device_plate) out += describe_pose(*trial.last_T_device_plate, specification);
  const DeviceReadings stated = specification.readings();
  out += text_line("%-16s %.3g um%s, smallest step seen %.3g in the measured values' unit\n",
                   "resolution", 1e6 * stated.resolution_m,
                   stated.is_assumed ? " assumed" : " as stated", trial.smallest_step);
  // Lines for a description.
  out += text_line("%-16s \"%s\": %.2g", "measured", noise_key(specification),
                   noise_at_rest(trial, specification));
  if (trial.smallest_step > 0)
    out += has_encoders(specification)
               ? text_line(", \"encoder_counts_per_revolution\": %.0f",
                           2 * std::numbers::pi / trial.smallest_step)
               : text_line(", \"position_resolution_m\": %.2g", trial.smallest_step);
  out += '\n';
  if (!trial.response) return out;
  const DeviceResponse& r = *trial.response;
  out += text_line("%-16s \"delay_s\": %.2g", "", r.delay_s);
  const char* const format =
      has_encoders(specification)
          ? "; at the plate mass %.3g kg, friction %.3g N s/m and %.2g N"
          : ", \"mass_kg\": %.3g, \"damping_N_s_per_m\": %.3g, \"coulomb_friction_N\": %.2g";
  out += text_line(format, r.mass_kg, r.damping_N_s_per_m, r.coulomb_N);
  return out + text_line(" (fitted to %.2g um)\n", 1e6 * r.misfit_m);
}

/// Readings that are rounded tremble by up to a step.
bool understates_noise(const DeviceTrial& trial, const DeviceSpecification& specification) {
  constexpr double kMuch = 1.5;
  const DeviceReadings stated = specification.readings();
  return trial.position_noise_m > kMuch * stated.noise_m + stated.resolution_m;
}

/// Adds what the description understates.
void add_description_troubles(const DeviceTrial& trial, const SessionOptions& options,
                              const DeviceSpecification& specification,
                              std::vector<std::string>& troubles) {
  const DeviceReadings stated = specification.readings();
  constexpr double kTolerance_ticks = 0.3;
  if (trial.was_pushed && !trial.response)
    troubles.emplace_back(
        "the device did not answer the push as a free mass with friction: let go of the handle, "
        "keep it off its stops, or push with more force");
  if (trial.response &&
      trial.response->delay_s > stated.delay_s + kTolerance_ticks / options.rate_Hz)
    troubles.push_back(text_line(
        "the device answers a force after %.2f ms, and its description has %.2f ms: a stiff "
        "contact would oscillate; state \"delay_s\": %.4f",
        1e3 * trial.response->delay_s, 1e3 * stated.delay_s, trial.response->delay_s));
  if (understates_noise(trial, specification))
    troubles.push_back(text_line(
        "the position trembles by %.3g um at rest, and the description has %.3g um: state \"%s\": "
        "%.2g",
        1e6 * trial.position_noise_m, 1e6 * stated.noise_m, noise_key(specification),
        noise_at_rest(trial, specification)));
}

void add_time_troubles(const DeviceTrial& trial, const SessionOptions& options,
                       std::vector<std::string>& troubles) {
  const double period_ms = 1e3 / options.rate_Hz;
  const double no_data_ms = 1e3 * no_data_limit_s(options.limits.no_data_max_s, options.rate_Hz);
  if (trial.realtime.missed_in_row_max > options.limits.missed_deadlines_max) {
    troubles.push_back(
        text_line("this machine came up to %d ticks late in a row (longest waking %.1f ms), and "
                  "%d end a session (deadline_missed): give "
                  "the program realtime priority, end other programs, or lower --rate",
                  trial.realtime.missed_in_row_max, trial.realtime.wake.max_us() * 1e-3,
                  options.limits.missed_deadlines_max + 1));
  }
  const double interval_ms = trial.state_interval.quantile_us(0.5) * 1e-3;
  if (interval_ms > 1.5 * period_ms) {
    troubles.push_back(
        text_line("the device states its pose only %.4g times a second: at %.6g Hz the force stays "
                  "the same for %.0f ticks; let "
                  "the device send more often, or choose --rate %.4g",
                  1e3 / interval_ms, options.rate_Hz, interval_ms / period_ms,
                  std::max(100.0, 1e3 / interval_ms)));
  }
  const double silent_ms = trial.without_state.max_us() * 1e-3;
  const double usual_ms = std::max(interval_ms, period_ms);
  if (silent_ms >= no_data_ms + period_ms / 2) {
    troubles.push_back(
        text_line("the device was silent for up to %.1f ms, and %.0f ms without a state end a "
                  "session (no_data): look for what "
                  "holds up the device's process or the link",
                  silent_ms, no_data_ms));
  } else if (silent_ms > 2.5 * usual_ms) {
    troubles.push_back(
        text_line("the device was silent for up to %.1f ms, %.0f times as long as usual: forces "
                  "jump after that; look for what "
                  "holds up the device's process or the link",
                  silent_ms, silent_ms / usual_ms));
  }
  if (trial.link && trial.link->round_trip.samples() > 0) {
    const double trip_ms = trial.link->round_trip.quantile_us(0.99) * 1e-3;
    if (trip_ms > SafetyLimits{}.no_data_max_s * 1e3 / 2)
      troubles.push_back(
          text_line("a command is answered after %.1f ms (99 %% of all): walls feel soft or "
                    "tremble; use a direct cable, or lower "
                    "--stiffness-limit",
                    trip_ms));
  }
}

}  // namespace

double NoiseMeter::deviation() const noexcept {
  return count_ > 2 ? std::sqrt(sum_ / static_cast<double>(count_ - 2) / 6) : 0;
}

Result<DeviceTrial> try_device(HandDevice& device, const SessionOptions& options, double push_N) {
  if (Result<void> started = device.start(); !started) return started.error();
  const auto loop = std::make_unique<TrialLoop>(device, options, push_N);
  RealtimeReport report = run_realtime(
      options.realtime(), [&loop](const TickTiming& timing) { return loop->tick(timing); },
      [&device] { device.write_zero(); });
  const bool is_complete = loop->is_complete();
  DeviceTrial trial = loop->finish(std::move(report));
  device.close();
  if (!is_complete)
    return Error{ExitCode::kDeviceFault, "interrupted: the device was not tested to the end"};
  trial.link = device.link_report();
  return trial;
}

DeviceVerdict describe(const DeviceTrial& trial, const SessionOptions& options,
                       const DeviceSpecification& specification) {
  DeviceVerdict verdict;
  verdict.text = describe_numbers(trial, options, specification);
  std::vector<std::string>& troubles = verdict.troubles;
  if (trial.readings == 0) {
    troubles.emplace_back("the device sent no state");
    return verdict;
  }
  if (trial.fault != Fault::kNone)
    troubles.push_back("the device's own checks found a fault: " +
                       trocar::describe(trial.fault, trial.fault_t_s));
  if (trial.lost_ticks > 0)
    troubles.push_back(text_line("the link was lost, or the device reported a fault, in %llu ticks",
                                 static_cast<unsigned long long>(trial.lost_ticks)));
  add_time_troubles(trial, options, troubles);
  add_description_troubles(trial, options, specification, troubles);
  if (lost_share(trial) > kLostShare)
    troubles.push_back(
        text_line("%.1f %% of the device's states were lost on the way: use a direct cable, or end "
                  "what else uses the network",
                  100 * lost_share(trial)));
  if (trial.last_T_device_plate)
    add_pose_troubles(*trial.last_T_device_plate, specification, troubles);
  const double rough_N = trial.position_noise_m * kContact_N_per_m;
  if (rough_N > kRough_N && !understates_noise(trial, specification))
    troubles.push_back(
        text_line("the pose trembles by %.3g mm at rest, which is %.2g N at a contact of %.0f "
                  "kN/m: shield the encoders' cables, "
                  "or lower --stiffness-limit",
                  trial.position_noise_m * 1e3, rough_N, kContact_N_per_m * 1e-3));
  return verdict;
}

}  // namespace trocar::runtime
