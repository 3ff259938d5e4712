// SPDX-License-Identifier: GPL-3.0-or-later
// Tests: tests/e2e/memory_growth_test.py
#pragma once

namespace trocar::pipeline {

/// Tells glibc's malloc to reuse freed memory instead of returning large blocks to the system. This
/// saves up to a quarter of the time to mesh a slice, because the system clears every page that it
/// gives to the program. Call the function first in main(). It has no effect with other C
/// libraries.
void keep_freed_memory();

}  // namespace trocar::pipeline
