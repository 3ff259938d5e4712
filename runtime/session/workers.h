// SPDX-License-Identifier: Apache-2.0
// Worker threads beside the haptic thread: the remesher, which cuts requested holes into sheets,
// and the recorder, which writes rows to a file. The haptic thread takes no lock and frees nothing:
// it pushes into queues and reads atomic pointers.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/recording.h"
#include "runtime/contact/puncture.h"
#include "runtime/cut/cut.h"
#include "runtime/realtime/spsc_queue.h"
#include "runtime/refine/local_refinement.h"

namespace trocar::runtime {

/// Outcome of one request for a hole; in the order of the requests.
struct CutRecord {
  CutRequest request;
  std::optional<Error> error;  ///< the cut failed; the sheet keeps its mesh, the hole counts as
                               ///< open. Refused: the capacity did not suffice; else a bug
  CutReport cut;               ///< obtuse_boundary_edges: after the quality pass
  std::int64_t doubled_area_before = 0;     ///< steps^2
  std::uint32_t quality_vertices = 0;       ///< added by the quality pass
  std::uint32_t hole_vertices = 0;          ///< of the rings around the removed material
  std::uint32_t first_ring = 0, rings = 0;  ///< Remesher::hole() gives them
  double remesh_us = 0;  ///< wall time from the start of the cut to a sheet ready for use
};

struct RemesherOptions {
  /// Smallest angle of new triangles where the outline permits it; 0: no quality pass.
  double min_angle_deg = 20;
};

/// Cuts holes into sheets. There are two replicas of each sheet: the haptic thread reads one, the
/// cut is made in the other, and one atomic store swaps them. Once the haptic thread no longer uses
/// the older replica, the same edit is applied to it. No mesh is copied as a whole, nothing is
/// allocated after the constructor (except for error messages), and the time depends on the hole
/// alone. The exception: when free slots run short, after some hundred holes or at a large one,
/// slots are added to each replica while it is not visible to the haptic thread.
///
/// Requests are served in order. A request for a sheet whose older replica is still in use waits,
/// and so do all after it; in real time for at most one tick.
class Remesher {
 public:
  static constexpr std::size_t kMaxRecords = 4096;          ///< the first ones are kept
  static constexpr std::size_t kMaxHolePoints = 1U << 17U;  ///< of their holes; more are not kept

  /// `sheets` as from place_slices, at most kMaxSceneSlices.
  explicit Remesher(const std::vector<std::unique_ptr<const Sheet>>& sheets,
                    const RemesherOptions& options = {});
  ~Remesher();
  Remesher(const Remesher&) = delete;
  Remesher& operator=(const Remesher&) = delete;

  std::size_t size() const noexcept { return pairs_.size(); }

  // Haptic thread.

  /// False if the queue is full.
  bool request(const CutRequest& request) noexcept { return requests_.push(request); }
  /// The version in use; valid until the next call for the same sheet.
  const Sheet* current(std::size_t sheet) noexcept;

  // One other thread: the one that start() creates, or the caller's.

  /// Serves requests as they come and publishes at once, until stop(). `between` is called on the
  /// same thread whenever the queue is empty.
  void start(std::function<void()> between = {});
  /// After the haptic thread's last tick: serves and publishes the remaining requests.
  void stop();
  /// Serves the waiting requests without publishing (virtual clock: the caller decides when),
  /// except those that must wait for a replica: a sheet has at most one unpublished version.
  void serve();
  /// Publishes the oldest unpublished version; false if there is none. A failed cut makes none.
  bool publish_next();
  /// The version that current() gives next.
  const Sheet& published_version(std::size_t sheet) const noexcept {
    return *pairs_[sheet]->published.load(std::memory_order_relaxed);
  }

  // After stop(), or on the thread that calls serve().

  const std::vector<CutRecord>& records() const noexcept { return records_; }
  /// The rings of a CutRecord, as CutResult::hole; empty if kMaxHolePoints was reached.
  std::vector<Ring> hole(const CutRecord& record) const;
  /// The sheet as placed, without free slots and without a grid.
  const Sheet& first_version(std::size_t sheet) const { return pairs_[sheet]->first; }
  const Sheet& last_version(std::size_t sheet) const {
    return pairs_[sheet]->replica[pairs_[sheet]->newer];
  }

 private:
  struct ReplicaPair {
    explicit ReplicaPair(const Sheet& sheet);
    Sheet first;
    std::array<Sheet, 2> replica;
    std::uint32_t newer = 0;       ///< index of the newer one
    bool older_is_behind = false;  ///< `edit` is still to be applied to it
    bool unpublished = false;      ///< the newer one is not yet published
    SheetEdit edit;
    std::int64_t doubled_area;
    std::atomic<const Sheet*> published;
    std::atomic<std::uint32_t> seen_cuts{0};  ///< of the version that the haptic thread last took
  };

  /// Below these numbers of free slots, which a cut and its quality pass may use, slots are added.
  static constexpr std::size_t kMinFreeVertices = 1024, kMinFreeTriangles = 2048;
  static constexpr int kMaxAttempts = 3;  ///< at a cut that exceeds the capacity

  void catch_up(ReplicaPair& pair);
  void make_workspaces();
  void add_capacity(ReplicaPair& pair, Sheet& older);
  CutReport cut_with_capacity(ReplicaPair& pair, Sheet& older, const LatticeOutline& outline);
  void serve_one(const CutRequest& request);
  void improve(ReplicaPair& pair, Sheet& sheet, CutRecord& record) noexcept;
  void keep_hole(CutRecord& record) noexcept;

  SpscQueue<CutRequest, 256> requests_;  ///< a snap through a body makes many
  RemesherOptions options_;
  std::size_t vertex_slots_ = 0, triangle_slots_ = 0;  ///< capacity of the workspaces
  std::unique_ptr<CutWorkspace> work_;
  std::unique_ptr<LocalRefinementWorkspace> refinement_;
  std::thread thread_;
  std::vector<std::unique_ptr<ReplicaPair>> pairs_;
  std::vector<std::size_t> ready_;  ///< sheets with an unpublished version, the oldest first
  std::vector<CutRecord> records_;
  std::vector<LatticePoint> hole_points_;
  std::vector<std::uint32_t> ring_end_;  ///< of each ring, in hole_points_
  std::optional<CutRequest> waiting_;    ///< taken from the queue, waits for its replica
  bool reader_stopped_ = false;
  std::atomic<bool> stopping_{false};
};

/// Writes rows to a recording, on its own thread or when drain() is called.
class Recorder {
 public:
  static constexpr std::size_t kCapacity = 8192;  ///< rows: one second at the highest rate

  /// `failed` is called at once when rows cannot be written, on the thread that writes them; later
  /// rows are discarded.
  explicit Recorder(RecordingWriter writer, std::function<void(const Error&)> failed = {})
      : writer_(std::move(writer)), failed_(std::move(failed)) {}
  ~Recorder();
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  /// Haptic thread. If the queue is full the row is lost, and finish() returns an error.
  void push(const RecordingRow& row) noexcept {
    if (!rows_.push(row)) lost_.fetch_add(1, std::memory_order_relaxed);
  }

  void start();
  /// Writes the rows in the queue.
  void drain();
  /// Ends the thread, if any, writes the remaining rows and moves the file to its place. Unwritable
  /// if that fails or a row was lost; the rows that could be written are then in
  /// RecordingWriter::partial_file().
  Result<void> finish();

 private:
  void stop_thread();

  SpscQueue<RecordingRow, kCapacity> rows_;
  std::atomic<std::uint64_t> lost_{0};
  std::thread thread_;
  std::optional<Error> error_;
  RecordingWriter writer_;
  std::function<void(const Error&)> failed_;
  std::atomic<bool> stopping_{false};
};

}  // namespace trocar::runtime
