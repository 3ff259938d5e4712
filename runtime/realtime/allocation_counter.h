// SPDX-License-Identifier: Apache-2.0
// Counts what a realtime scope may not do: calls of malloc, calloc, realloc,
// aligned_alloc, posix_memalign and free (and so of new and delete) on the scope's thread.
// The counting itself is in allocation_hooks.cpp, which a program links as objects
// (target trocar_allocation_hooks, empty under sanitizers); without it nothing is counted. Locks
// taken there (mutexes, condition variables, semaphores) are counted likewise by lock_hooks.cpp
// (target trocar_lock_hooks), which only tests link.
#pragma once

#include <cstdint>

namespace trocar::runtime {

/// Are the hooks linked in?
bool allocations_are_counted() noexcept;
/// By all threads, inside scopes, since the start.
std::uint64_t allocations_in_scopes() noexcept;

/// The same of locks.
bool locks_are_counted() noexcept;
std::uint64_t locks_in_scopes() noexcept;

/// While it lives, its thread's allocations and locks are counted. Scopes may not nest.
class NoAllocationScope {
 public:
  NoAllocationScope() noexcept;
  ~NoAllocationScope();
  NoAllocationScope(const NoAllocationScope&) = delete;
  NoAllocationScope& operator=(const NoAllocationScope&) = delete;
};

/// For the hooks.
void note_allocation() noexcept;
void announce_allocation_hooks() noexcept;
void note_lock() noexcept;
void announce_lock_hooks() noexcept;

}  // namespace trocar::runtime
