// SPDX-License-Identifier: Apache-2.0
// Counts what a realtime scope may not do: calls of malloc, calloc, realloc,
// aligned_alloc, posix_memalign and free (and so of new and delete) on the scope's thread.
// The counting itself is in allocation_hooks.cpp, which a program links as objects
// (target trocar_allocation_hooks, empty under sanitizers); without it nothing is counted.
#pragma once

#include <cstdint>

namespace trocar::runtime {

/// Are the hooks linked in?
bool allocations_are_counted() noexcept;
/// By all threads, inside scopes, since the start.
std::uint64_t allocations_in_scopes() noexcept;

/// While it lives, its thread's allocations are counted. Scopes may not nest.
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

}  // namespace trocar::runtime
