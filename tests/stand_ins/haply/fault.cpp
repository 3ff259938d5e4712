// SPDX-License-Identifier: Apache-2.0
#include "tests/stand_ins/haply/fault.h"

#include <charconv>
#include <stdexcept>
#include <string_view>

namespace trocar::haply_stand_in {
namespace {

struct KindName {
  FaultKind kind;
  const char *name, *meaning;
};

constexpr KindName kKinds[] = {
    {FaultKind::kSilence, "silence", "the service reads but does not answer"},
    {FaultKind::kLate, "late", "the answer comes 30 ms late"},
    {FaultKind::kTwice, "twice", "two answers for one message"},
    {FaultKind::kGarbage, "garbage", "text that is not JSON"},
    {FaultKind::kBadUtf8, "bad-utf8", "a text frame with bytes that are not UTF-8"},
    {FaultKind::kTruncated, "truncated", "the first half of a state"},
    {FaultKind::kBinary, "binary", "a binary frame of 64 bytes"},
    {FaultKind::kHuge, "huge", "a state with 2 MB of padding"},
    {FaultKind::kDeep, "deep", "100,000 lists inside each other"},
    {FaultKind::kWrongTypes, "wrong-types", "coordinates of the position are strings"},
    {FaultKind::kNull, "null", "coordinates of the position are null"},
    {FaultKind::kNan, "nan", "coordinates of the position are NaN"},
    {FaultKind::kBigNumber, "big-number", "coordinates of the position are 1e300"},
    {FaultKind::kOverflow, "overflow", "coordinates of the position are 1e999"},
    {FaultKind::kJump, "jump", "the position is 50 mm away in x"},
    {FaultKind::kFrozen, "frozen", "the numbers of the state before are repeated"},
    {FaultKind::kOtherId, "other-id", "the arm has another device_id"},
    {FaultKind::kMissingDevice, "missing-device", "another arm, 0.2 m away, is the only one"},
    {FaultKind::kRemoved, "removed", "the list of arms is empty"},
    {FaultKind::kNoInverse3, "no-inverse3", "there is no list of arms"},
    {FaultKind::kNoState, "no-state", "the arm has no state"},
    {FaultKind::kNotReady, "not-ready", "status.ready is false"},
    {FaultKind::kDisconnect, "disconnect", "the connection is reset (TCP RST)"},
    {FaultKind::kClose, "close", "the WebSocket is closed properly"},
    {FaultKind::kRestart, "restart",
     "no socket is open for DURATION, 1 s by default, and all clients are disconnected"},
};

std::optional<double> seconds(std::string_view text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size() || !(value >= 0 && value <= 1e9))
    return std::nullopt;
  return value;
}

}  // namespace

Fault parse_fault(const std::string& text) {
  const auto fail = [&](const std::string& why) {
    return std::runtime_error("--fault " + text + ": " + why);
  };
  const auto at = text.find('@');
  if (at == std::string::npos) throw fail("is not KIND@SECONDS[:DURATION]");
  Fault fault;
  fault.name = text.substr(0, at);
  const KindName* found = nullptr;
  for (const KindName& kind : kKinds)
    if (fault.name == kind.name) found = &kind;
  if (!found) throw fail("no such kind; --help lists them");
  fault.kind = found->kind;
  const std::string_view times = std::string_view(text).substr(at + 1);
  const auto colon = times.find(':');
  const auto start = seconds(times.substr(0, colon));
  if (!start) throw fail("SECONDS must be a number from 0");
  fault.at_s = *start;
  if (colon != std::string_view::npos) {
    fault.duration_s = seconds(times.substr(colon + 1));
    if (!fault.duration_s) throw fail("DURATION must be a number of seconds from 0");
  }
  return fault;
}

std::string fault_help() {
  std::string text;
  for (const KindName& kind : kKinds)
    text += "  " + std::string(kind.name) + ": " + kind.meaning + "\n";
  return text;
}

Fault* take_fault(std::vector<Fault>& faults, double now_s) {
  for (Fault& fault : faults) {
    if (now_s < fault.at_s) continue;
    // A restart happens once, because nobody can ask while it lasts.
    const bool is_once = !fault.duration_s || fault.kind == FaultKind::kRestart;
    if (is_once ? fault.answers > 0 : now_s >= fault.at_s + *fault.duration_s) continue;
    if (fault.answers == 0) fault.first_s = now_s;
    ++fault.answers;
    return &fault;
  }
  return nullptr;
}

}  // namespace trocar::haply_stand_in
