// SPDX-License-Identifier: Apache-2.0
// The program trocar-sample-ct without its main().
#pragma once

namespace trocar::sample {

/// Runs the program with main()'s arguments and returns its exit code; an error is one
/// line on stderr. Never throws.
int run_sample_ct(int argc, const char* const* argv);

}  // namespace trocar::sample
