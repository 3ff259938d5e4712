// SPDX-License-Identifier: GPL-3.0-or-later
// The options that `trocar-mesh receive` and `trocar-mesh fetch` share: limits, time-outs and TLS.
// Tests: tests/e2e/archive_test.py
#pragma once

#include <CLI/CLI.hpp>

#include "pipeline/archive/archive_limits.h"
#include "pipeline/archive/transport.h"

namespace trocar::pipeline {

struct ArchiveArguments {
  archive::ArchiveLimits limits;
  archive::TlsFiles tls;
  int instance_mb = 512, study_gb = 16;  ///< largest instance in MiB, largest study in GiB
  bool insecure = false;                 ///< allows unencrypted scans on the network
};

/// Declares the options. Parsing writes their values to `a`, which must outlive `app`.
void add_archive_options(CLI::App& app, ArchiveArguments& a);

/// Returns a.limits with the sizes replaced by those of `instance_mb` and `study_gb`, in bytes.
archive::ArchiveLimits limits_of(const ArchiveArguments& a);

}  // namespace trocar::pipeline
