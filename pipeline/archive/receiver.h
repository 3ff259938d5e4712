// SPDX-License-Identifier: GPL-3.0-or-later
// The receiver (`trocar-mesh receive`): it listens, starts a process for each association
// (connection of the DICOM protocol), and publishes studies. To publish a study is to move the
// study's folder to the place where other programs find it. A study is published when it seems
// complete, or when the receiver ends.
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
  int port = 0;                       ///< 0: the system chooses a free port
  AssociationSettings association;
  /// Largest number of associations at the same time. Further connections wait in
  /// the system's queue.
  int max_associations = 16;
  /// A study is published after this time without a new instance, unless an open association has
  /// instances of it.
  double settle_s = 10;
  double keep_hours = 0;  ///< a study is removed this many hours after it last grew; 0: never
  /// Settings for meshing each complete study (option --then); std::nullopt: studies are not
  /// meshed. The caller need not set the members `studies` and `marks`, because run_receiver() sets
  /// them.
  std::optional<FollowUpSettings> then;
};

/// Receives until `stop` is set. Then open associations are dropped with their instances, and the
/// instances of all associations that have ended normally (released) are published. But if a
/// dropped association was sending a study, this study is not published yet, because a part of it
/// is missing. Its instances from released associations stay in FOLDER/.incoming/, and the next
/// receiver on the same folder publishes the study. Standard output gets the port at the start, and
/// later a line for each study that is published, meshed or removed. Errors: kUnwritable if the
/// folder cannot be used, or another receiver uses it; kUsage if the address is not numeric;
/// kRefused if the address or the port cannot be used.
Result<void> run_receiver(const ReceiverSettings& settings, const std::atomic<bool>& stop);

}  // namespace trocar::archive
