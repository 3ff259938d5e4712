// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/simulated/drive.h"

#include <charconv>

namespace trocar::runtime {
namespace {

// If no other packet overtakes a reordered packet, it is delivered after this time.
constexpr std::int64_t kMaxReorder_ns = 20'000'000;

struct Grammar {
  const char* name;
  FaultKind kind;
  int values;
  const char* form;
};
constexpr Grammar kGrammar[] = {
    {"loss", FaultKind::kLoss, 1, "loss:P with P within 0 and 1"},
    {"delay", FaultKind::kDelay, 2, "delay:P:MS with P within 0 and 1, MS within 0 and 10000"},
    {"duplicate", FaultKind::kDuplicate, 1, "duplicate:P with P within 0 and 1"},
    {"reorder", FaultKind::kReorder, 1, "reorder:P with P within 0 and 1"},
    {"flip", FaultKind::kFlip, 1, "flip:P with P within 0 and 1"},
    {"stuck", FaultKind::kStuck, 1, "stuck:ENCODER with a whole number within 0 and 15"},
    {"jump", FaultKind::kJump, 2,
     "jump:ENCODER:RAD with a whole number within 0 and 15, RAD within -100 and 100"},
    {"dead", FaultKind::kDead, 1, "dead:MOTOR with a whole number within 0 and 7"},
    {"stop", FaultKind::kStop, 0, "stop without a value"},
    {"kill", FaultKind::kKill, 0, "kill without a value"},
};
static_assert(kEncoders == 16 && kMotors == 8);  // the texts above contain these numbers

bool is_of_packets(FaultKind kind) noexcept {
  return kind <= FaultKind::kFlip;
}

std::optional<double> number_in(std::string_view text, double lowest, double highest) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  if (!(value >= lowest && value <= highest)) return std::nullopt;
  return value;
}

/// Cuts `text` at the first `mark`. Returns the part before it; `text` becomes the part after it.
std::string_view cut(std::string_view& text, std::string_view mark, bool& found) {
  const std::size_t at = text.find(mark);
  found = at != std::string_view::npos;
  const std::string_view before = text.substr(0, at);
  text = found ? text.substr(at + mark.size()) : std::string_view{};
  return before;
}

bool read_when(std::string_view text, PlannedFault& fault) {
  constexpr double kLongest_s = 1e6;
  bool ranged = false;
  const std::optional<double> from = number_in(cut(text, "..", ranged), 0, kLongest_s);
  if (!from) return false;
  fault.from_s = *from;
  if (!ranged) return true;
  const std::optional<double> to = number_in(text, *from, kLongest_s);
  if (to) fault.to_s = *to;
  return to.has_value();
}

bool read_values(const std::vector<std::string_view>& values, PlannedFault& fault) {
  const auto read = [&](std::size_t i, double lowest, double highest, auto& out) {
    const std::optional<double> value = number_in(values[i], lowest, highest);
    using Out = std::decay_t<decltype(out)>;
    if (!value || static_cast<double>(static_cast<Out>(*value)) != *value) return false;
    out = static_cast<Out>(*value);
    return true;
  };
  switch (fault.kind) {
    case FaultKind::kStop:
    case FaultKind::kKill:
      return true;
    case FaultKind::kStuck:
      return read(0, 0, kEncoders - 1, fault.channel);
    case FaultKind::kJump:
      return read(0, 0, kEncoders - 1, fault.channel) && read(1, -100, 100, fault.jump_rad);
    case FaultKind::kDead:
      return read(0, 0, kMotors - 1, fault.channel);
    case FaultKind::kDelay: {
      double delay_ms = 0;
      if (!read(1, 0, 1e4, delay_ms)) return false;
      fault.delay_s = delay_ms * 1e-3;
      return read(0, 0, 1, fault.probability);
    }
    default:
      return read(0, 0, 1, fault.probability);
  }
}

std::string quote(std::string_view item) {
  return "--faults \"" + std::string(item.substr(0, 80)) + "\": ";
}

Result<PlannedFault> read_item(std::string_view item) {
  PlannedFault fault;
  std::string_view rest = item;
  bool timed = false;
  std::string_view what = cut(rest, "@", timed);
  if (timed && !read_when(rest, fault))
    return usage(quote(item) + "@ must be followed by FROM or FROM..TO, in s, TO not before FROM");
  bool more = true;
  std::string_view name = cut(what, ":", more);
  std::vector<std::string_view> values;
  while (more)
    values.push_back(cut(what, ":", more));

  for (const auto& [prefix, commands] : {std::pair{"command-", true}, std::pair{"state-", false}}) {
    if (!name.starts_with(prefix)) continue;
    name.remove_prefix(std::string_view(prefix).size());
    fault.on_commands = commands;
    fault.on_states = !commands;
  }
  const auto* const known =
      std::find_if(std::begin(kGrammar), std::end(kGrammar),
                   [&](const Grammar& grammar) { return name == grammar.name; });
  if (known == std::end(kGrammar)) {
    return usage(quote(item) +
                 "must be one of loss, delay, duplicate, reorder, flip, stuck, "
                 "jump, dead, stop, kill");
  }
  fault.kind = known->kind;
  if (!is_of_packets(fault.kind) && !(fault.on_commands && fault.on_states))
    return usage(quote(item) + "command- and state- are for faults of packets only");
  if (static_cast<int>(values.size()) != known->values || !read_values(values, fault))
    return usage(quote(item) + "must be " + known->form);
  return fault;
}

/// Names of DriveMode, which counts from 1.
constexpr const char* kModeNames[] = {"ready", "torque", "watchdog", "emergency_stop"};

template <typename Number>
void put(std::string& out, Number value, char end) {
  std::array<char, 40> text;
  const auto [last, error] = std::to_chars(text.data(), text.data() + text.size(), value);
  out.append(text.data(), last);
  out += end;
}

// A motor is reported if its torque differs from its command by more than kFollows_Nm plus the
// fraction kFollowsFraction of the command for kFollows_s.
constexpr double kFollows_Nm = 0.1, kFollowsFraction = 0.1, kFollows_s = 5e-3;
// The hand's force must rise by at least this for a peak.
constexpr double kMinPeak_N = 10;

double seconds(std::int64_t ns) noexcept {
  return static_cast<double>(ns) * 1e-9;
}

}  // namespace

Result<FaultPlan> parse_fault_plan(std::string_view text) {
  FaultPlan plan;
  bool more = !text.empty();
  while (more) {
    const Result<PlannedFault> fault = read_item(cut(text, ",", more));
    if (!fault) return fault.error();
    plan.push_back(*fault);
  }
  return plan;
}

FaultyLink::FaultyLink(const FaultPlan& plan, LinkDirection way, std::uint64_t seed)
    : random_(seed), held_(kHeld) {
  for (const PlannedFault& fault : plan) {
    const bool this_way = way == LinkDirection::kCommands ? fault.on_commands : fault.on_states;
    if (is_of_packets(fault.kind) && this_way) plan_.push_back(fault);
  }
}

bool FaultyLink::happens(double probability) noexcept {
  return static_cast<double>(random_() >> 11) * 0x1p-53 < probability;
}

void FaultyLink::hold(const Datagram& datagram, std::int64_t due_ns,
                      bool until_overtaken) noexcept {
  if (held_count_ == held_.size()) return;
  held_[held_count_++] = {datagram, due_ns, until_overtaken};
}

int FaultyLink::decide(Datagram& datagram, double t_s, std::int64_t now_ns) noexcept {
  int copies = 1;
  for (const PlannedFault& fault : plan_) {
    if (!fault.is_on(t_s) || !happens(fault.probability)) continue;
    switch (fault.kind) {
      case FaultKind::kLoss:
        return 0;
      case FaultKind::kFlip:
        if (datagram.size > 0) {
          const std::uint64_t bit = random_() % (8 * datagram.size);
          datagram.bytes[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
        }
        break;
      case FaultKind::kDuplicate:
        ++copies;
        break;
      case FaultKind::kDelay:
        hold(datagram, now_ns + std::llround(fault.delay_s * 1e9), false);
        return 0;
      case FaultKind::kReorder:
        hold(datagram, now_ns + kMaxReorder_ns, true);
        return 0;
      default:
        break;
    }
  }
  return copies;
}

std::string to_csv(std::span<const DriveStep> steps) {
  std::string out =
      "session,t_s,mode,motor_faults,fault,command_taken,commanded_max_Nm,applied_max_Nm,"
      "packets_refused,tool_x_m,tool_y_m,tool_z_m,tool_x_m_per_s,tool_y_m_per_s,tool_z_m_per_s\n";
  for (const DriveStep& step : steps) {
    put(out, step.session, ',');
    put(out, step.t_s, ',');
    out += kModeNames[static_cast<std::size_t>(step.mode) - 1];
    out += ',';
    put(out, int{step.motor_faults}, ',');
    put(out, step.fault ? 1 : 0, ',');
    put(out, step.command_taken, ',');
    put(out, step.commanded_max_Nm, ',');
    put(out, step.applied_max_Nm, ',');
    put(out, step.packets_refused, ',');
    for (const double x : step.tip.at_m)
      put(out, x, ',');
    for (const double v : step.tip.velocity_m_per_s)
      put(out, v, ',');
    out.back() = '\n';
  }
  return out;
}

Drive::Drive(const DriveOptions& options, SimulatedDevice model)
    : options_(options), fresh_(std::move(model)), model_(fresh_) {
  report_.peaks.reserve(DriveReport::kMaxPeaks);
  report_.steps.reserve(options.record_steps);
}

bool Drive::is_alive(std::int64_t now_ns) const noexcept {
  if (!session_) return false;
  const double longest_s =
      options_.clock == LinkClock::kReal ? session_->watchdog_s : options_.session_s;
  return seconds(now_ns - session_->last_command_ns) <= longest_s;
}

bool Drive::is_injected(FaultKind kind) const noexcept {
  return std::any_of(options_.faults.begin(), options_.faults.end(),
                     [&](const PlannedFault& fault) {
                       return fault.kind == kind && fault.is_on(session_time_s());
                     });
}

LinkRefusal Drive::receive(std::span<const std::uint8_t> datagram, std::int64_t now_ns,
                           Answer& answer, bool& from_host) noexcept {
  answer.size = 0;
  from_host = false;
  LinkRefusal refusal = LinkRefusal::kSession;
  if (claimed_kind(datagram) == PacketKind::kCommand) {
    CommandPacket command;
    if (session_) {
      const std::uint64_t before = session_->last_command;
      refusal = decode(datagram, session_->key, session_->number, session_->last_command, command);
      if (refusal == LinkRefusal::kNone)
        report_.commands_missed += session_->last_command - before - 1;
    }
    if (refusal == LinkRefusal::kSession && !is_alive(now_ns)) {
      for (auto& offered : offers_) {
        if (!offered) continue;
        refusal = decode(datagram, offered->key, offered->number, offered->last_command, command);
        if (refusal == LinkRefusal::kNone) {
          begin(*offered);
          break;
        }
      }
    }
    from_host = refusal == LinkRefusal::kNone;
    if (from_host) take(command, now_ns, answer);
  } else {
    HelloPacket hello;
    refusal = decode(datagram, options_.key, hello);
    if (refusal == LinkRefusal::kNone && hello.contents != LinkContents::kAngles) {
      refusal = LinkRefusal::kContents;
      deny(datagram, DenialReason::kKind, now_ns, answer);
    }
    if (refusal == LinkRefusal::kNone && is_alive(now_ns)) refusal = LinkRefusal::kSession;
    if (refusal == LinkRefusal::kNone) offer(hello, now_ns, answer);
    if (refusal == LinkRefusal::kMac) deny(datagram, DenialReason::kKey, now_ns, answer);
    if (refusal == LinkRefusal::kSession) deny(datagram, DenialReason::kBusy, now_ns, answer);
  }
  report_.packets.add(refusal);
  return refusal;
}

/// A denial is smaller than a hello, and denials are rare, so that an attacker gains nothing by a
/// forged sender address.
void Drive::deny(std::span<const std::uint8_t> hello, DenialReason reason, std::int64_t now_ns,
                 Answer& answer) noexcept {
  DenialPacket denial;
  if (!hello_nonce(hello, denial.host_nonce)) return;
  // If several hosts keep sending hellos, each of them gets its denial.
  const bool again = denied_nonce_ == denial.host_nonce;
  const double pause_s = again ? kRepeatedDenial_s : kDenialPeriod_s;
  if (denied_ns_ && seconds(now_ns - *denied_ns_) < pause_s) return;
  denied_ns_ = now_ns;
  denied_nonce_ = denial.host_nonce;
  denial.time_ns = now_ns;
  denial.reason = reason;
  answer.size = encode(denial, answer.bytes);
}

void Drive::offer(const HelloPacket& hello, std::int64_t now_ns, Answer& answer) noexcept {
  // A repeated hello gets the same offer, because several answers may reach the host at once.
  auto* const known = std::find_if(offers_.begin(), offers_.end(), [&](const auto& offered) {
    return offered && offered->host_nonce == hello.host_nonce;
  });
  // Several offers are kept, because a replayed hello must not replace the offer to the true host.
  auto& offered = known != offers_.end() ? *known : offers_[next_offer_++ % kOffers];
  if (known == offers_.end()) {
    LinkSession made;
    made.host_nonce = hello.host_nonce;
    made.drive_nonce = random_nonce();
    made.key = session_key(options_.key, made.host_nonce, made.drive_nonce);
    made.number = session_number(made.drive_nonce);
    made.period_s = hello.period_s;
    made.watchdog_s = std::max(options_.watchdog_s, 2.5 * hello.period_s);
    made.resets_world = hello.resets_world;
    offered = made;
  }
  WelcomePacket welcome{.time_ns = now_ns,
                        .host_nonce = offered->host_nonce,
                        .drive_nonce = offered->drive_nonce,
                        .period_s = options_.period_s,
                        .clock = options_.clock};
  answer.size = encode(welcome, options_.key, answer.bytes);
}

/// `offered` is a copy, because this function clears the offers.
void Drive::begin(LinkSession offered) noexcept {
  session_ = offered;
  offers_.fill(std::nullopt);
  ++report_.sessions;
  if (offered.resets_world) {
    model_ = fresh_;
    stuck_at_rad_.fill(std::nullopt);
    peak_N_ = 0;
    falling_ = false;
    stop_is_unacknowledged_ = false;
  }
  mode_ = DriveMode::kReady;
  command_ = {};
  if (stop_is_unacknowledged_) zero_torques(DriveMode::kEmergencyStop);
  motor_faults_ = 0;
  not_following_s_.fill(0);
}

void Drive::end_session() noexcept {
  session_.reset();
  mode_ = DriveMode::kReady;
  command_ = {};
}

void Drive::take(const CommandPacket& command, std::int64_t now_ns, Answer& answer) noexcept {
  session_->last_command_ns = now_ns;
  if (command.mode == CommandMode::kStop) return end_session();
  check_emergency_stop();
  const auto& tau = command.tau_motor_Nm;  // these are zero unless the mode is torque
  const bool acknowledges =
      command.state_seen >= session_->reported_from &&
      std::all_of(tau.begin(), tau.end(), [](double each) { return each == 0; });
  if (!stop_pressed_ && acknowledges) {
    session_->reported_from = 0;
    stop_is_unacknowledged_ = false;
  }
  if (session_->reported_from == 0) {
    const bool torque = command.mode == CommandMode::kTorque;
    mode_ = torque ? DriveMode::kTorque : DriveMode::kReady;
    command_ = {};
    if (torque) command_.tau_motor_Nm = tau;
  } else {
    ++report_.stale_commands;
  }
  if (options_.clock != LinkClock::kLockStep) return;
  if (command.mode == CommandMode::kTorque) advance(session_->period_s);
  send_state(answer);
}

/// Sets torques to zero. They stay zero until the host acknowledges this (contract 1).
void Drive::zero_torques(DriveMode mode) noexcept {
  mode_ = mode;
  command_ = {};
  if (session_) session_->reported_from = session_->last_state + 1;
}

void Drive::tick(std::int64_t now_ns, int periods, Answer& answer) noexcept {
  answer.size = 0;
  catch_up(now_ns, periods);
  check_watchdog(now_ns);  // the watchdog is checked even if no period has passed
  if (session_) send_state(answer);
}

void Drive::catch_up(std::int64_t until_ns, int periods) noexcept {
  const auto period_ns = std::llround(options_.period_s * 1e9);
  for (int left = periods - 1; left >= 0; --left) {
    check_watchdog(until_ns - left * period_ns);
    // Simulated time starts with the first session.
    if (report_.sessions > 0) advance(options_.period_s);
  }
}

void Drive::check_watchdog(std::int64_t now_ns) noexcept {
  if (!session_) return;
  const double without_command_s = seconds(now_ns - session_->last_command_ns);
  if (without_command_s > options_.session_s) return end_session();
  if (without_command_s <= session_->watchdog_s || mode_ != DriveMode::kTorque) return;
  const auto& tau = command_.tau_motor_Nm;
  if (std::any_of(tau.begin(), tau.end(), [](double t) { return t != 0; }))
    ++report_.watchdog_trips;
  zero_torques(DriveMode::kWatchdog);
}

/// Applies the injected emergency stop. It is also reported to a session that begins while
/// it is pressed.
void Drive::check_emergency_stop() noexcept {
  const bool pressed = is_injected(FaultKind::kStop);
  if (pressed && !stop_pressed_) ++report_.emergency_stops;
  if (pressed && mode_ != DriveMode::kEmergencyStop) zero_torques(DriveMode::kEmergencyStop);
  stop_pressed_ = pressed;
  stop_is_unacknowledged_ |= pressed;
}

void Drive::advance(double dt_s) noexcept {
  check_emergency_stop();
  const bool fault = std::any_of(options_.faults.begin(), options_.faults.end(),
                                 [&](const PlannedFault& f) { return f.is_on(session_time_s()); });
  DeviceCommand applied = command_;
  for (const PlannedFault& f : options_.faults) {
    if (f.kind == FaultKind::kDead && f.is_on(session_time_s()))
      applied.tau_motor_Nm[static_cast<std::size_t>(f.channel)] = 0;
  }
  model_.write(applied);
  model_.step(dt_s);
  supervise(dt_s);
  record_hand_force();
  record_step(fault);
}

void Drive::record_step(bool fault) noexcept {
  if (report_.steps.size() >= options_.record_steps) return;
  DriveStep step{.session = report_.sessions,
                 .t_s = session_time_s(),
                 .mode = mode_,
                 .motor_faults = motor_faults_,
                 .fault = fault,
                 .command_taken = session_ ? session_->last_command : 0};
  for (const double tau : command_.tau_motor_Nm)
    step.commanded_max_Nm = std::max(step.commanded_max_Nm, std::abs(tau));
  step.applied_max_Nm = model_.truth().tau_applied_Nm.cwiseAbs().maxCoeff();
  step.packets_refused = report_.packets.refused();
  step.tip = model_.tip();
  report_.steps.push_back(step);
}

/// Compares each motor's torque with its command, as a drive does by measuring the current.
void Drive::supervise(double dt_s) noexcept {
  for (std::size_t i = 0; i < kMotors; ++i) {
    const double wanted = command_.tau_motor_Nm[i];
    const double given = model_.truth().tau_applied_Nm[static_cast<int>(i)];
    report_.largest_torque_Nm = std::max(report_.largest_torque_Nm, std::abs(given));
    const bool follows =
        std::abs(given - wanted) <= kFollows_Nm + kFollowsFraction * std::abs(wanted);
    not_following_s_[i] = follows ? 0 : not_following_s_[i] + dt_s;
    if (not_following_s_[i] > kFollows_s)
      motor_faults_ = static_cast<std::uint8_t>(motor_faults_ | (1U << i));
  }
}

void Drive::record_hand_force() noexcept {
  const double force_N = model_.truth().wrench_hand.head<3>().norm();
  report_.largest_hand_force_N = std::max(report_.largest_hand_force_N, force_N);
  if (falling_) {
    valley_N_ = std::min(valley_N_, force_N);
    falling_ = force_N < valley_N_ + kMinPeak_N;
    if (!falling_) peak_N_ = 0;
  }
  if (falling_) return;
  if (force_N > peak_N_) {
    peak_N_ = force_N;
    peak_t_s_ = session_time_s();
  } else if (force_N < peak_N_ / 2 && peak_N_ >= kMinPeak_N) {
    if (report_.peaks.size() < DriveReport::kMaxPeaks)
      report_.peaks.push_back({peak_t_s_, peak_N_});
    falling_ = true;
    valley_N_ = force_N;
  }
}

void Drive::send_state(Answer& answer) noexcept {
  DeviceState read;
  model_.read(read);
  StatePacket state{.session = session_->number,
                    .sequence = ++session_->last_state,
                    .time_ns = std::llround(read.t_s * 1e9),
                    .mode = mode_,
                    .motor_faults = motor_faults_,
                    .command_taken = session_->last_command};
  std::array<bool, kEncoders> stuck{};
  for (const PlannedFault& fault : options_.faults) {
    const auto i = static_cast<std::size_t>(fault.channel);
    if (!fault.is_on(session_time_s())) continue;
    if (fault.kind == FaultKind::kJump) read.encoder_rad[i] += fault.jump_rad;
    if (fault.kind == FaultKind::kStuck) stuck[i] = true;
  }
  for (std::size_t i = 0; i < kEncoders; ++i) {
    if (!stuck[i]) {
      stuck_at_rad_[i].reset();
      continue;
    }
    if (!stuck_at_rad_[i]) stuck_at_rad_[i] = read.encoder_rad[i];
    read.encoder_rad[i] = *stuck_at_rad_[i];
  }
  state.encoder_rad = read.encoder_rad;
  answer.size = encode(state, session_->key, answer.bytes);
}

}  // namespace trocar::runtime
