// SPDX-License-Identifier: GPL-3.0-or-later
// Tests: tests/e2e/memory_growth_test.py
#pragma once

namespace trocar::pipeline {

/// Tells glibc's malloc to reuse freed memory instead of returning large blocks to the system.
/// Otherwise the system would clear fresh pages, which takes up to a quarter of the time to mesh a
/// slice. Call it first in main(). It has no effect with other C libraries.
void keep_freed_memory();

}  // namespace trocar::pipeline
