// SPDX-License-Identifier: Apache-2.0
// Tests: tests/e2e/console_server_test.py
#include "runtime/program/trocar_console.h"

int main(int argc, char** argv) {
  return trocar::runtime::trocar_console(argc, argv);
}
