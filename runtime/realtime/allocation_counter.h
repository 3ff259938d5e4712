// SPDX-License-Identifier: Apache-2.0
// Counts the allocations of realtime code: calls of malloc, calloc, realloc,
// aligned_alloc, posix_memalign and free (and so of new and delete) on a thread that is
// inside a NoAllocationScope.
//
// Only programs that link the target trocar_allocation_hooks (tests/reference/hooks) count
// allocations. The shipped programs and sanitizer builds do not count them. There the beginning and
// the end of a scope cost one thread-local store each.
// Tests: tests/runtime/realtime/handover_test.cpp
#pragma once

#include <cstdint>

namespace trocar::runtime {

/// Returns true if this program counts allocations.
bool allocations_are_counted() noexcept;
/// Returns the number of allocations of all threads inside scopes since the start; 0 if they
/// are not counted.
std::uint64_t allocations_in_scopes() noexcept;

/// While a scope exists, its thread's allocations are counted. Scopes may not nest.
class NoAllocationScope {
 public:
  NoAllocationScope() noexcept;
  ~NoAllocationScope();
  NoAllocationScope(const NoAllocationScope&) = delete;
  NoAllocationScope& operator=(const NoAllocationScope&) = delete;
};

// The allocation hooks call the following functions.

/// Returns true if the calling thread is inside a scope.
bool in_no_allocation_scope() noexcept;
/// Counts one allocation by the calling thread if it is inside a scope.
void note_allocation() noexcept;
/// Registers the hooks, so that allocations_are_counted() returns true.
void announce_allocation_hooks() noexcept;

}  // namespace trocar::runtime
