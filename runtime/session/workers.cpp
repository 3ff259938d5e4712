// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/workers.h"

#include <algorithm>
#include <chrono>
#include <string>
#include <utility>

namespace trocar::runtime {
namespace {

// The haptic thread wakes nobody: a system call a puncture would be a delay.
constexpr std::chrono::milliseconds kPollInterval{1};
constexpr std::chrono::milliseconds kRecorderInterval{20};

}  // namespace

Remesher::Lane::Lane(const Sheet& sheet)
    : replica{sheet, sheet},
      edit(sheet.mesh),
      doubled_area(trocar::doubled_area(to_slice_mesh(sheet.mesh))),
      published(replica.data()) {
  first = sheet;
  first.mesh = std::move(*make_sheet_mesh(to_slice_mesh(sheet.mesh), 0, 0));
  first.grid = TriangleGrid();
}

Remesher::Remesher(const std::vector<std::unique_ptr<const Sheet>>& sheets,
                   const RemesherOptions& options)
    : options_(options) {
  for (const auto& sheet : sheets) {
    vertex_slots_ = std::max(vertex_slots_, sheet->mesh.vertices.size());
    triangle_slots_ = std::max(triangle_slots_, sheet->mesh.triangles.size());
    lanes_.push_back(std::make_unique<Lane>(*sheet));
  }
  make_workspaces();
  ready_.reserve(lanes_.size());
  records_.reserve(kMaxRecords);
  hole_points_.reserve(kMaxHolePoints);
  ring_end_.reserve(kMaxHolePoints / 3);
}

void Remesher::make_workspaces() {
  work_ = std::make_unique<CutWorkspace>(capacity_for(vertex_slots_, triangle_slots_));
  refinement_ = std::make_unique<LocalRefinementWorkspace>(vertex_slots_, triangle_slots_);
}

Remesher::~Remesher() {
  stop();
}

const Sheet* Remesher::current(std::size_t sheet) noexcept {
  Lane& lane = *lanes_[sheet];
  const Sheet* latest = lane.published.load(std::memory_order_acquire);
  // Versions only ever get newer, so from here on no older one is looked at.
  lane.seen_cuts.store(latest->cuts, std::memory_order_release);
  return latest;
}

void Remesher::catch_up(Lane& lane) {
  if (!lane.older_is_behind || lane.unpublished) return;
  const Sheet& newer = lane.replica[lane.newer];
  if (lane.seen_cuts.load(std::memory_order_acquire) < newer.cuts && !nobody_reads_) return;
  Sheet& older = lane.replica[1 - lane.newer];
  if (older.mesh.triangles.size() < newer.mesh.triangles.size()) {
    older.mesh.add_slots(newer.mesh.vertices.size() - older.mesh.vertices.size(),
                         newer.mesh.triangles.size() - older.mesh.triangles.size());
    older.grid.add_slots(older.mesh);
  }
  lane.edit.copy_to(newer.mesh, older.mesh);
  older.grid.update(lane.edit, older.mesh);
  older.cuts = newer.cuts;
  lane.older_is_behind = false;
}

void Remesher::improve(Lane& lane, Sheet& sheet, CutRecord& record) noexcept {
  if (options_.min_angle_deg <= 0) return;
  LocalRefinementOptions options;
  options.min_angle_deg = options_.min_angle_deg;
  const LocalRefinementResult result =
      refine_locally(sheet.mesh, lane.edit, work_->stitch.created, options, *refinement_);
  record.quality_vertices = result.vertices_added;
  record.cut.obtuse_boundary_edges = count_obtuse_boundary_edges(sheet.mesh, lane.edit);
}

void Remesher::keep_hole(CutRecord& record) noexcept {
  const HoleOutline& hole = work_->hole;
  record.hole_vertices = static_cast<std::uint32_t>(hole.points.size());
  record.first_ring = static_cast<std::uint32_t>(ring_end_.size());
  if (hole_points_.size() + hole.points.size() > hole_points_.capacity() ||
      ring_end_.size() + hole.rings() > ring_end_.capacity())
    return;
  record.rings = static_cast<std::uint32_t>(hole.rings());
  for (std::size_t r = 0; r < hole.rings(); ++r) {
    const std::span<const LatticePoint> ring = hole.ring(r);
    hole_points_.insert(hole_points_.end(), ring.begin(), ring.end());
    ring_end_.push_back(static_cast<std::uint32_t>(hole_points_.size()));
  }
}

std::vector<Ring> Remesher::hole(const CutRecord& record) const {
  std::vector<Ring> rings;
  for (std::uint32_t r = record.first_ring; r < record.first_ring + record.rings; ++r) {
    const std::uint32_t start = r == 0 ? 0 : ring_end_[r - 1];
    rings.emplace_back(hole_points_.begin() + start, hole_points_.begin() + ring_end_[r]);
  }
  return rings;
}

void Remesher::make_room(Lane& lane, Sheet& unread) {
  unread.mesh.add_slots(kSpareVertices, kSpareTriangles);
  unread.grid.add_slots(unread.mesh);
  lane.edit = SheetEdit(unread.mesh);
  if (unread.mesh.triangles.size() <= triangle_slots_ &&
      unread.mesh.vertices.size() <= vertex_slots_)
    return;
  vertex_slots_ = std::max(vertex_slots_, unread.mesh.vertices.size());
  triangle_slots_ = std::max(triangle_slots_, unread.mesh.triangles.size());
  make_workspaces();
}

CutReport Remesher::cut_with_room(Lane& lane, Sheet& unread, const LatticeOutline& outline) {
  if (unread.mesh.free_vertices.size() < kLeastFreeVertices ||
      unread.mesh.free_triangles.size() < kLeastFreeTriangles)
    make_room(lane, unread);
  CutReport report;
  for (int attempt = 0; attempt < kMostAttempts; ++attempt) {
    if (attempt > 0) make_room(lane, unread);
    report = cut_in_place(unread.mesh, unread.grid,
                          std::span(outline.points.data(), static_cast<std::size_t>(outline.size)),
                          *work_, lane.edit);
    if (report.outcome != CutOutcome::kCapacity) break;
  }
  return report;
}

// The older replica is as the newer one, and nobody reads it.
void Remesher::serve_one(const CutRequest& request) {
  const auto start = std::chrono::steady_clock::now();
  const auto index = static_cast<std::size_t>(request.sheet);
  Lane& lane = *lanes_[index];
  const std::uint32_t cuts = lane.replica[lane.newer].cuts;
  Sheet& next = lane.replica[1 - lane.newer];
  CutRecord record;
  record.request = request;
  record.doubled_area_before = lane.doubled_area;
  if (request.cut != cuts + 1) {
    record.error = bug("a cut before this one failed");
  } else {
    record.cut = cut_with_room(lane, next, request.outline);
    if (record.cut.outcome == CutOutcome::kCut || record.cut.outcome == CutOutcome::kNothingMet) {
      if (record.cut.outcome == CutOutcome::kCut) improve(lane, next, record);
      next.grid.update(lane.edit, next.mesh);
      next.cuts = cuts + 1;
      keep_hole(record);
      lane.doubled_area -= record.cut.doubled_area_removed;
      lane.newer = 1 - lane.newer;
      lane.older_is_behind = true;
      lane.unpublished = true;
      ready_.push_back(index);
    } else if (record.cut.outcome == CutOutcome::kCapacity) {
      record.error = refused("cut: it takes more than there is room for");
    } else {
      record.error = bug("cut: " + std::string(to_word(record.cut.outcome)) +
                         (record.cut.bug != nullptr ? std::string(": ") + record.cut.bug : ""));
    }
  }
  record.remesh_us =
      std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start).count();
  if (records_.size() < kMaxRecords) {
    records_.push_back(record);
  } else {
    ++records_not_kept_;
  }
}

void Remesher::serve() {
  for (const auto& lane : lanes_)
    catch_up(*lane);
  CutRequest request;
  while (waiting_ || requests_.pop(request)) {
    if (waiting_) request = *waiting_;
    waiting_.reset();
    if (lanes_[static_cast<std::size_t>(request.sheet)]->older_is_behind) {
      waiting_ = request;
      return;
    }
    serve_one(request);
  }
}

bool Remesher::publish_next() {
  if (ready_.empty()) return false;
  Lane& lane = *lanes_[ready_.front()];
  ready_.erase(ready_.begin());
  lane.published.store(&lane.replica[lane.newer], std::memory_order_release);
  lane.unpublished = false;
  return true;
}

void Remesher::start(std::function<void()> between) {
  stopping_.store(false);
  thread_ = std::thread([this, between = std::move(between)] {
    while (!stopping_.load(std::memory_order_acquire)) {
      serve();
      while (publish_next()) {
      }
      if (between) between();
      std::this_thread::sleep_for(kPollInterval);
    }
  });
}

void Remesher::stop() {
  if (thread_.joinable()) {
    stopping_.store(true, std::memory_order_release);
    thread_.join();
  }
  nobody_reads_ = true;
  do {
    serve();
  } while (publish_next() || waiting_);
  nobody_reads_ = false;
}

Recorder::~Recorder() {
  stop_thread();
}

void Recorder::start() {
  stopping_.store(false);
  thread_ = std::thread([this] {
    for (;;) {
      const bool last = stopping_.load(std::memory_order_acquire);
      drain();
      if (last) return;
      std::this_thread::sleep_for(kRecorderInterval);
    }
  });
}

void Recorder::stop_thread() {
  if (!thread_.joinable()) return;
  stopping_.store(true, std::memory_order_release);
  thread_.join();
}

void Recorder::drain() {
  std::array<RecordingRow, 64> batch;
  std::size_t count = 0;
  const auto write = [&] {
    // After a failure rows are taken off and dropped, so that the haptic side never fills up.
    if (!error_) {
      if (Result<void> done = writer_.append(std::span(batch.data(), count)); !done) {
        error_ = done.error();
      }
    }
    count = 0;
  };
  while (rows_.pop(batch[count])) {
    if (++count == batch.size()) write();
  }
  write();
}

Result<void> Recorder::finish() {
  stop_thread();
  drain();
  if (error_) return *error_;
  if (const std::uint64_t lost = lost_.load(); lost > 0) {
    return unwritable("recording: " + std::to_string(lost) +
                      " rows were lost: the disk is too slow");
  }
  return writer_.commit();
}

}  // namespace trocar::runtime
