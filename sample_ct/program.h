// SPDX-License-Identifier: Apache-2.0
// The program trocar-sample-ct without its main().
#pragma once

namespace trocar::sample {

/// Writes the sample scan that the arguments of main() describe, and returns the exit code. Reports
/// errors in one line on stderr. Never throws.
int run_sample_ct(int argc, const char* const* argv);

}  // namespace trocar::sample
