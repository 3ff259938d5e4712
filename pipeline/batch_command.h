// SPDX-License-Identifier: GPL-3.0-or-later
// `trocar-mesh batch`: a collection of scans into a store (farm/store.md), and its output.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

struct BatchArguments {
  std::filesystem::path collection, store, only;
  std::string shard, explain;
  int jobs = 0;
  double grace_minutes = 60;
  bool dry_run = false, as_json = false, rehash = false, verify = false, gc = false, prune = false,
       quiet = false;
};

/// Declares the options; `a` must outlive the app.
void add_batch_options(CLI::App& app, BatchArguments& a);

/// Gives the exit code: 0; 2 wrong options or collection; 3 a scan failed; 4 the store could not be
/// written, or interrupted.
int run_batch(const BatchArguments& a);

/// A first collection of the scans that `list` found in `folder`, as text. Warnings: images, which
/// need parameters.
std::string collection_of(const nlohmann::json& list, const std::filesystem::path& folder,
                          std::vector<Warning>& warnings);

}  // namespace trocar::pipeline
