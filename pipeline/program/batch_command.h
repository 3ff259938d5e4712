// SPDX-License-Identifier: GPL-3.0-or-later
// `trocar-mesh batch`: makes the assets of a collection of scans in a store (farm/store.md).
#pragma once

#include <filesystem>
#include <string>

#include "pipeline/farm/batch_run.h"

namespace CLI {  // NOLINT(readability-identifier-naming): CLI11's
class App;
}  // namespace CLI

namespace trocar::pipeline {

struct BatchArguments {
  std::filesystem::path collection, only;
  farm::BatchSettings settings;
  std::string explain;
  double grace_minutes = 60;
  bool dry_run = false, as_json = false, gc = false, prune = false, strict = false, quiet = false;
};

/// Declares the options. Parsing writes their values to `a`.
void add_batch_options(CLI::App& command, BatchArguments& a);

/// Runs the batch and returns the exit code:
///  - 2: the options or the collection are wrong.
///  - 3: a scan failed in this run.
///  - 3, without --only and --shard: every scan of the collection failed in an earlier run and was
///    not tried again, and none of them has an asset.
///  - 3, only with --strict: a failure of an earlier run was not tried again.
///  - 4: the store could not be written, or a signal interrupted the run.
///  - 1: there was an internal error, for example if no process could be created.
///  - 0: none of these applies.
int run_batch(const BatchArguments& a);

}  // namespace trocar::pipeline
