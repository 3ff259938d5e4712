// SPDX-License-Identifier: Apache-2.0
// For tests that count allocations. Under a sanitizer, whose allocator takes the place of the
// hooks, they are skipped; elsewhere a test that does not link trocar_allocation_hooks fails.
#pragma once

#include <gtest/gtest.h>

#include "runtime/realtime/realtime_thread.h"

#ifdef TROCAR_SANITIZED
#define TROCAR_NEEDS_COUNTED_ALLOCATIONS() \
  GTEST_SKIP() << "the sanitizer's allocator takes the place of the hooks"
#else
#define TROCAR_NEEDS_COUNTED_ALLOCATIONS()                \
  ASSERT_TRUE(trocar::runtime::allocations_are_counted()) \
      << "this program does not link trocar_allocation_hooks"
#endif

namespace trocar::runtime {

/// The allocations of `act()` in a realtime scope.
template <typename Act>
std::uint64_t allocations_of(Act&& act) {
  const std::uint64_t before = allocations_in_scopes();
  {
    const NoAllocationScope scope;
    act();
  }
  return allocations_in_scopes() - before;
}

}  // namespace trocar::runtime
