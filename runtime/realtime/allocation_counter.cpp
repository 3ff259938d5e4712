// SPDX-License-Identifier: Apache-2.0
#include "runtime/realtime/allocation_counter.h"

#include <atomic>

namespace trocar::runtime {
namespace {

std::atomic<bool> hooked{false};
std::atomic<std::uint64_t> counted{0};
std::atomic<bool> locks_hooked{false};
std::atomic<std::uint64_t> locks{0};
thread_local constinit bool inside = false;

}  // namespace

bool allocations_are_counted() noexcept {
  return hooked.load(std::memory_order_relaxed);
}
std::uint64_t allocations_in_scopes() noexcept {
  return counted.load(std::memory_order_relaxed);
}

bool locks_are_counted() noexcept {
  return locks_hooked.load(std::memory_order_relaxed);
}
std::uint64_t locks_in_scopes() noexcept {
  return locks.load(std::memory_order_relaxed);
}

NoAllocationScope::NoAllocationScope() noexcept {
  inside = true;
}
NoAllocationScope::~NoAllocationScope() {
  inside = false;
}

void note_allocation() noexcept {
  if (inside) counted.fetch_add(1, std::memory_order_relaxed);
}
void announce_allocation_hooks() noexcept {
  hooked.store(true, std::memory_order_relaxed);
}

void note_lock() noexcept {
  if (inside) locks.fetch_add(1, std::memory_order_relaxed);
}
void announce_lock_hooks() noexcept {
  locks_hooked.store(true, std::memory_order_relaxed);
}

}  // namespace trocar::runtime
