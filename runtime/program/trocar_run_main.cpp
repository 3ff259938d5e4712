// SPDX-License-Identifier: Apache-2.0
#include "runtime/program/trocar_run.h"

int main(int argc, char** argv) {
  return trocar::runtime::trocar_run(argc, argv);
}
