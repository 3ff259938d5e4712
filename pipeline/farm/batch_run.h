// SPDX-License-Identifier: GPL-3.0-or-later
// A batch: which scans are to be worked on, each in a process of its own, and what became of them.
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
  std::optional<std::pair<int, int>> shard;   ///< I of N, I from 0
  std::optional<std::set<std::string>> only;  ///< names
  int jobs = 1;                               ///< scans at once, at least 1
  bool rehash = false, verify = false;
  /// Not null: set from a signal handler. No more scans are begun, and those in hand end.
  const std::atomic<bool>* stop = nullptr;
  /// Called after each scan, with how many are finished, failed and to be done.
  std::function<void(std::size_t done, std::size_t failed, std::size_t total)> progress;
};

struct FailedScan {
  std::string scan;
  Outcome outcome;
};

struct BatchSummary {
  std::size_t scans = 0, unchanged = 0, made = 0, found = 0, left = 0;
  std::vector<FailedScan> failed;  ///< in the collection's order
  bool has_unrecorded = false;     ///< a failure that is not in the index
  bool has_journal = true;         ///< false: some line could not be written
  double seconds = 0;
};

/// A scan that is to be worked on, and why.
struct StaleScan {
  std::string scan;
  std::vector<nlohmann::json> why;
};

/// The scans of the collection that are this run's, all parameters checked before anything is
/// begun. The collection's folder must be the working directory.
class Batch {
 public:
  /// `collection`, `program` and `digest` (of the program) must outlive the batch. Errors (usage):
  /// a scan with wrong parameters, a name in `only` that the collection does not have.
  static Result<Batch> plan(const Collection& collection, const ScanProgram& program,
                            const std::string& digest, BatchSettings settings);

  std::size_t scans() const { return wanted_.size(); }
  /// What a run would work on. Errors: of the store.
  Result<std::vector<StaleScan>> dry_run() const;
  /// Why a scan is stale; empty: it is not. Errors: (usage) no such scan; of the store.
  Result<std::vector<nlohmann::json>> explain(const std::string& scan) const;
  /// To be called before the process has any threads. Errors: of the store.
  Result<BatchSummary> run() const;

 private:
  explicit Batch(const ScanProgram& program) : program_(&program) {}

  const ScanProgram* program_;
  BatchSettings settings_;
  std::vector<WantedScan> wanted_;
  /// Scans have few different parameters: each is kept once. Null: a file that they name is
  /// refused.
  std::vector<std::unique_ptr<Parameters>> parameters_;
};

}  // namespace trocar::farm
