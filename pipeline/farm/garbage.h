// SPDX-License-Identifier: GPL-3.0-or-later
// Garbage collection of a store (`trocar-mesh batch --gc`): removes actions and outputs that no
// scan in the store's index needs. Outputs are the files of assets, reports and products.
// Tests: tests/pipeline/farm/store_test.cpp
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>

#include "formats/base/result.h"
#include "pipeline/farm/store.h"

namespace trocar::farm {

struct Collected {
  std::size_t removed = 0, kept = 0;  ///< numbers of files, of actions and outputs together
  std::uint64_t bytes = 0;            ///< total size of the removed files
};

/// Removes the files of actions that no index entry refers to, and outputs that no remaining action
/// refers to. Files younger than `grace` are kept, and so are actions for which a process holds a
/// lease (lease.h). Batches may run at the same time, and a batch renews the time of a file that it
/// finds. An old file is therefore first moved away, so that no batch finds it any more. If a batch
/// had renewed the file's time just before this move, the file is moved back. Errors: kUnwritable
/// if no file can be written in the store.
Result<Collected> collect_garbage(const Store& store, std::chrono::nanoseconds grace);

}  // namespace trocar::farm
