// SPDX-License-Identifier: GPL-3.0-or-later
// Gets one study from an archive by C-GET (`trocar-mesh fetch`).
// Tests: tests/e2e/archive_test.py, tests/e2e/orthanc_test.py
#pragma once

#include <atomic>
#include <filesystem>
#include <memory>
#include <string>

#include "formats/base/result.h"
#include "pipeline/archive/archive_limits.h"
#include "pipeline/archive/archive_names.h"

class DcmTransportLayer;

namespace trocar::archive {

struct FetchSettings {
  Peer archive;
  std::string ae = "TROCAR";  ///< title of this program
  std::string study;          ///< UID
  std::filesystem::path folder;
  ArchiveLimits limits;
  std::shared_ptr<DcmTransportLayer> tls;  ///< null: not encrypted
};

struct FetchedStudy {
  std::size_t instances = 0;  ///< instances that the study has now
  std::uint64_t bytes = 0;
  std::size_t added = 0;  ///< instances that were not there before
  std::size_t different =
      0;  ///< instances that differ from those that were there, and were left out
  std::size_t left_out = 0;  ///< instances of kinds that trocar-mesh does not read
};

/// Writes the study to FOLDER/STUDY_UID/, whole or not at all. Errors: (refused) the archive cannot be
/// reached, refuses, breaks off, sends what is damaged or beyond the limits, or has no images of this
/// study; (unwritable) the folder, or `stop` was set.
Result<FetchedStudy> fetch_study(const FetchSettings& settings, const std::atomic<bool>& stop);

}  // namespace trocar::archive
