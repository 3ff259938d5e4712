// SPDX-License-Identifier: Apache-2.0
// The console's copy of a session's telemetry, with the history of the force.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "formats/session/telemetry.h"
#include "runtime/console/session_files.h"

namespace trocar::runtime {

// The force on the hand and the height of the tip since a session began, for pages that connect
// later. If there are more than kMaxPoints points, one point of each pair of successive points is
// removed: the point with the smaller force, so that peaks stay.

class ForceHistory {
 public:
  struct Point {
    double t_s = 0, force_N = 0, tip_z_m = 0;
  };
  static constexpr std::size_t kMaxPoints = 4000;

  void clear() { *this = {}; }
  /// Adds a point. A point that is not later than the previous one is ignored.
  void add(const Point& point);
  const std::vector<Point>& points() const noexcept { return points_; }

 private:
  std::vector<Point> points_;
  double last_t_s_ = -1;
  int every_ = 1;                 ///< one point is kept for this many added points
  int pending_ = 0;               ///< points added since a point was kept
  std::optional<Point> largest_;  ///< pending point with the largest force
};

// The console's copy of one session's shared-memory telemetry: the description, the events (such as
// punctures and faults), the latest snapshot (the numbers of one tick) and the meshes. Every part
// is stored in the form in which clients get it. After the session has ended, the copy is kept
// until the next session begins.

/// The contents of a binary message (messages.h). All clients get the same bytes.
using Frame = std::shared_ptr<const std::string>;

class SessionTelemetry {
 public:
  struct Event {
    std::uint64_t number = 0;
    std::string json;
  };
  struct Mesh {
    std::uint64_t version = 0;  ///< changes with each new mesh
    Frame frame;                ///< result of mesh_message() (messages.h); null: nothing to show
  };

  /// Forgets the present session and begins to copy the session whose memory `reader` reads.
  void attach(std::unique_ptr<TelemetryReader> reader);
  /// Forgets the session. Called when another session is about to begin.
  void clear();
  bool is_attached() const noexcept { return reader_ != nullptr; }
  /// Reads new events, the latest snapshot and changed meshes. To keep the call short, it reads at
  /// most two sheets; everything else takes less than a millisecond.
  void poll();
  /// Passes a command on to the session. Precondition: is_attached().
  void command(TelemetryCommand command) { reader_->command(command); }
  /// Keeps X-ray screening on for another second if `is_held` is true, otherwise ends screening.
  /// Precondition: is_attached() is true.
  void screen(bool is_held) { reader_->screen(is_held); }
  /// True if the session has a live hand and has not ended.
  bool has_hand() const noexcept { return reader_ && reader_->has_hand() && !has_ended_; }
  /// Moves the live hand to a target: the position of the tip in {B} in m, and the rotation vector
  /// of the plate in rad. If `target` is nullopt, the hand lets go. Precondition: has_hand().
  void move_hand(const std::optional<std::array<double, 6>>& target);

  /// A number that identifies the present session: it increases with each new session.
  std::uint64_t sessions() const noexcept { return sessions_; }
  /// The description of the session. If there is no session yet, SessionAbout::json is empty.
  const SessionAbout& about() const noexcept { return about_; }
  /// The latest 20,000 events, in the order of their numbers.
  const std::deque<Event>& events() const noexcept { return events_; }
  std::uint64_t last_event() const noexcept { return last_event_; }
  /// True if the event `ended` has been read.
  bool has_ended() const noexcept { return has_ended_; }
  std::uint64_t snapshots() const noexcept { return snapshots_; }  ///< number of snapshots read
  const Frame& snapshot() const noexcept { return snapshot_; }     ///< null: no snapshot yet
  const ForceHistory& history() const noexcept { return history_; }
  /// Returns a value of the latest snapshot, or 0 if there is no such value. `column`: name of a
  /// group of values, such as "tau_Nm". `at`: index of the value in this group.
  double value(const char* column, std::size_t at = 0) const;
  const std::vector<Mesh>& sheets() const noexcept { return sheets_; }
  const Mesh& shape() const noexcept { return shape_; }

 private:
  void read_events();
  void read_meshes();

  std::unique_ptr<TelemetryReader> reader_;
  std::uint64_t sessions_ = 0, last_event_ = 0, snapshots_ = 0;
  SessionAbout about_;
  std::vector<double> values_;
  Frame snapshot_;
  ForceHistory history_;
  std::deque<Event> events_;
  bool has_ended_ = false;
  std::uint64_t hand_messages_ = 0;
  std::vector<Mesh> sheets_;
  Mesh shape_;
};

}  // namespace trocar::runtime
