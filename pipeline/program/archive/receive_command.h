// SPDX-License-Identifier: GPL-3.0-or-later
// `trocar-mesh receive`: takes studies that an archive or a scanner sends by DICOM.
// Tests: tests/e2e/archive_test.py, tests/e2e/archive_fuzz_test.py
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>
#include <vector>

#include "pipeline/program/archive/archive_options.h"

namespace trocar::pipeline {

struct ReceiveArguments {
  std::filesystem::path folder;
  std::string ae, listen = "127.0.0.1";
  int port = 0, max_associations = 16;
  std::vector<std::string> from;            ///< AE titles of the accepted senders
  std::vector<std::filesystem::path> then;  ///< --then: collection and store for meshing; or empty
  double settle_s = 10, keep_hours = 0;
  ArchiveArguments archive;
};

/// Declares the options. Parsing writes their values to `a`, which must outlive `app`.
void add_receive_options(CLI::App& app, ReceiveArguments& a);

/// Receives until a signal ends the program, and returns the exit code: 0; 2 for wrong options; 3
/// if the port or a TLS file cannot be used; 4 if the folder cannot be written.
int run_receive(const ReceiveArguments& a);

}  // namespace trocar::pipeline
