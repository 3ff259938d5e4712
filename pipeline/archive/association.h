// SPDX-License-Identifier: GPL-3.0-or-later
// Serves one association, that is one connection of the DICOM protocol. The receiver is the program
// `trocar-mesh receive`. It starts a process for each association, so a sender that makes DCMTK
// crash or hang disturbs no other association.
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
/// until the association ends. `connection` is the descriptor of the accepted TCP connection.
/// Instances are stored in `folder`. When the sender requests the end of the association (DICOM's
/// A-RELEASE), two steps follow. First StudyFolders::release() moves `folder` to the folder
/// released/, whose instances are kept even if the receiver is killed. Then the request is
/// answered. `studies` supplies the size that a study has already, because the limits apply to the
/// whole study. Refusals are reported on standard error. If a time limit of `settings.limits`
/// passes, SIGALRM may end the process. Call the function only once in a process, because DCMTK can
/// take over only one accepted connection per process.
AssociationEnd serve_association(int connection, const std::filesystem::path& folder,
                                 const StudyFolders& studies, const AssociationSettings& settings);

}  // namespace trocar::archive
