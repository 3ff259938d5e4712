// SPDX-License-Identifier: Apache-2.0
#include "runtime/simulation/fault_plan.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>
#include <string>

#include "runtime/device/device.h"

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
  if (timed && !read_when(rest, fault)) {
    return usage(quote(item) + "@ must be followed by FROM or FROM..TO, in s, TO not before FROM");
  }
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
  if (!is_of_packets(fault.kind) && !(fault.on_commands && fault.on_states)) {
    return usage(quote(item) + "command- and state- are for faults of packets only");
  }
  if (static_cast<int>(values.size()) != known->values || !read_values(values, fault)) {
    return usage(quote(item) + "must be " + known->form);
  }
  return fault;
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

}  // namespace trocar::runtime
