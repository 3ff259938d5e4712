// SPDX-License-Identifier: GPL-3.0-or-later
// Garbage collection: removes actions and contents that no scan of the index refers to.
// Tests: tests/pipeline/farm/store_test.cpp
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>

#include "formats/base/result.h"
#include "pipeline/farm/store.h"

namespace trocar::farm {

struct Collected {
  std::size_t removed = 0, kept = 0;  ///< numbers of actions and content files
  std::uint64_t bytes = 0;            ///< total size of the removed files
};

/// Removes actions that no index entry refers to, and contents that no remaining action refers to,
/// unless they are younger than `grace` or their key is leased (lease.h). Batches may run at the
/// same time: a file is first moved away, and is moved back if a batch has renewed its time.
/// Errors: kUnwritable if no file can be written in the store.
Result<Collected> collect_garbage(const Store& store, std::chrono::nanoseconds grace);

}  // namespace trocar::farm
