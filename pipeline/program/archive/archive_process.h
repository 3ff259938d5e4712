// SPDX-License-Identifier: GPL-3.0-or-later
// The commands `receive` and `fetch` run in a program of their own, trocar-archive. If trocar-mesh
// were linked with DCMTK's network libraries, these libraries and their dependencies would delay
// the start of every other command.
#pragma once

namespace trocar::pipeline {

/// Replaces this process by trocar-archive. `argv` are the arguments of main(); trocar-mesh has
/// checked them. trocar-archive is expected at ../libexec/trocar/trocar-archive, as seen from the
/// folder of this program. If trocar-archive cannot be run, the installation is incomplete: the
/// function then prints the reason and returns exit code 1. Otherwise the function does not return.
int become_trocar_archive(char** argv);

}  // namespace trocar::pipeline
