// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/remesher.h"

namespace trocar::runtime {
namespace {

constexpr std::chrono::milliseconds kPollInterval{1};

}  // namespace

Remesher::ReplicaPair::ReplicaPair(const Sheet& sheet)
    : first(sheet), replica{sheet, sheet}, published(replica.data()), used(replica.data()) {
  first.mesh.remove_spare_slots();
  reserve_touched(change.triangles, kReservedChanges);
  reserve_touched(change.vertices, kReservedChanges);
  for (Sheet& each : replica)
    reserve_pages(each);
}

Remesher::Remesher(const std::vector<std::unique_ptr<const Sheet>>& sheets) {
  for (const auto& sheet : sheets) {
    vertex_slots_ = std::max(vertex_slots_, sheet->mesh.vertices.size());
    triangle_slots_ = std::max(triangle_slots_, sheet->mesh.triangles.size());
    pairs_.push_back(std::make_unique<ReplicaPair>(*sheet));
  }
  make_workspaces();
  ready_.reserve(pairs_.size());
  records_.reserve(kMaxRecords);
  hole_points_.reserve(kMaxHolePoints);
  ring_end_.reserve(kMaxHolePoints / 3);
}

void Remesher::make_cut_workspace() {
  work_ = std::make_unique<CutWorkspace>(
      capacity_for(std::min(vertex_slots_, work_slots_), std::min(triangle_slots_, work_slots_)));
}

void Remesher::make_workspaces() {
  make_cut_workspace();
  refinement_ = std::make_unique<LocalRefinementWorkspace>(vertex_slots_, triangle_slots_);
  edit_ = SheetEdit(vertex_slots_, triangle_slots_);
}

Remesher::~Remesher() {
  stop();
}

const Sheet* Remesher::current(std::size_t sheet, std::uint64_t versions) noexcept {
  ReplicaPair& pair = *pairs_[sheet];
  const Sheet* latest = pair.published.load(std::memory_order_acquire);
  // Before the haptic thread has taken a version, no further one of the sheet is made. So
  // `publication` is that of `latest`, and the version used until now is the one before it.
  if (latest != pair.used && pair.publication.load(std::memory_order_relaxed) > versions)
    return pair.used;
  pair.used = latest;
  // Versions only get newer, so the haptic thread does not read older ones from here on.
  pair.used_cuts.store(latest->cuts, std::memory_order_release);
  return latest;
}

void Remesher::catch_up(ReplicaPair& pair) {
  if (!pair.older_is_behind || pair.unpublished) return;
  const Sheet& newer = pair.replica[pair.newer];
  if (pair.used_cuts.load(std::memory_order_acquire) < newer.cuts && !reader_stopped_) return;
  Sheet& older = pair.replica[1 - pair.newer];
  if (older.mesh.triangles.size() < newer.mesh.triangles.size()) {
    older.mesh.add_slots(newer.mesh.vertices.size() - older.mesh.vertices.size(),
                         newer.mesh.triangles.size() - older.mesh.triangles.size());
    older.grid.add_slots(older.mesh);
    older.boundary_grid.add_slots(older.mesh);
  }
  reserve_pages(older);
  pair.change.copy_to(newer.mesh, older.mesh);
  older.grid.update(pair.change, older.mesh);
  older.boundary_grid.update(pair.change, older.mesh);
  older.cuts = newer.cuts;
  pair.older_is_behind = false;
}

void Remesher::improve(Sheet& sheet, CutRecord& record) noexcept {
  LocalRefinementOptions options;
  options.min_angle_deg = kMinHoleAngle_deg;
  const LocalRefinementResult result =
      refine_locally(sheet.mesh, edit_, work_->stitch.created, options, *refinement_);
  record.quality_vertices = result.vertices_added;
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

void Remesher::reserve_pages(Sheet& sheet) {
  sheet.mesh.reserve_pages(kReservedPages);
  sheet.grid.reserve_pages(kReservedPages);
  sheet.boundary_grid.reserve_pages(kReservedPages);
}

void Remesher::add_capacity(Sheet& older) {
  older.mesh.add_slots(kSpareVertices, kSpareTriangles);
  older.grid.add_slots(older.mesh);
  older.boundary_grid.add_slots(older.mesh);
  if (older.mesh.triangles.size() <= triangle_slots_ && older.mesh.vertices.size() <= vertex_slots_)
    return;
  vertex_slots_ = std::max(vertex_slots_, older.mesh.vertices.size());
  triangle_slots_ = std::max(triangle_slots_, older.mesh.triangles.size());
  make_workspaces();
}

CutReport Remesher::cut_with_capacity(Sheet& older, const LatticeOutline& outline) {
  reserve_pages(older);
  if (older.mesh.free_vertices.size() < kMinFreeVertices ||
      older.mesh.free_triangles.size() < kMinFreeTriangles)
    add_capacity(older);
  CutReport report;
  for (int attempt = 0; attempt < kMaxAttempts;) {
    report = cut_in_place(older.mesh, older.grid,
                          std::span(outline.points.data(), static_cast<std::size_t>(outline.size)),
                          *work_, edit_);
    if (report.outcome != CutOutcome::kCapacity) break;
    if (work_slots_ < std::max(vertex_slots_, triangle_slots_)) {
      work_slots_ *= 4;
      make_cut_workspace();
    } else if (++attempt < kMaxAttempts) {
      add_capacity(older);
    }
  }
  return report;
}

// Precondition: the older replica equals the newer one and is not visible to the haptic thread.
void Remesher::serve_one(const CutRequest& request) {
  const auto start = std::chrono::steady_clock::now();
  const auto index = static_cast<std::size_t>(request.sheet);
  ReplicaPair& pair = *pairs_[index];
  const std::uint32_t cuts = pair.replica[pair.newer].cuts;
  Sheet& next = pair.replica[1 - pair.newer];
  CutRecord record;
  record.request = request;
  if (request.cut != cuts + 1) {
    record.error = bug("hole " + std::to_string(cuts + 1) +
                       " of this slice could not be cut, so no later one is");
  } else {
    record.cut = cut_with_capacity(next, request.outline);
    if (record.cut.outcome == CutOutcome::kCut || record.cut.outcome == CutOutcome::kNoOverlap) {
      if (record.cut.outcome == CutOutcome::kCut) improve(next, record);
      next.grid.update(edit_.change(), next.mesh);
      next.boundary_grid.update(edit_.change(), next.mesh);
      pair.change = edit_.change();
      next.cuts = cuts + 1;
      keep_hole(record);
      pair.newer = 1 - pair.newer;
      pair.older_is_behind = true;
      pair.unpublished = true;
      ready_.push_back(index);
    } else if (record.cut.outcome == CutOutcome::kCapacity) {
      record.error = refused("cut: it exceeds the capacity of the mesh");
    } else {
      record.error = bug("cut: " + std::string(to_string(record.cut.outcome)) +
                         (record.cut.bug != nullptr ? std::string(": ") + record.cut.bug : ""));
    }
  }
  record.remesh_us =
      std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start).count();
  if (records_.size() < kMaxRecords) records_.push_back(record);
}

void Remesher::serve() {
  for (const auto& pair : pairs_)
    catch_up(*pair);
  CutRequest request;
  while (waiting_ || requests_.pop(request)) {
    if (waiting_) request = *waiting_;
    waiting_.reset();
    if (pairs_[static_cast<std::size_t>(request.sheet)]->older_is_behind) {
      waiting_ = request;
      return;
    }
    serve_one(request);
  }
}

bool Remesher::publish_next() {
  if (ready_.empty()) return false;
  ReplicaPair& pair = *pairs_[ready_.front()];
  ready_.erase(ready_.begin());
  const std::uint64_t publication = versions_published_.load(std::memory_order_relaxed) + 1;
  pair.publication.store(publication, std::memory_order_relaxed);
  pair.published.store(&pair.replica[pair.newer], std::memory_order_release);
  versions_published_.store(publication, std::memory_order_release);
  pair.unpublished = false;
  return true;
}

void Remesher::start(std::function<void()> between) {
  thread_.start(kPollInterval, [this, between = std::move(between)] {
    serve();
    while (publish_next()) {
    }
    if (between) between();
  });
}

void Remesher::stop() {
  thread_.stop();
  reader_stopped_ = true;
  do {
    serve();
  } while (publish_next() || waiting_);
  reader_stopped_ = false;
}

}  // namespace trocar::runtime
