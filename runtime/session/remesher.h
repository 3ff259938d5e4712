// SPDX-License-Identifier: Apache-2.0
// The remesher cuts requested holes into sheets on a worker thread. The haptic thread takes no lock
// and frees no memory: it only pushes requests into a queue and reads atomic pointers.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "formats/base/result.h"
#include "formats/mesh/cut.h"
#include "formats/mesh/local_refinement.h"
#include "runtime/haptics/puncture.h"
#include "runtime/realtime/queues.h"
#include "runtime/realtime/realtime_thread.h"

namespace trocar::runtime {

/// Smallest angle of the new triangles of a hole, where the outline permits it. After a cut a
/// quality pass (local_refinement.h) inserts vertices until the new triangles have this angle.
inline constexpr double kMinHoleAngle_deg = 20;

/// Outcome of one request for a hole.
struct CutRecord {
  CutRequest request;
  /// If set, the cut failed, and the sheet keeps its mesh. The force law nevertheless treats
  /// the hole as open. The error is kRefused if the capacity of the mesh did not suffice,
  /// and otherwise kBug. Later holes of the sheet then fail, too, with an error that names the
  /// hole that failed first (Remesher).
  std::optional<Error> error;
  CutReport cut;                       ///< report of the cut, before the quality pass
  std::uint32_t quality_vertices = 0;  ///< vertices that the quality pass added
  std::uint32_t hole_vertices = 0;     ///< number of vertices in all rings of the hole
  /// Tells Remesher::hole() which of the kept rings belong to this hole: the first one, and how
  /// many. `rings` is 0 if no rings were kept.
  std::uint32_t first_ring = 0, rings = 0;
  double remesh_us = 0;  ///< wall time from the start of the cut until its version is ready
};

/// Cuts holes into sheets. A cut makes a new version of the sheet. Each sheet has two copies
/// (replicas): the haptic thread reads one of them, and the cut is made in the other. A single
/// atomic write then publishes the new version. From its next call of current() on, the haptic
/// thread reads the replica with the hole. Once it no longer uses the older replica, the change is
/// applied to the older replica, too. The replicas, the first version and the caller's sheet share
/// the memory of their common parts (PagedArray). So no mesh is copied as a whole, and the time
/// of a cut depends on the hole alone. Before a cut, the thread that calls serve() allocates memory
/// for the pages that the cut will write to. After some hundred holes, or for a large hole, the
/// free slots for vertices or triangles may not suffice. Slots are then added to each replica while
/// the haptic thread does not use this replica.
///
/// Requests are served in order. If the older replica of a sheet is still in use, a request for
/// this sheet waits, and all later requests wait, too. In real time they wait at most one tick.
///
/// If a hole cannot be cut, no later hole is cut into the same sheet during the session. The reason
/// is that the force law takes Sheet::cuts = n to mean that the version's mesh has the holes 1 to n
/// of the sheet. The force law keeps the holes that the mesh lacks as pending holes
/// (SheetTrack::pending). If a sheet would get more than kMaxPendingHoles of these, the session
/// has the fault kRemeshBacklog. Other sheets are cut as before.
class Remesher {
 public:
  static constexpr std::size_t kMaxRecords = 4096;          ///< later records are dropped
  static constexpr std::size_t kMaxHolePoints = 1U << 17U;  ///< points kept for rings of all holes

  /// `sheets`: the result of place_slices(), at most kMaxSceneSlices.
  explicit Remesher(const std::vector<std::unique_ptr<const Sheet>>& sheets);
  ~Remesher();
  Remesher(const Remesher&) = delete;
  Remesher& operator=(const Remesher&) = delete;

  std::size_t size() const noexcept { return pairs_.size(); }

  // The haptic thread calls these functions.

  /// Requests a hole. If the queue is full, returns false and drops the request.
  bool request(const CutRequest& request) noexcept { return requests_.push(request); }
  /// Returns the number of versions that are published, over all sheets.
  std::uint64_t versions_published() const noexcept {
    return versions_published_.load(std::memory_order_acquire);
  }
  /// Returns the newest version of a sheet among the first `versions` published ones. A tick passes
  /// the same number for all sheets. So the meshes of a tick have the changes of exactly the first
  /// `versions` versions, and a replay can publish the versions in the same order. `versions` is a
  /// result of versions_published(), and never less than in the call before. The pointer is valid
  /// until the next call for the same sheet.
  const Sheet* current(std::size_t sheet, std::uint64_t versions) noexcept;

  // One other thread calls serve() and publish_next(): the thread that start() creates, or, without
  // start(), a thread of the caller.

  /// Starts a thread that repeats the following until stop(): it serves the waiting requests,
  /// publishes the new versions immediately, and calls `between` if there is one.
  void start(std::function<void()> between = {});
  /// Call this after the haptic thread's last tick. Serves and publishes the remaining requests.
  void stop();
  /// Serves the waiting requests without publishing the new versions. With a virtual clock the
  /// caller uses this to decide when to publish. A sheet has at most one unpublished version. A
  /// further request for the sheet waits at least until this version is published.
  void serve();
  /// Publishes the oldest unpublished version. Returns false if there is none. (A failed cut
  /// makes no version.)
  bool publish_next();
  /// Returns the version that was published last.
  const Sheet& published_version(std::size_t sheet) const noexcept {
    return *pairs_[sheet]->published.load(std::memory_order_relaxed);
  }

  // These functions may be called after stop(), or on the thread that calls serve().

  const std::vector<CutRecord>& records() const noexcept { return records_; }
  /// Returns the rings of a record's hole, each with the removed material on its left. The result is
  /// empty if the cut failed, or if the rings did not fit into kMaxHolePoints.
  std::vector<Ring> hole(const CutRecord& record) const;
  /// Returns the sheet as it was before any cut, without free slots.
  const Sheet& first_version(std::size_t sheet) const { return pairs_[sheet]->first; }
  /// Returns the newest version of the sheet, which may not be published yet.
  const Sheet& last_version(std::size_t sheet) const {
    return pairs_[sheet]->replica[pairs_[sheet]->newer];
  }

 private:
  struct ReplicaPair {
    explicit ReplicaPair(const Sheet& sheet);
    Sheet first;
    std::array<Sheet, 2> replica;
    std::uint32_t newer = 0;       ///< index of the newer replica
    bool older_is_behind = false;  ///< `change` is still to be applied to the older replica
    bool unpublished = false;      ///< the newer replica is not yet published
    SheetChange change;            ///< slots that the last cut has written
    std::atomic<const Sheet*> published;
    /// Number of versions, over all sheets, that were published up to and including the version
    /// `published`. It is written before `published`, and not again before the haptic thread has
    /// taken that version.
    std::atomic<std::uint64_t> publication{0};
    const Sheet* used;  ///< the version that the haptic thread took last; only this thread uses it
    /// Sheet::cuts of the version that the haptic thread took last.
    std::atomic<std::uint32_t> used_cuts{0};
  };

  /// Slots are added if fewer than these are free. A cut and its quality pass use free slots.
  static constexpr std::size_t kMinFreeVertices = 1024, kMinFreeTriangles = 2048;
  static constexpr int kMaxAttempts = 3;  ///< attempts at a cut that exceeds the mesh's capacity
  /// Number of pages of each array that a cut can write to without allocation. Each array of a
  /// usual sheet has fewer pages.
  static constexpr std::size_t kReservedPages = 40;
  /// Number of changed triangles, and of changed vertices, that ReplicaPair::change can
  /// list without allocation.
  static constexpr std::size_t kReservedChanges = 4096;
  /// Number of slots for which the scratch memory of a cut is made at first. If a hole in a dense
  /// sheet needs more, larger scratch memory is allocated.
  static constexpr std::size_t kFirstWorkSlots = 32'768;

  void catch_up(ReplicaPair& pair);
  void make_cut_workspace();
  void make_workspaces();
  static void reserve_pages(Sheet& sheet);
  void add_capacity(Sheet& older);
  CutReport cut_with_capacity(Sheet& older, const LatticeOutline& outline);
  void serve_one(const CutRequest& request);
  void improve(Sheet& sheet, CutRecord& record) noexcept;
  void keep_hole(CutRecord& record) noexcept;

  /// The queue is long because a break-through in a bone volume makes many requests.
  SpscQueue<CutRequest, 256> requests_;
  std::size_t vertex_slots_ = 0, triangle_slots_ = 0;  ///< largest numbers over all sheets
  std::size_t work_slots_ = kFirstWorkSlots;           ///< `work_` is made for this many slots
  std::unique_ptr<CutWorkspace> work_;
  SheetEdit edit_;  ///< lists the slots of the current cut
  std::unique_ptr<LocalRefinementWorkspace> refinement_;
  std::vector<std::unique_ptr<ReplicaPair>> pairs_;
  std::atomic<std::uint64_t> versions_published_{0};
  std::vector<std::size_t> ready_;  ///< sheets with an unpublished version, the oldest first
  std::vector<CutRecord> records_;
  std::vector<LatticePoint> hole_points_;
  std::vector<std::uint32_t> ring_end_;  ///< end of each ring in hole_points_
  std::optional<CutRequest> waiting_;    ///< request from the queue that waits for its replica
  bool reader_stopped_ = false;          ///< the haptic thread no longer reads any version
  PollingThread thread_;
};

}  // namespace trocar::runtime
