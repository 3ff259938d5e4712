// SPDX-License-Identifier: Apache-2.0
// trocar-sample-ct OUTDIR: writes the sample scan.
#include "sample_ct/program.h"

int main(int argc, char** argv) {
  return trocar::sample::run_sample_ct(argc, argv);
}
