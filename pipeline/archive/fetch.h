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
  std::string ae = "TROCAR";     ///< AE title of this program
  std::string study;             ///< UID of the study
  std::filesystem::path folder;  ///< the study is written to a sub-folder of this folder
  ArchiveLimits limits;
  std::shared_ptr<DcmTransportLayer> tls;  ///< null if the association is not encrypted
};

struct FetchedStudy {
  std::size_t instances = 0;  ///< all instances of the study after the fetch
  std::uint64_t bytes = 0;    ///< sum of the sizes of `instances`
  std::size_t added = 0;      ///< instances that the study did not have before
  /// Instances that were left out, because the study has different ones with the same UIDs.
  std::size_t different = 0;
  std::size_t left_out = 0;  ///< instances of kinds that trocar-mesh does not read
};

/// Writes the study to FOLDER/STUDY_UID/, whole or not at all. Errors: kRefused if the archive
/// cannot be reached, refuses the request, breaks off, sends damaged data or more than the limits
/// allow, or has no images of this study; kUnwritable if the folder cannot be written or `stop` was
/// set.
Result<FetchedStudy> fetch_study(const FetchSettings& settings, const std::atomic<bool>& stop);

}  // namespace trocar::archive
