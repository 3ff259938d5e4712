// SPDX-License-Identifier: GPL-3.0-or-later
// One association of the receiver, from the first byte of its connection to the last. It runs in a
// process of its own: what a sender does to DCMTK ends this association and no other.
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
  std::string ae;                    ///< the title that callers must call
  std::vector<std::string> callers;  ///< titles of those who may call
  ArchiveLimits limits;
  std::shared_ptr<DcmTransportLayer> tls;  ///< null: not encrypted
};

/// The exit code of the association's process.
enum class AssociationEnd : int {
  kReleased = 0,   ///< ended properly; the instances in its folder are complete
  kDropped = 20,   ///< aborted, or the connection was lost
  kRejected = 21,  ///< not accepted
};

/// Serves the connection until it ends: C-ECHO and C-STORE. Stores instances in `folder`, of which
/// `studies` tells how large a study is already. Refusals are reported on standard error. Call it
/// once in a process, because DCMTK has one external socket for a process.
AssociationEnd serve_association(int connection, const std::filesystem::path& folder,
                                 const StudyFolders& studies, const AssociationSettings& settings);

}  // namespace trocar::archive
