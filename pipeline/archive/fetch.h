// SPDX-License-Identifier: GPL-3.0-or-later
// Gets one study from an archive by the DICOM request C-GET (`trocar-mesh fetch`).
#pragma once

#include <atomic>
#include <filesystem>
#include <memory>
#include <string>

#include "formats/base/result.h"
#include "pipeline/archive/archive_limits.h"
#include "pipeline/archive/archive_names.h"
#include "pipeline/archive/study_folders.h"

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
  PublishedStudy study;
  std::size_t left_out = 0;  ///< number of instances of kinds that trocar-mesh does not read
};

/// Writes the study to FOLDER/STUDY_UID/, whole or not at all. If that folder exists, the missing
/// instances are added to it. Setting `stop` interrupts the fetch. Errors: kRefused if the archive
/// cannot be reached, refuses the request, breaks off, sends damaged data or more than the limits
/// allow, takes too long for an instance, or has no images of this study; kUnwritable if the folder
/// cannot be written or `stop` was set before the end. Once the association is established, the
/// archive cannot delay the end of the fetch without limit: ArchiveLimits limits the time for each
/// instance and the number of all instances that the archive sends, including those that are left
/// out. Only one fetch may run in a process at a time, because a fetch uses the process's alarm
/// (SIGALRM).
Result<FetchedStudy> fetch_study(const FetchSettings& settings, const std::atomic<bool>& stop);

}  // namespace trocar::archive
