// SPDX-License-Identifier: Apache-2.0
// Tests: tests/e2e/experiments_e2e_test.py
#include "runtime/program/trocar_run.h"

int main(int argc, char** argv) {
  return trocar::runtime::trocar_run(argc, argv);
}
