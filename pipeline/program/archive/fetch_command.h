// SPDX-License-Identifier: GPL-3.0-or-later
// `trocar-mesh fetch`: gets a study from an archive.
// Tests: tests/e2e/archive_test.py, tests/e2e/orthanc_test.py
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>

#include "pipeline/program/archive/archive_options.h"

namespace trocar::pipeline {

struct FetchArguments {
  std::filesystem::path folder;
  std::string from, study, ae = "TROCAR";
  bool quiet = false;
  ArchiveArguments archive;
};

/// Declares the options. Parsing writes their values to `a`, which must outlive `app`.
void add_fetch_options(CLI::App& app, FetchArguments& a);

/// Fetches the study and returns the exit code: 0; 2 for wrong options; 3 if a TLS file cannot be
/// used or the archive does not deliver the study (fetch.h); 4 if the folder cannot be written or a
/// signal ended the fetch.
int run_fetch(const FetchArguments& a);

}  // namespace trocar::pipeline
