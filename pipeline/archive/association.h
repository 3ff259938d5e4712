// SPDX-License-Identifier: GPL-3.0-or-later
// Serves one association (a connection of the DICOM protocol) of the receiver. The receiver starts
// a process for each association, so that a sender who crashes or blocks DCMTK ends only its own.
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
  std::string ae;                    ///< AE title of this program, which a sender must state
  std::vector<std::string> callers;  ///< AE titles of the senders that are accepted
  ArchiveLimits limits;
  std::shared_ptr<DcmTransportLayer> tls;  ///< null if associations are not encrypted
};

/// The exit code of the association's process.
enum class AssociationEnd : int {
  kReleased = 0,   ///< the sender released the association; all accepted instances are kept
  kDropped = 20,   ///< the association was aborted, or the connection was lost
  kRejected = 21,  ///< the request for an association was rejected, or no valid one arrived
};

/// Answers C-ECHO requests (tests of the connection) and C-STORE requests (each stores an instance)
/// until the association ends. Instances are stored in `folder`. If the sender asks for the
/// release, StudyFolders::release() moves `folder` before the release is acknowledged. The limits
/// apply to the whole study, so `studies` is asked for the size that a study has already. Refusals
/// are reported on standard error. If a time limit passes, SIGALRM may end the process. Call the
/// function only once in a process, because DCMTK accepts one external socket per process.
AssociationEnd serve_association(int connection, const std::filesystem::path& folder,
                                 const StudyFolders& studies, const AssociationSettings& settings);

}  // namespace trocar::archive
