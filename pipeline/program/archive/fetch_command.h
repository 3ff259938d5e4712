// SPDX-License-Identifier: GPL-3.0-or-later
// `trocar-mesh fetch`: gets a study from an archive.
#pragma once

#include "pipeline/program/archive/archive_options.h"

namespace trocar::pipeline {

/// Fetches the study and returns the exit code: 0; 2 for wrong options; 3 if a TLS file cannot be
/// used or the archive does not deliver the study (fetch.h); 4 if the folder cannot be written or a
/// signal ended the fetch.
int run_fetch(const FetchArguments& a);

}  // namespace trocar::pipeline
