// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/client_progress.h"

#include <algorithm>
#include <utility>

#include "formats/base/json_text.h"
#include "runtime/console/messages.h"

namespace trocar::runtime {
namespace {

constexpr std::uint32_t kSnapshot = 1, kSheet = 2, kShape = 3, kHistory = 4;
constexpr std::size_t kMaxOutstanding = 4, kMaxSnapshotsOutstanding = 2, kMaxEventsOfMessage = 64;
constexpr auto kSnapshotEvery = std::chrono::milliseconds(15);
constexpr auto kSnapshotAnyway = std::chrono::milliseconds(50);  // for a session's last snapshot
constexpr auto kStalled = std::chrono::seconds(6);

ClientMessage text_message(std::string text) {
  return {std::move(text), nullptr};
}

}  // namespace

std::optional<ClientMessage> ClientProgress::next(const Supervisor& session, Role role,
                                                  HandShare hand, bool has_new_snapshot,
                                                  Clock::time_point now) {
  const SessionTelemetry& telemetry = session.telemetry();
  if (!said_hello_ || session_ != telemetry.sessions()) return hello(telemetry, role);
  if (telemetry.about().has_live_hand && hand_ != hand) {
    hand_ = hand;
    return text_message(std::string(R"({"hand":")") + to_string(hand) + "\"}");
  }
  // Events come before the state, so that a client that reads "ended" has received all of them.
  if (cursor_ < telemetry.last_event()) {
    if (auto message = next_events(telemetry)) return message;
  }
  if (state_ != session.state_version()) {
    state_ = session.state_version();
    return text_message(session.state_json());
  }
  if (outstanding_.size() >= kMaxOutstanding) return std::nullopt;
  if (!std::exchange(has_history_, true) && !telemetry.history().points().empty())
    return binary(
        kHistory,
        std::make_shared<const std::string>(history_message(telemetry.history().points())), now);
  if (auto message = next_snapshot(telemetry, has_new_snapshot, now)) return message;
  const auto& sheets = telemetry.sheets();
  for (std::size_t i = 0; i < sheets.size(); ++i) {
    if (sheet_versions_[i] == sheets[i].version) continue;
    sheet_versions_[i] = sheets[i].version;
    if (sheets[i].frame) return binary(kSheet, sheets[i].frame, now);
  }
  if (shape_version_ != telemetry.shape().version && telemetry.shape().frame) {
    shape_version_ = telemetry.shape().version;
    return binary(kShape, telemetry.shape().frame, now);
  }
  return std::nullopt;
}

ClientMessage ClientProgress::hello(const SessionTelemetry& session, Role role) {
  cursor_ = said_hello_ ? 0 : first_cursor_;
  said_hello_ = true;
  session_ = session.sessions();
  state_ = 0;
  hand_.reset();
  snapshot_ = 0;
  has_history_ = false;
  shape_version_ = 0;
  sheet_versions_.assign(session.sheets().size(), 0);
  const SessionAbout& about = session.about();
  if (about.json.empty())
    return text_message(R"({"hello":null,"session":"","columns":[],"last_event":0,"role":")" +
                        std::string(to_string(role)) + "\"}");
  return text_message("{\"hello\":" + about.json + ",\"session\":" + json_text(about.id) +
                      ",\"role\":\"" + to_string(role) + "\",\"columns\":" + about.columns +
                      ",\"last_event\":" + std::to_string(session.last_event()) + "}");
}

std::optional<ClientMessage> ClientProgress::next_events(const SessionTelemetry& session) {
  const auto& events = session.events();
  auto event = std::upper_bound(
      events.begin(), events.end(), cursor_,
      [](std::uint64_t number, const SessionTelemetry::Event& one) { return number < one.number; });
  if (event == events.end()) return std::nullopt;
  if (event->number != cursor_ + 1) {
    const std::uint64_t missed = event->number - cursor_ - 1;
    cursor_ = event->number - 1;
    return text_message("{\"missed\":" + std::to_string(missed) + "}");
  }
  std::string text = "{\"events\":[";
  for (std::size_t i = 0;
       i < kMaxEventsOfMessage && event != events.end() && event->number == cursor_ + 1;
       ++i, ++event) {
    text += (i == 0 ? "" : ",") + event->json;
    cursor_ = event->number;
  }
  return text_message(text + "]}");
}

std::optional<ClientMessage> ClientProgress::next_snapshot(const SessionTelemetry& session,
                                                           bool has_new_snapshot,
                                                           Clock::time_point now) {
  const auto out = std::count_if(outstanding_.begin(), outstanding_.end(),
                                 [](const Outstanding& one) { return one.kind == kSnapshot; });
  const bool is_due =
      snapshot_ != session.snapshots() &&
      (has_new_snapshot || snapshot_ == 0 || now - snapshot_at_ >= kSnapshotAnyway) &&
      static_cast<std::size_t>(out) < kMaxSnapshotsOutstanding &&
      now - snapshot_at_ >= kSnapshotEvery;
  if (!is_due || !session.snapshot()) return std::nullopt;
  snapshot_ = session.snapshots();
  snapshot_at_ = now;
  return binary(kSnapshot, session.snapshot(), now);
}

ClientMessage ClientProgress::binary(std::uint32_t kind, Frame frame, Clock::time_point now) {
  outstanding_.push_back({++number_, kind, now});
  return {{}, std::move(frame), kind, number_};
}

void ClientProgress::acknowledge(std::uint64_t number) {
  while (!outstanding_.empty() && outstanding_.front().number <= number)
    outstanding_.pop_front();
}

bool ClientProgress::is_stalled(Clock::time_point now) const {
  return !outstanding_.empty() && now - outstanding_.front().sent_at > kStalled;
}

}  // namespace trocar::runtime
