// SPDX-License-Identifier: Apache-2.0
// Counts the allocations of realtime code, so that tests can demand that there are none. If the
// calling thread is inside a NoAllocationScope, calls of malloc, calloc, realloc, aligned_alloc,
// posix_memalign and free are counted. Calls of new and delete are counted too, because they use
// these functions.
//
// Only programs that link the target trocar_allocation_hooks (tests/reference/hooks) count
// allocations. In the shipped programs and in sanitizer builds nothing is counted. There, a scope
// costs almost no time: it writes a thread-local variable at its beginning and at its end.
#pragma once

#include <cstdint>

namespace trocar::runtime {

/// Returns true if this program counts allocations.
bool allocations_are_counted() noexcept;
/// Returns the number of allocations inside scopes, of all threads together, since the program
/// started. Returns 0 if this program does not count allocations.
std::uint64_t allocations_in_scopes() noexcept;

/// While a scope exists, the allocations of the thread that created the scope are counted. A thread
/// must not create a scope inside another scope.
class NoAllocationScope {
 public:
  NoAllocationScope() noexcept;
  ~NoAllocationScope();
  NoAllocationScope(const NoAllocationScope&) = delete;
  NoAllocationScope& operator=(const NoAllocationScope&) = delete;
};

// Only the hooks in tests/reference/hooks call the following functions.

/// Returns true if the calling thread is inside a scope.
bool in_no_allocation_scope() noexcept;
/// Counts one allocation by the calling thread if it is inside a scope.
void note_allocation() noexcept;
/// The allocation hooks call this once. Afterwards allocations_are_counted() returns true.
void announce_allocation_hooks() noexcept;

}  // namespace trocar::runtime
