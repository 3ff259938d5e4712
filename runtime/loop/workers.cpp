// SPDX-License-Identifier: Apache-2.0
#include "runtime/loop/workers.h"

#include <chrono>
#include <utility>

namespace trocar::runtime {
namespace {

// The haptic thread wakes nobody: a system call a puncture would be a delay.
constexpr std::chrono::milliseconds kPollInterval{1};
constexpr std::chrono::milliseconds kRecorderInterval{20};

}  // namespace

Remesher::Remesher(std::vector<std::unique_ptr<const Sheet>> sheets) {
  for (auto& sheet : sheets) {
    auto lane = std::make_unique<Lane>();
    lane->published.store(sheet.get(), std::memory_order_release);
    lane->versions.push_back(std::move(sheet));
    lanes_.push_back(std::move(lane));
  }
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

void Remesher::let_go(Lane& lane) {
  // The first version stays for reports, the last one for the next cut.
  const std::uint32_t seen = lane.seen_cuts.load(std::memory_order_acquire);
  while (lane.versions.size() > 2 && lane.versions[1]->cuts < seen) {
    lane.versions.erase(lane.versions.begin() + 1);
  }
}

void Remesher::serve_one(const CutRequest& request) {
  const auto start = std::chrono::steady_clock::now();
  Lane& lane = *lanes_[static_cast<std::size_t>(request.sheet)];
  const Sheet& before = *lane.versions.back();
  CutRecord record;
  record.request = request;
  record.doubled_area_before = doubled_area(before.mesh);
  Result<CutResult> result = cut(before.mesh, to_ring(request.outline));
  if (!result) {
    record.error = result.error();
  } else if (request.cut != before.cuts + 1) {
    record.error = bug("a cut before this one failed");
  } else {
    record.hole = std::move(result->hole);
    record.doubled_area_removed = result->doubled_area_removed;
    record.triangles_removed = result->triangles_removed;
    record.triangles_created = result->triangles_created;
    lane.versions.push_back(with_mesh(before, std::move(result->mesh)));
    ready_.emplace_back(static_cast<std::size_t>(request.sheet), lane.versions.back().get());
  }
  record.remesh_us =
      std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start).count();
  records_.push_back(std::move(record));
}

void Remesher::serve() {
  CutRequest request;
  while (requests_.pop(request))
    serve_one(request);
}

bool Remesher::publish_next() {
  if (ready_.empty()) return false;
  const auto [index, sheet] = ready_.front();
  ready_.pop_front();
  lanes_[index]->published.store(sheet, std::memory_order_release);
  let_go(*lanes_[index]);
  return true;
}

void Remesher::start(std::function<void()> between) {
  stopping_.store(false);
  thread_ = std::thread([this, between = std::move(between)] {
    for (;;) {
      const bool last = stopping_.load(std::memory_order_acquire);
      serve();
      while (publish_next()) {
      }
      if (last) return;
      if (between) between();
      std::this_thread::sleep_for(kPollInterval);
    }
  });
}

void Remesher::stop() {
  if (!thread_.joinable()) return;
  stopping_.store(true, std::memory_order_release);
  thread_.join();
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
