// SPDX-License-Identifier: Apache-2.0
#include "runtime/realtime/allocation_counter.h"

#include <atomic>

namespace trocar::runtime {
namespace {

std::atomic<bool> hooked{false};
std::atomic<std::uint64_t> counted{0};
thread_local constinit bool inside = false;

}  // namespace

bool allocations_are_counted() noexcept {
  return hooked.load(std::memory_order_relaxed);
}
std::uint64_t allocations_in_scopes() noexcept {
  return counted.load(std::memory_order_relaxed);
}

NoAllocationScope::NoAllocationScope() noexcept {
  inside = true;
}
NoAllocationScope::~NoAllocationScope() {
  inside = false;
}

bool in_no_allocation_scope() noexcept {
  return inside;
}
void note_allocation() noexcept {
  if (inside) counted.fetch_add(1, std::memory_order_relaxed);
}
void announce_allocation_hooks() noexcept {
  hooked.store(true, std::memory_order_relaxed);
}

}  // namespace trocar::runtime
