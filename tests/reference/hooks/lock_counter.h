// SPDX-License-Identifier: Apache-2.0
// Counts the locks (mutexes, read-write locks, condition variables, semaphores) that a thread takes
// inside a NoAllocationScope, in programs that link the target trocar_lock_hooks; sanitizer builds
// count nothing.
#pragma once

#include <cstdint>

namespace trocar::runtime {

/// Number of locks of all threads inside scopes since the start.
std::uint64_t locks_in_scopes() noexcept;
/// Called by the hooks: counts one lock by the calling thread if it is inside a scope.
void note_lock() noexcept;

}  // namespace trocar::runtime
