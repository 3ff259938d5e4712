// SPDX-License-Identifier: GPL-3.0-or-later
// A parallel loop on TBB's threads.
// Tests: tests/e2e/same_bytes_test.py
#pragma once

#include <functional>

namespace trocar::pipeline {

/// Calls task(0), ..., task(count - 1) once each, several at the same time, started in about this
/// order. What precedes the call happens before each task, and each task happens before the call
/// returns.
void parallel_for(int count, const std::function<void(int)>& task);

}  // namespace trocar::pipeline
