// SPDX-License-Identifier: Apache-2.0
// The remesher cuts requested holes into sheets on a worker thread. The haptic thread takes no lock
// and frees no memory: it only pushes requests into a queue and reads atomic pointers.
// Tests: tests/runtime/workers/remesher_test.cpp
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "formats/base/result.h"
#include "runtime/contact/puncture.h"
#include "runtime/hole_cutting/cut.h"
#include "runtime/local_refinement/local_refinement.h"
#include "runtime/realtime/polling_thread.h"
#include "runtime/realtime/spsc_queue.h"

namespace trocar::runtime {

/// Outcome of one request for a hole. After the cut a quality pass improves the new triangles
/// (RemesherOptions).
struct CutRecord {
  CutRequest request;
  /// If set, the cut failed: the sheet keeps its mesh, but the force law still treats the hole as
  /// open. The error is kRefused if the capacity of the mesh did not suffice, and otherwise kBug.
  std::optional<Error> error;
  /// obtuse_boundary_edges is counted after the quality pass.
  CutReport cut;
  std::int64_t doubled_area_before = 0;     ///< twice the sheet's area before the cut, steps^2
  std::uint32_t quality_vertices = 0;       ///< vertices that the quality pass added
  std::uint32_t hole_vertices = 0;          ///< number of vertices of the hole's rings
  std::uint32_t first_ring = 0, rings = 0;  ///< used by Remesher::hole() to find the rings
  double remesh_us = 0;  ///< wall time from the start of the cut until its version is ready
};

struct RemesherOptions {
  /// Smallest angle of new triangles, where the outline permits it. The quality pass
  /// (local_refinement.h) inserts vertices until new triangles have this angle; 0: no quality pass.
  double min_angle_deg = 20;
};

/// Cuts holes into sheets. A cut makes a new version of the sheet. There are two replicas of each
/// sheet: the haptic thread reads one, and the cut is made in the other. One atomic store then
/// publishes the new version: it swaps the replicas. Once the haptic thread no longer uses the
/// older replica, the same change is applied to the older replica, too. The replicas, the first
/// version and the caller's sheet share the memory of their common parts (paged_array.h). No mesh
/// is copied as a whole, and the time depends on the hole alone. Before a cut, on the thread that
/// calls serve(), memory is allocated for the pages that the cut will write to. Free slots for
/// vertices or triangles can run short after some hundred holes or at a large hole. Slots are then
/// added to each replica while the haptic thread does not use this replica.
///
/// Requests are served in order. If the older replica of a sheet is still in use, a request for
/// this sheet and all later requests wait; in real time they wait at most one tick.
class Remesher {
 public:
  static constexpr std::size_t kMaxRecords = 4096;          ///< only the first records are kept
  static constexpr std::size_t kMaxHolePoints = 1U << 17U;  ///< points kept, over all holes

  /// `sheets`: the result of place_slices(), at most kMaxSceneSlices.
  explicit Remesher(const std::vector<std::unique_ptr<const Sheet>>& sheets,
                    const RemesherOptions& options = {});
  ~Remesher();
  Remesher(const Remesher&) = delete;
  Remesher& operator=(const Remesher&) = delete;

  std::size_t size() const noexcept { return pairs_.size(); }

  // The haptic thread calls these functions.

  /// Requests a hole. If the queue is full, returns false and drops the request.
  bool request(const CutRequest& request) noexcept { return requests_.push(request); }
  /// Returns the published version of a sheet. The pointer is valid until the next call for
  /// the same sheet.
  const Sheet* current(std::size_t sheet) noexcept;

  // One other thread calls serve() and publish_next(): the thread that start() creates, or, without
  // start(), a thread of the caller.

  /// Starts a thread that repeats the following until stop(): it serves the waiting requests,
  /// publishes the new versions immediately, and calls `between`.
  void start(std::function<void()> between = {});
  /// Call this after the haptic thread's last tick. Serves and publishes the remaining requests.
  void stop();
  /// Serves the waiting requests without publishing: with a virtual clock the caller decides when
  /// to publish. A sheet has at most one unpublished version, so a request may have to wait.
  void serve();
  /// Publishes the oldest unpublished version. Returns false if there is none. A failed cut
  /// makes no version.
  bool publish_next();
  /// Returns the version that was published last.
  const Sheet& published_version(std::size_t sheet) const noexcept {
    return *pairs_[sheet]->published.load(std::memory_order_relaxed);
  }

  // These functions may be called after stop(), or on the thread that calls serve().

  const std::vector<CutRecord>& records() const noexcept { return records_; }
  /// Returns the rings of a record's hole, as in CutResult::hole. The result is empty if
  /// the cut failed, or if the rings did not fit into kMaxHolePoints.
  std::vector<Ring> hole(const CutRecord& record) const;
  /// Returns the sheet as it was before any cut, without free slots.
  const Sheet& first_version(std::size_t sheet) const { return pairs_[sheet]->first; }
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
    std::int64_t doubled_area;
    std::atomic<const Sheet*> published;
    /// `cuts` of the version that the haptic thread took last.
    std::atomic<std::uint32_t> used_cuts{0};
  };

  /// Slots are added if fewer than these are free. A cut and its quality pass use free slots.
  static constexpr std::size_t kMinFreeVertices = 1024, kMinFreeTriangles = 2048;
  static constexpr int kMaxAttempts = 3;  ///< attempts at a cut that exceeds the mesh's capacity
  /// Number of pages of each array that a cut can write to without allocation. A sheet of a usual
  /// asset has fewer pages.
  static constexpr std::size_t kReservedPages = 40;
  /// Number of changed triangles, and of changed vertices, that are kept without allocation.
  static constexpr std::size_t kReservedChanges = 4096;
  /// At first the scratch memory of a cut is made for sheets with this many slots. If a hole in a
  /// dense sheet needs more, larger scratch memory is allocated.
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
  RemesherOptions options_;
  std::size_t vertex_slots_ = 0, triangle_slots_ = 0;  ///< largest numbers over all sheets
  std::size_t work_slots_ = kFirstWorkSlots;           ///< `work_` is made for this many slots
  std::unique_ptr<CutWorkspace> work_;
  SheetEdit edit_;  ///< lists the slots of the current cut
  std::unique_ptr<LocalRefinementWorkspace> refinement_;
  std::vector<std::unique_ptr<ReplicaPair>> pairs_;
  std::vector<std::size_t> ready_;  ///< sheets with an unpublished version, the oldest first
  std::vector<CutRecord> records_;
  std::vector<LatticePoint> hole_points_;
  std::vector<std::uint32_t> ring_end_;  ///< end of each ring in hole_points_
  std::optional<CutRequest> waiting_;    ///< request from the queue that waits for its replica
  bool reader_stopped_ = false;
  PollingThread thread_;
};

}  // namespace trocar::runtime
