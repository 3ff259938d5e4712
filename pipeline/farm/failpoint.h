// SPDX-License-Identifier: GPL-3.0-or-later
// Failpoints: named steps at which a test program can kill or stop the process. They do nothing in
// the shipped trocar-mesh.
#pragma once

namespace trocar::farm {

/// The function that is called at each failpoint, with the name of the failpoint. Only the test
/// program tests/pipeline/farm/trocar_mesh_failpoints.cpp sets it, before it starts threads.
inline void (*failpoint_hook)(const char* name) = nullptr;

inline void failpoint(const char* name) {
  if (failpoint_hook != nullptr) failpoint_hook(name);
}

}  // namespace trocar::farm
