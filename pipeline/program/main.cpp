// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/trocar_mesh.h"

int main(int argc, char** argv) {
  return trocar::pipeline::trocar_mesh(argc, argv);
}
