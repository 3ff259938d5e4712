// SPDX-License-Identifier: GPL-3.0-or-later
// A parallel loop on the threads of the library TBB.
#pragma once

#include <functional>

namespace trocar::pipeline {

/// Calls each of task(0), ..., task(count - 1) once, several at the same time and in no fixed
/// order. Returns when all have ended. What the caller wrote before the call is visible in every
/// task, and what the tasks wrote is visible after the call.
void parallel_for(int count, const std::function<void(int)>& task);

}  // namespace trocar::pipeline
