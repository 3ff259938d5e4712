// SPDX-License-Identifier: GPL-3.0-or-later
// What the process of one scan does, from reading the input to the index's entry.
#pragma once

#include <atomic>
#include <nlohmann/json.hpp>
#include <span>
#include <string>

#include "pipeline/farm/scan_program.h"
#include "pipeline/farm/staleness.h"
#include "pipeline/farm/store.h"

namespace trocar::farm {

struct Work {
  WantedScan wanted;
  bool rehash = false;
  bool verify = false;  ///< prove what is in the store; what is damaged is removed, and made again
  int threads = 1;
  const std::atomic<bool>* stop = nullptr;  ///< set from a signal handler: an error is no failure
};

/// What became of a scan.
struct Outcome {
  enum class Kind {
    kMade,   ///< computed by this run
    kFound,  ///< in the store under its key
    kFailed,
    kClaimed,      ///< another process computes its key
    kInterrupted,  ///< by a signal to the batch
  };
  Kind kind = Kind::kFailed;
  std::string key, reason;
  int exit_code = 0, signal = 0;
  std::uint64_t bytes = 0, input_bytes = 0;
  double seconds = 0;
  bool is_recorded = true;  ///< in the index
  nlohmann::json warnings = nlohmann::json::array();
};
const char* outcome_name(Outcome::Kind kind);
nlohmann::json outcome_json(const Outcome& outcome);
Outcome outcome_from(const nlohmann::json& value);

/// Never fails: what goes wrong is the outcome.
Outcome work_on(const Work& work, const Store& store, const ScanProgram& program);

/// Records a scan whose process was killed by a signal, or ended without an outcome.
Outcome record_killed(const Work& work, const Store& store, int signal, int exit_code);

/// The asset is what its name in the store says, and valid.
Result<void> prove_asset(std::span<const std::uint8_t> glb, const std::string& name);

}  // namespace trocar::farm
