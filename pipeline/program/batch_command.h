// SPDX-License-Identifier: GPL-3.0-or-later
// Opens and meshes the scans of `trocar-mesh batch`, through the interface farm/scan_program.h.
// The parameters of a scan in a collection are options of trocar-mesh. The parser of the command
// line reads them.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "pipeline/batch/batch_run.h"
#include "pipeline/batch/collection.h"

namespace trocar::pipeline {

class FarmScans : public farm::ScanProgram {
 public:
  /// `digest`: SHA-256 of the executable that meshes.
  explicit FarmScans(std::string digest = "") : digest_(std::move(digest)) {}
  const std::string& digest() const override { return digest_; }
  /// Errors: kUsage if `given` names an option that trocar-mesh does not have, or one that a
  /// collection must not give; otherwise the errors of the same options on the command line.
  Result<farm::Parameters> parameters(const nlohmann::json& given) const override;
  /// False if all inputs, the CT of --hu and the mask, if given, are NIfTI files, because the paths
  /// alone then determine the files of the scan.
  bool opens_first(const std::vector<std::filesystem::path>& inputs,
                   const farm::Parameters& parameters) const override;
  Result<std::unique_ptr<farm::OpenedScan>> open(const nlohmann::json& given,
                                                 const std::vector<std::filesystem::path>& inputs,
                                                 const std::string& series,
                                                 int threads) const override;

 private:
  std::string digest_;
};

/// The names of the options that a collection may give as parameters, without the leading --.
std::vector<std::string> collection_options();

}  // namespace trocar::pipeline

// `trocar-mesh batch`: makes the assets of a collection of scans in a store (farm/store.md).

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
