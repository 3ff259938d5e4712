// SPDX-License-Identifier: Apache-2.0
// Counts the allocations of realtime code: calls of malloc, calloc, realloc, aligned_alloc,
// posix_memalign and free (and so of new and delete) on a thread that is inside a
// NoAllocationScope.
//
// Only programs that link the target trocar_allocation_hooks (tests/reference/hooks) count. The
// shipped programs and sanitizer builds do not; a scope costs them one thread-local store.
// Tests: tests/runtime/realtime/handover_test.cpp
#pragma once

#include <cstdint>

namespace trocar::runtime {

/// Does this program count allocations?
bool allocations_are_counted() noexcept;
/// Number of allocations of all threads inside scopes since the start; 0 if they are not counted.
std::uint64_t allocations_in_scopes() noexcept;

/// While a scope exists, its thread's allocations are counted. Scopes may not nest.
class NoAllocationScope {
 public:
  NoAllocationScope() noexcept;
  ~NoAllocationScope();
  NoAllocationScope(const NoAllocationScope&) = delete;
  NoAllocationScope& operator=(const NoAllocationScope&) = delete;
};

// The hooks call the following functions.
/// Is the calling thread inside a scope?
bool in_no_allocation_scope() noexcept;
/// Counts one allocation by the calling thread if it is inside a scope.
void note_allocation() noexcept;
/// Makes this program one that counts.
void announce_allocation_hooks() noexcept;

}  // namespace trocar::runtime
