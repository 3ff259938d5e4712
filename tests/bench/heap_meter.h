// SPDX-License-Identifier: Apache-2.0
// Bytes allocated by operator new and not yet freed: now, and at most. A program that links
// heap_meter.cpp counts from its start; on one thread or several.
#pragma once

#include <cstdint>

namespace trocar::test {

struct HeapBytes {
  std::int64_t now = 0, most = 0;
};
HeapBytes heap_bytes() noexcept;
/// Restarts `most` from the present value.
void reset_heap_peak() noexcept;

}  // namespace trocar::test
