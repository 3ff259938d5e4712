// SPDX-License-Identifier: GPL-3.0-or-later
// What no scan of the index leads to.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>

#include "formats/base/result.h"
#include "pipeline/farm/store.h"

namespace trocar::farm {

struct Collected {
  std::size_t removed = 0, kept = 0;  ///< actions, and files of content
  std::uint64_t bytes = 0;            ///< of what was removed
};

/// Removes actions that no entry of the index leads to, and content that no action that stays
/// leads to, unless it is younger than `grace` or its key is claimed. Batches may run meanwhile: a
/// file is first moved away, and put back if a batch has renewed its time. Errors: unwritable.
Result<Collected> collect_garbage(const Store& store, std::chrono::nanoseconds grace);

}  // namespace trocar::farm
