// SPDX-License-Identifier: GPL-3.0-or-later
// Garbage collection of a store (`trocar-mesh batch --gc`): removes actions and outputs that no
// scan in the store's index needs. What an entry or an action names is needed; if one of them cannot
// be read, nothing is removed. Outputs are the files that actions have made: assets and reports.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <set>
#include <string>

#include "formats/base/result.h"
#include "pipeline/batch/store.h"

namespace trocar::farm {

struct Collected {
  /// Number of files that were removed, and number of files that were kept. Both numbers count the
  /// files of actions and the outputs.
  std::size_t removed = 0, kept = 0;
  std::uint64_t bytes = 0;  ///< total size of the removed files
  std::size_t dropped = 0;  ///< number of entries that were dropped
};

/// Drops the index entries of scans whose names are not in `wanted` (null: none). Then removes the
/// files of actions that no entry refers to, and outputs that neither an entry nor a remaining action
/// refers to. Files younger than `grace` are kept, and so are actions for which a process holds a
/// lease (lease.h). A time in the future protects a file only if it is within `grace` or 60 s.
/// Batches may run at the same time. A batch that uses a file of the store sets
/// the file's time to the present, so that the file counts as young. An old file is therefore
/// removed in two steps. First it is moved away, so that no batch can use it any more. Then its
/// time is read again: if a batch had set it to the present just before the move, the file is moved
/// back, otherwise it is deleted. Errors: kRefused if an entry, an action or a folder cannot be read
/// or is damaged, so that nothing is removed; kUnwritable if no file can be written in the store, or
/// if an entry cannot be dropped.
Result<Collected> collect_garbage(const Store& store, std::chrono::nanoseconds grace,
                                  const std::set<std::string>* wanted = nullptr);

}  // namespace trocar::farm
