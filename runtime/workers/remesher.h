// SPDX-License-Identifier: Apache-2.0
// The remesher cuts requested holes into sheets on a worker thread. The haptic thread takes no lock
// and frees nothing: it pushes requests into a queue and reads atomic pointers.
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

/// Outcome of one request for a hole.
struct CutRecord {
  CutRequest request;
  /// The cut failed: the sheet keeps its mesh, and the hole counts as open. Refused: the mesh's
  /// capacity did not suffice; otherwise it is an internal error.
  std::optional<Error> error;
  CutReport cut;                            ///< obtuse_boundary_edges: after the quality pass
  std::int64_t doubled_area_before = 0;     ///< steps^2
  std::uint32_t quality_vertices = 0;       ///< added by the quality pass
  std::uint32_t hole_vertices = 0;          ///< vertices of the rings around the removed material
  std::uint32_t first_ring = 0, rings = 0;  ///< arguments of Remesher::hole()
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
/// alone. There is one exception: when free slots run short, after some hundred holes or at a large
/// one, slots are added to each replica while the haptic thread does not use it.
///
/// Requests are served in order. If the older replica of a sheet is still in use, its request and
/// all later ones wait, in real time for at most one tick.
class Remesher {
 public:
  static constexpr std::size_t kMaxRecords = 4096;          ///< the first ones are kept
  static constexpr std::size_t kMaxHolePoints = 1U << 17U;  ///< points of their holes that are kept

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

  /// Until stop(), serves requests as they come and publishes at once. `between` is called on the
  /// same thread whenever the queue is empty.
  void start(std::function<void()> between = {});
  /// After the haptic thread's last tick: serves and publishes the remaining requests.
  void stop();
  /// Serves the waiting requests without publishing; with a virtual clock the caller decides when
  /// to publish. A sheet has at most one unpublished version, so a request may have to wait.
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
    bool older_is_behind = false;  ///< `edit` is still to be applied to the older one
    bool unpublished = false;      ///< the newer one is not yet published
    SheetEdit edit;
    std::int64_t doubled_area;
    std::atomic<const Sheet*> published;
    std::atomic<std::uint32_t> used_cuts{
        0};  ///< cuts of the version that the haptic thread last took
  };

  /// Slots are added when fewer than these are free. A cut and its quality pass use free slots.
  static constexpr std::size_t kMinFreeVertices = 1024, kMinFreeTriangles = 2048;
  static constexpr int kMaxAttempts = 3;  ///< attempts at a cut that exceeds the capacity

  void catch_up(ReplicaPair& pair);
  void make_workspaces();
  void add_capacity(ReplicaPair& pair, Sheet& older);
  CutReport cut_with_capacity(ReplicaPair& pair, Sheet& older, const LatticeOutline& outline);
  void serve_one(const CutRequest& request);
  void improve(ReplicaPair& pair, Sheet& sheet, CutRecord& record) noexcept;
  void keep_hole(CutRecord& record) noexcept;

  SpscQueue<CutRequest, 256> requests_;  ///< a snap through a bone volume makes many
  RemesherOptions options_;
  std::size_t vertex_slots_ = 0, triangle_slots_ = 0;  ///< capacity of the workspaces
  std::unique_ptr<CutWorkspace> work_;
  std::unique_ptr<LocalRefinementWorkspace> refinement_;
  std::vector<std::unique_ptr<ReplicaPair>> pairs_;
  std::vector<std::size_t> ready_;  ///< sheets with an unpublished version, the oldest first
  std::vector<CutRecord> records_;
  std::vector<LatticePoint> hole_points_;
  std::vector<std::uint32_t> ring_end_;  ///< end of each ring in hole_points_
  std::optional<CutRequest> waiting_;    ///< taken from the queue, waits for its replica
  bool reader_stopped_ = false;
  PollingThread thread_;
};

}  // namespace trocar::runtime
