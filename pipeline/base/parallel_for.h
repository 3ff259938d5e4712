// SPDX-License-Identifier: GPL-3.0-or-later
// A parallel loop on TBB's threads.
// Tests: tests/e2e/same_bytes_test.py
#pragma once

#include <functional>

namespace trocar::pipeline {

/// Calls each of task(0), ..., task(count - 1) once, several at the same time. They start
/// approximately in this order. Everything before the call happens before each task, and each task
/// happens before the call returns.
void parallel_for(int count, const std::function<void(int)>& task);

}  // namespace trocar::pipeline
