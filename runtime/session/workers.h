// SPDX-License-Identifier: Apache-2.0
// The threads that work for the haptic thread: the remesher, which turns a request
// for a hole into a sheet that has it, and the recorder, which writes rows to a file.
// Towards the haptic thread both are lock-free: it pushes into a queue and reads an
// atomic pointer, and it never frees.
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

#include "formats/session/recording.h"
#include "formats/base/result.h"
#include "runtime/contact/puncture.h"
#include "runtime/realtime/spsc_queue.h"
#include "runtime/cut/cut.h"
#include "runtime/refine/local_refinement.h"

namespace trocar::runtime {

/// What became of one request, in the order of the requests.
struct CutRecord {
  CutRequest request;
  std::optional<Error> error;  ///< the cut failed; the sheet keeps its mesh, the hole counts as
                               ///< open. Refused: there was no room for it; else a bug
  CutReport cut;               ///< obtuse_boundary_edges: after the quality pass
  std::int64_t doubled_area_before = 0;     ///< steps^2
  std::uint32_t quality_vertices = 0;       ///< added by the quality pass
  std::uint32_t hole_vertices = 0;          ///< of the rings around what went
  std::uint32_t first_ring = 0, rings = 0;  ///< Remesher::hole() gives them
  double remesh_us = 0;  ///< wall time from the request's turn to a sheet ready for use
};

struct RemesherOptions {
  /// New triangles get no angle below this where the outline permits; 0: as the cut leaves them.
  double min_angle_deg = 20;
};

/// Cuts holes into sheets. There are two replicas of each sheet: the haptic thread reads one, the
/// cut is made in the other, and they change places by one atomic store. When the haptic thread has
/// let the older one go, the edit is made there too. Nothing is copied as a whole and nothing
/// allocated after the constructor (but for the words of an error), and all takes a time that
/// depends on the hole alone; but where free slots run short, after some hundred holes, or do not
/// suffice, a sheet gets more, each replica while nobody reads it.
///
/// Requests are served in their order. One for a sheet whose older replica is still in use waits,
/// and all behind it: in real time for a tick at the most.
class Remesher {
 public:
  static constexpr std::size_t kMaxRecords = 4096;          ///< the first ones are kept
  static constexpr std::size_t kMaxHolePoints = 1U << 17U;  ///< of their holes, likewise

  /// `sheets` as from place_slices, at most kMaxSceneSlices.
  explicit Remesher(const std::vector<std::unique_ptr<const Sheet>>& sheets,
                    const RemesherOptions& options = {});
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

  /// Serves requests as they come and publishes at once, until stop().
  /// `between` is called on the same thread whenever none waits.
  void start(std::function<void()> between = {});
  /// After the haptic thread's last tick: serves and publishes what is left.
  void stop();
  /// Serves the waiting requests without publishing (virtual clock: the caller says when), but for
  /// those that have to wait for a replica: a sheet has at most one version that is not published.
  void serve();
  /// Publishes the oldest sheet that serve() has ready; false if there is none. A failed cut has
  /// none.
  bool publish_next();

  // After stop(), or from the thread that serves.

  const std::vector<CutRecord>& records() const noexcept { return records_; }
  std::uint64_t records_not_kept() const noexcept { return records_not_kept_; }
  /// CutRecord's rings, as CutResult::hole; none if they found no room.
  std::vector<Ring> hole(const CutRecord& record) const;
  /// As it was placed, without free slots and without a grid.
  const Sheet& first_version(std::size_t sheet) const { return lanes_[sheet]->first; }
  const Sheet& last_version(std::size_t sheet) const {
    return lanes_[sheet]->replica[lanes_[sheet]->newer];
  }

 private:
  struct Lane {
    explicit Lane(const Sheet& sheet);
    Sheet first;
    std::array<Sheet, 2> replica;
    std::uint32_t newer = 0;       ///< of the two
    bool older_is_behind = false;  ///< by `edit`
    bool unpublished = false;      ///< the newer one is
    SheetEdit edit;
    std::int64_t doubled_area;
    std::atomic<const Sheet*> published;
    std::atomic<std::uint32_t> seen_cuts{0};  ///< of the version the haptic thread took last
  };

  /// So many free slots are left for the quality pass and the next cut, or more are added.
  static constexpr std::size_t kLeastFreeVertices = 1024, kLeastFreeTriangles = 2048;
  static constexpr int kMostAttempts = 3;  ///< at a cut for which there is no room

  void catch_up(Lane& lane);
  void make_workspaces();
  void make_room(Lane& lane, Sheet& unread);
  CutReport cut_with_room(Lane& lane, Sheet& unread, const LatticeOutline& outline);
  void serve_one(const CutRequest& request);
  void improve(Lane& lane, Sheet& sheet, CutRecord& record) noexcept;
  void keep_hole(CutRecord& record) noexcept;

  SpscQueue<CutRequest, 64> requests_;
  RemesherOptions options_;
  std::vector<std::unique_ptr<Lane>> lanes_;
  std::size_t vertex_slots_ = 0, triangle_slots_ = 0;  ///< that the workspaces are for
  std::unique_ptr<CutWorkspace> work_;
  std::unique_ptr<LocalRefinementWorkspace> refinement_;
  std::optional<CutRequest> waiting_;  ///< taken off the queue
  std::vector<std::size_t> ready_;     ///< lanes with an unpublished version, the oldest first
  bool nobody_reads_ = false;
  std::vector<CutRecord> records_;
  std::uint64_t records_not_kept_ = 0;
  std::vector<LatticePoint> hole_points_;
  std::vector<std::uint32_t> ring_end_;  ///< of each ring, in hole_points_
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
