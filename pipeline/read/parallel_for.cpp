// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/parallel_for.h"

#include <malloc.h>
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>
#include <atomic>
#include <limits>
#include <vector>

namespace trocar::pipeline {

void keep_freed_memory() {
#ifdef __GLIBC__
  // There are no other threads yet. NOLINTBEGIN(concurrency-mt-unsafe)
  mallopt(M_MMAP_THRESHOLD, std::numeric_limits<int>::max());
  mallopt(M_TRIM_THRESHOLD, -1);  // never
  // NOLINTEND(concurrency-mt-unsafe)
#endif
}

namespace {

// The function object that TBB copies and calls. TBB synchronises the tasks with the code before
// and after the loop inside its library, where ThreadSanitizer cannot observe it. `begun` and
// `ended` repeat this synchronisation, so that ThreadSanitizer can check the data that tasks share
// (scripts/lib/tsan.supp excludes this file only).
struct TaskRange {
  const std::function<void(int)>* task;
  std::atomic<int>*begun, *ended;
  void operator()(const oneapi::tbb::blocked_range<int>& range) const {
    begun->load(std::memory_order_acquire);
    for (int i = range.begin(); i < range.end(); ++i)
      (*task)(i);
    ended->fetch_add(1, std::memory_order_release);
  }
};

}  // namespace

void parallel_for(int count, const std::function<void(int)>& task) {
  std::atomic<int> begun{0}, ended{0};
  begun.store(1, std::memory_order_release);
  oneapi::tbb::parallel_for(oneapi::tbb::blocked_range<int>(0, count),
                            TaskRange{&task, &begun, &ended}, oneapi::tbb::simple_partitioner());
  ended.load(std::memory_order_acquire);
}

Result<void> try_in_parallel(int count, const std::function<Result<void>(int)>& task) {
  std::vector<Result<void>> done(static_cast<std::size_t>(count));
  parallel_for(count, [&](int i) { done[static_cast<std::size_t>(i)] = task(i); });
  for (const Result<void>& one : done)
    if (!one) return one;
  return {};
}

}  // namespace trocar::pipeline
