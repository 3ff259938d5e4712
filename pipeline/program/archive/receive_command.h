// SPDX-License-Identifier: GPL-3.0-or-later
// `trocar-mesh receive`: takes studies that an archive or a scanner sends by DICOM.
#pragma once

#include "pipeline/program/archive/archive_options.h"

namespace trocar::pipeline {

/// Receives until a signal ends the program, and returns the exit code: 0; 2 for wrong options; 3
/// if the port or a TLS file cannot be used; 4 if the folder cannot be written.
int run_receive(const ReceiveArguments& a);

}  // namespace trocar::pipeline
