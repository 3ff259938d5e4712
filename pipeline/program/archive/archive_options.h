// SPDX-License-Identifier: GPL-3.0-or-later
// The options of `trocar-mesh receive` and `trocar-mesh fetch`.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "formats/base/command_line.h"
#include "pipeline/archive/archive_limits.h"
#include "pipeline/archive/transport.h"

namespace trocar::pipeline {

/// The limits, time-outs and TLS options that both commands have.
struct ArchiveArguments {
  archive::ArchiveLimits limits;
  archive::TlsFiles tls;
  int instance_mb = 512, study_gb = 16;  ///< largest instance in MiB, largest study in GiB
  bool insecure = false;                 ///< allows unencrypted scans on the network
};

struct ReceiveArguments {
  std::filesystem::path folder;
  std::string ae, listen = "127.0.0.1";
  int port = 0, max_associations = 16;
  std::vector<std::string> from;            ///< AE titles of the accepted senders
  std::vector<std::filesystem::path> then;  ///< --then: collection and store for meshing; or empty
  double settle_s = 10, keep_hours = 0;
  ArchiveArguments archive;
};

struct FetchArguments {
  std::filesystem::path folder;
  std::string from, study, ae = "TROCAR";
  bool quiet = false;
  ArchiveArguments archive;
};

/// The descriptions of the two commands in the help.
inline constexpr const char* kReceiveHelp = "receive studies that an archive (PACS) sends by DICOM";
inline constexpr const char* kFetchHelp = "get a study from an archive (PACS) by DICOM";

/// Declares the options of `trocar-mesh receive`. Parsing writes their values to `a`.
void add_receive_options(const Command& command, ReceiveArguments& a);

/// Declares the options of `trocar-mesh fetch`. Parsing writes their values to `a`.
void add_fetch_options(const Command& command, FetchArguments& a);

/// Returns a.limits with the sizes replaced by those of `instance_mb` and `study_gb`, in bytes.
archive::ArchiveLimits limits_of(const ArchiveArguments& a);

}  // namespace trocar::pipeline
