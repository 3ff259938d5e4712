// SPDX-License-Identifier: Apache-2.0
// Counts the allocations of realtime code: calls of malloc, calloc, realloc, aligned_alloc,
// posix_memalign and free (and so of new and delete) on a thread that is inside a
// NoAllocationScope.
//
// Programs that link the target trocar_allocation_hooks (tests/reference/hooks) count; the shipped
// programs and sanitizer builds do not, and there a scope costs one thread-local store.
#pragma once

#include <cstdint>

namespace trocar::runtime {

/// Whether this program counts.
bool allocations_are_counted() noexcept;
/// By all threads, inside scopes, since the start; 0 where nothing is counted.
std::uint64_t allocations_in_scopes() noexcept;

/// While it exists, its thread's allocations are counted. Scopes may not nest.
class NoAllocationScope {
 public:
  NoAllocationScope() noexcept;
  ~NoAllocationScope();
  NoAllocationScope(const NoAllocationScope&) = delete;
  NoAllocationScope& operator=(const NoAllocationScope&) = delete;
};

/// For the hooks: whether the calling thread is inside a scope.
bool in_no_allocation_scope() noexcept;
/// For the hooks: one allocation by the calling thread; counted inside a scope only.
void note_allocation() noexcept;
/// For the hooks: from now on this program counts.
void announce_allocation_hooks() noexcept;

}  // namespace trocar::runtime
