// SPDX-License-Identifier: GPL-3.0-or-later
// Serves one association (a connection of the DICOM protocol) of the receiver. Each association has
// a process of its own: if a sender crashes or blocks DCMTK, only its own association ends.
// Tests: tests/e2e/archive_test.py, tests/e2e/archive_fuzz_test.py
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "pipeline/archive/archive_limits.h"
#include "pipeline/archive/study_folders.h"

class DcmTransportLayer;

namespace trocar::archive {

struct AssociationSettings {
  std::string ae;                    ///< AE title of this program; callers must call this title
  std::vector<std::string> callers;  ///< AE titles of the programs that may call
  ArchiveLimits limits;
  std::shared_ptr<DcmTransportLayer> tls;  ///< null if associations are not encrypted
};

/// The exit code of the association's process.
enum class AssociationEnd : int {
  kReleased = 0,   ///< ended properly; the instances in its folder are complete
  kDropped = 20,   ///< aborted, or the connection was lost
  kRejected = 21,  ///< rejected, or the caller sent no valid request for an association
};

/// Answers C-ECHO and C-STORE requests on the connection until it ends, and stores the instances in
/// `folder`. `studies` gives the size that each study has already. Refusals are reported on
/// standard error. Call the function only once in a process, because DCMTK has one external socket
/// per process.
AssociationEnd serve_association(int connection, const std::filesystem::path& folder,
                                 const StudyFolders& studies, const AssociationSettings& settings);

}  // namespace trocar::archive
