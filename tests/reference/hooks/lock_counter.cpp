// SPDX-License-Identifier: Apache-2.0
#include "tests/reference/hooks/lock_counter.h"

#include <atomic>

#include "runtime/realtime/realtime_thread.h"

namespace trocar::runtime {
namespace {

std::atomic<std::uint64_t> locks{0};

}  // namespace

std::uint64_t locks_in_scopes() noexcept {
  return locks.load(std::memory_order_relaxed);
}
void note_lock() noexcept {
  if (in_no_allocation_scope()) locks.fetch_add(1, std::memory_order_relaxed);
}

}  // namespace trocar::runtime
