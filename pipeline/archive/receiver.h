// SPDX-License-Identifier: GPL-3.0-or-later
// The receiver: listens, starts a process for each association, and publishes the studies that are
// complete (`trocar-mesh receive`).
// Tests: tests/e2e/archive_test.py, tests/e2e/archive_fuzz_test.py
#pragma once

#include <atomic>
#include <filesystem>
#include <optional>
#include <string>

#include "formats/base/result.h"
#include "pipeline/archive/association.h"
#include "pipeline/archive/follow_up.h"

namespace trocar::archive {

struct ReceiverSettings {
  std::filesystem::path folder;
  std::string address = "127.0.0.1";  ///< numeric, IPv4 or IPv6
  int port = 0;                       ///< 0: one that is free
  AssociationSettings association;
  int max_associations = 16;  ///< further ones wait in the system's queue
  double settle_s = 10;       ///< a study is complete after this time without a new instance
  double keep_hours = 0;      ///< 0: studies stay until the user removes them
  std::optional<FollowUpSettings> then;
};

/// Receives until `stop` is set. Then open associations are dropped, and studies that no open
/// association carries are published. A line on standard output tells the port, and one each study.
/// Errors: (unwritable) the folder; (refused) the address or port cannot be used.
Result<void> run_receiver(const ReceiverSettings& settings, const std::atomic<bool>& stop);

}  // namespace trocar::archive
