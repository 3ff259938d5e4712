// SPDX-License-Identifier: Apache-2.0
// The threads that work for the haptic thread: the remesher, which turns a request
// for a hole into a sheet that has it, and the recorder, which writes rows to a file.
// Towards the haptic thread both are lock-free: it pushes into a queue and reads an
// atomic pointer, and it never frees.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "formats/recording.h"
#include "formats/result.h"
#include "runtime/contact/puncture.h"
#include "runtime/loop/spsc_queue.h"
#include "runtime/remesh/cut.h"

namespace trocar::runtime {

/// What became of one request, in the order of the requests.
struct CutRecord {
  CutRequest request;
  std::optional<Error>
      error;               ///< the cut failed; the sheet keeps its mesh, the hole counts as open
  std::vector<Ring> hole;  ///< CutResult::hole
  std::int64_t doubled_area_before = 0, doubled_area_removed = 0;  ///< steps^2
  std::uint32_t triangles_removed = 0, triangles_created = 0;
  double remesh_us = 0;  ///< wall time of the cut and of building the sheet
};

/// Keeps every sheet's versions. Requests are served one after the other, in their order.
class Remesher {
 public:
  /// `sheets` as from place_slices, at most kMaxSceneSlices.
  explicit Remesher(std::vector<std::unique_ptr<const Sheet>> sheets);
  ~Remesher();
  Remesher(const Remesher&) = delete;
  Remesher& operator=(const Remesher&) = delete;

  std::size_t size() const noexcept { return lanes_.size(); }

  // Haptic thread.

  /// False if too many requests wait.
  bool request(const CutRequest& request) noexcept { return requests_.push(request); }
  /// The version in use; valid until the next call for the same sheet.
  const Sheet* current(std::size_t sheet) noexcept;

  // One other thread: either the one that start() makes, or the caller's.

  /// Serves requests as they come and publishes at once, until stop(), which serves what is left.
  /// `between` is called on the same thread whenever none waits.
  void start(std::function<void()> between = {});
  void stop();
  /// Serves all waiting requests without publishing (virtual clock: the caller says when).
  void serve();
  /// Publishes the oldest sheet that serve() has ready; false if there is none. A failed cut has
  /// none.
  bool publish_next();

  // After stop(), or from the thread that serves.

  const std::vector<CutRecord>& records() const noexcept { return records_; }
  const Sheet& first_version(std::size_t sheet) const { return *lanes_[sheet]->versions.front(); }
  const Sheet& last_version(std::size_t sheet) const { return *lanes_[sheet]->versions.back(); }

 private:
  struct Lane {
    std::deque<std::unique_ptr<const Sheet>> versions;  ///< the first and those not yet let go
    std::atomic<const Sheet*> published{nullptr};
    std::atomic<std::uint32_t> seen_cuts{0};  ///< of the version the haptic thread took last
  };

  void serve_one(const CutRequest& request);
  static void let_go(Lane& lane);

  SpscQueue<CutRequest, 64> requests_;
  std::vector<std::unique_ptr<Lane>> lanes_;
  std::deque<std::pair<std::size_t, const Sheet*>> ready_;  ///< cut, not published
  std::vector<CutRecord> records_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

/// Writes rows to a recording, on a thread of its own or when told to.
class Recorder {
 public:
  static constexpr std::size_t kCapacity = 8192;  ///< rows: one second at the highest rate

  explicit Recorder(RecordingWriter writer) : writer_(std::move(writer)) {}
  ~Recorder();
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  /// Haptic thread. A row that finds no room is lost, and finish() says so.
  void push(const RecordingRow& row) noexcept {
    if (!rows_.push(row)) lost_.fetch_add(1, std::memory_order_relaxed);
  }

  void start();
  /// Writes what waits.
  void drain();
  /// Ends the thread, if any, writes the rest and puts the file in its place. Unwritable if that
  /// fails or a row was lost; there is no file then.
  Result<void> finish();

 private:
  void stop_thread();

  SpscQueue<RecordingRow, kCapacity> rows_;
  std::atomic<std::uint64_t> lost_{0};
  std::thread thread_;
  std::optional<Error> error_;
  RecordingWriter writer_;
  std::atomic<bool> stopping_{false};
};

}  // namespace trocar::runtime
