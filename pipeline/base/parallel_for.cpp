// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/base/parallel_for.h"

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include <atomic>

namespace trocar::pipeline {
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

}  // namespace trocar::pipeline
