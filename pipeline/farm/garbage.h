// SPDX-License-Identifier: GPL-3.0-or-later
// Garbage collection (`--gc`): removes actions and contents to which no scan of the index refers.
// Tests: tests/pipeline/farm/store_test.cpp
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>

#include "formats/base/result.h"
#include "pipeline/farm/store.h"

namespace trocar::farm {

struct Collected {
  std::size_t removed = 0, kept = 0;  ///< numbers of files: actions and contents together
  std::uint64_t bytes = 0;            ///< total size of the removed files
};

/// Removes the files of actions that no index entry refers to, and contents that no remaining
/// action refers to. Files younger than `grace` and actions whose key is leased (lease.h) are kept.
/// Batches may run at the same time: a file is first moved away. If a batch renewed the file's time
/// just before this move, the file is moved back. Errors: kUnwritable if no file can be written in
/// the store.
Result<Collected> collect_garbage(const Store& store, std::chrono::nanoseconds grace);

}  // namespace trocar::farm
