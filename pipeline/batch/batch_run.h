// SPDX-License-Identifier: GPL-3.0-or-later
// A batch: selects the stale scans of a collection, meshes each one in a separate process, and
// summarises the outcomes.
#pragma once

#include <atomic>
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
#include "pipeline/batch/collection.h"
#include "pipeline/batch/garbage.h"
#include "pipeline/batch/scan_worker.h"
#include "pipeline/batch/store.h"

namespace trocar::farm {

struct BatchSettings {
  std::filesystem::path store;
  /// {I, N}: only the scans with the numbers I, I+N, I+2N and so on are selected; the first scan of
  /// the collection has the number 0. std::nullopt: no scan is excluded.
  std::optional<std::pair<int, int>> shard;
  std::optional<std::set<std::string>> only;  ///< names of the scans to select; std::nullopt: all
  int jobs = 1;  ///< largest number of scans that are worked on at the same time, at least 1
  /// rehash: read all inputs, even those with unchanged size, time and inode.
  /// verify: check the stored outputs of the selected scans, and make damaged ones again.
  /// Outputs of known failures are checked only if `rehash` or `retry` is set.
  bool rehash = false, verify = false;
  bool retry = false;  ///< try known failures (see BatchSummary::known) again
  /// After this number of failures, no further scan is started; 0: no limit. Known failures are
  /// not counted.
  std::size_t max_failures = 0;
  /// A flag that a signal handler sets; may be null. Once it is set, no further scan is started,
  /// and the running scans are ended.
  const std::atomic<bool>* stop = nullptr;
  /// Called after each scan. `done` counts the finished scans, `failed` the failures among them
  /// (without known failures), and `total` all scans on which this run works.
  std::function<void(std::size_t done, std::size_t failed, std::size_t total)> progress;
};

struct FailedScan {
  std::string scan;
  Outcome outcome;
};

/// The warnings of a scan that has an asset (ScanEntry::warnings).
struct WarnedScan {
  std::string scan;
  nlohmann::json warnings;
};

/// Numbers of a run. Each selected scan is in one class: unchanged, made, found, failed, known or
/// left.
struct BatchSummary {
  std::size_t scans = 0;           ///< all selected scans
  std::size_t unchanged = 0;       ///< done by an earlier run
  std::size_t made = 0;            ///< computed by this run
  std::size_t found = 0;           ///< changed, but the store already had the new outputs
  std::size_t left = 0;            ///< not finished, because of a signal or of `max_failures`
  std::vector<FailedScan> failed;  ///< scans that failed in this run, in the collection's order
  /// Known failures, in the collection's order. This run did not try them again.
  std::vector<FailedScan> known;
  /// The scans with warnings, sorted by name: of those that this run made or found, and of those that
  /// an earlier run has made.
  std::vector<WarnedScan> warned;
  /// Names of those scans in the class `made` that were done and unchanged according to the store's
  /// index. With `verify`, a file of such a scan in the store was damaged; with `rehash`, one of
  /// its inputs had other bytes.
  std::vector<std::string> made_again;
  /// Total size of the assets that this run has made or found up to date. Scans in the class `left`
  /// add nothing.
  std::uint64_t asset_bytes = 0;
  bool has_unrecorded = false;  ///< true: a failure could not be written to the index
  bool has_journal = true;      ///< false: a line of the journal could not be written
  double seconds = 0;           ///< duration of the run
};

struct NamedState {
  std::string scan;
  ScanState state;
};

/// The selected scans of a collection. Precondition: the collection's folder is the working
/// directory, because the paths of the scans are relative to it.
class Batch {
 public:
  /// Selects the scans, and checks the parameters of all scans of the collection. `collection` and
  /// `program` must outlive the batch. Errors: kUsage if a scan has wrong parameters, or if `only`
  /// has a name that the collection lacks.
  static Result<Batch> plan(const Collection& collection, const ScanProgram& program,
                            BatchSettings settings);

  std::size_t scans() const { return wanted_.size(); }
  /// The states of the selected scans. A run would work on those that are stale. Errors: those of
  /// Store::open_for_reading().
  Result<std::vector<NamedState>> dry_run() const;
  /// The state of one selected scan. Input files whose time or inode has changed are read, to
  /// find out whether their bytes have changed too. With BatchSettings::rehash all input files are
  /// read. Errors: kUsage if there is no such scan; those of Store::open_for_reading().
  Result<ScanState> explain(const std::string& scan) const;
  /// Works on the stale scans. Precondition: the process has no other threads yet, because this
  /// function starts processes by fork(). Errors: those of Store::open_for_writing(); kBug if no
  /// process can be created. If there is nothing to do, a store that cannot be written is no error.
  Result<BatchSummary> run() const;

 private:
  explicit Batch(const ScanProgram& program) : program_(&program) {}

  const ScanProgram* program_;
  BatchSettings settings_;
  std::vector<WantedScan> wanted_;
  /// The parameters of the scans. Scans with equal parameters share one element. Parameters that
  /// name a refused file have no element.
  std::vector<std::unique_ptr<Parameters>> parameters_;
};

}  // namespace trocar::farm
