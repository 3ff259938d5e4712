// SPDX-License-Identifier: GPL-3.0-or-later
// The commands `receive` and `fetch` run in a program of their own, trocar-archive, because DCMTK's
// network libraries and those that they bring would delay the start of every other command.
// Tests: tests/e2e/archive_receive_test.py, tests/e2e/archive_fetch_test.py
#pragma once

namespace trocar::pipeline {

/// Replaces this process by trocar-archive. `argv` are the arguments of main(); trocar-mesh has
/// checked them. trocar-archive is expected at ../libexec/trocar/trocar-archive, as seen from the
/// folder of this program. Returns only if it cannot be run: prints why, and returns the exit code
/// 1, since the installation is then incomplete.
int become_trocar_archive(char** argv);

}  // namespace trocar::pipeline
