// SPDX-License-Identifier: GPL-3.0-or-later
// A batch: selects the stale scans of a collection, meshes each one in a separate process, and
// summarises the outcomes.
// Tests: tests/pipeline/farm/worker_test.cpp
#pragma once

#include <atomic>
#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/farm/collection.h"
#include "pipeline/farm/garbage.h"
#include "pipeline/farm/scan_program.h"
#include "pipeline/farm/scan_worker.h"
#include "pipeline/farm/store.h"

namespace trocar::farm {

struct BatchSettings {
  std::filesystem::path store;
  std::optional<std::pair<int, int>> shard;   ///< I and N: works on shard I, counted from 0, of N
  std::optional<std::set<std::string>> only;  ///< names of the scans to work on
  int jobs = 1;                               ///< number of concurrent scans, at least 1
  bool rehash = false, verify = false;
  /// A flag that a signal handler sets; may be null. Once it is set, no further scan is started,
  /// and running scans end.
  const std::atomic<bool>* stop = nullptr;
  /// Called after each scan. The arguments are the numbers of finished, failed and all scans of
  /// this run.
  std::function<void(std::size_t done, std::size_t failed, std::size_t total)> progress;
};

struct FailedScan {
  std::string scan;
  Outcome outcome;
};

struct BatchSummary {
  std::size_t scans = 0, unchanged = 0, made = 0, found = 0, left = 0;
  std::vector<FailedScan> failed;  ///< in the collection's order
  bool has_unrecorded = false;     ///< true: a failure could not be written to the index
  bool has_journal = true;         ///< false if a line could not be written
  double seconds = 0;
};

/// A stale scan and the causes of its staleness.
struct StaleScan {
  std::string scan;
  std::vector<nlohmann::json> why;
};

/// The scans of the collection that this run selects. All parameters are checked before the first
/// scan starts. The collection's folder must be the working directory.
class Batch {
 public:
  /// `digest` is the program's SHA-256. `collection`, `program` and `digest` must outlive the
  /// batch. Errors: (usage) a scan has wrong parameters; the collection lacks a name of `only`.
  static Result<Batch> plan(const Collection& collection, const ScanProgram& program,
                            const std::string& digest, BatchSettings settings);

  std::size_t scans() const { return wanted_.size(); }
  /// The scans that a run would work on. Errors: those of opening the store.
  Result<std::vector<StaleScan>> dry_run() const;
  /// Reasons why a scan is stale; empty if it is not. Errors: (usage) no such scan; those of
  /// opening the store.
  Result<std::vector<nlohmann::json>> explain(const std::string& scan) const;
  /// Works on the stale scans. Call it before the process has other threads. Errors: those of
  /// opening the store.
  Result<BatchSummary> run() const;

 private:
  explicit Batch(const ScanProgram& program) : program_(&program) {}

  const ScanProgram* program_;
  BatchSettings settings_;
  std::vector<WantedScan> wanted_;
  /// The different sets of parameters, each one once. A null pointer stands for parameters that
  /// name a refused file.
  std::vector<std::unique_ptr<Parameters>> parameters_;
};

}  // namespace trocar::farm
