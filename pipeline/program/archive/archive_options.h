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
  int instance_mb = 512, study_gb = 16;
  bool insecure = false;
};

/// Declares the options; `a` must outlive the app.
void add_archive_options(CLI::App& app, ArchiveArguments& a);

/// The limits that the options give.
archive::ArchiveLimits limits_of(const ArchiveArguments& a);

}  // namespace trocar::pipeline
