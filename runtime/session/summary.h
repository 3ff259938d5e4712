// SPDX-License-Identifier: Apache-2.0
// What a session leaves behind for people and scripts: SUMMARY.json and the meshes
// for pictures.
#pragma once

#include <string>

#include "runtime/session/session.h"

namespace trocar::runtime {

/// ticks, missed_deadlines, tick_us, wake_us (p50, p99, p999, max, samples), allocations_in_loop
/// (null where this build does not count), max_force_N, punctures[], faults[], wrench_error_max,
/// torque_max_Nm, and how the session was run (`realtime`: what was granted). tick_histogram_us and
/// wake_histogram_us are lists of [at most us, count]. No quantity is left out; what did not happen
/// is 0 or empty. `network` (responses, prepare_us, free_nodes_max, error bounds) only by that
/// force law. A puncture's remesh_us and hole_vertices are null if its cut failed.
/// `link_json`: what to say of the device's link, a JSON object as text; empty: there is none.
/// Indented by two spaces, without a line feed at its end.
std::string summarize(const Scene& scene, const SessionOptions& options,
                      const SessionReport& report, const Remesher& remesher,
                      const std::string& link_json = {});

/// {"schema": "trocar.sheets/1", "lattice_bits", "sheets": [{"slice", "z_m", "at_m", "anchor_mm",
/// "rotation_deg", "before": {"vertices": [[x, y], ...], "triangles": [[a, b, c], ...]}, "after":
/// likewise, "cuts": [{"tool": [[x, y], ...], "hole": [[[x, y], ...], ...], "triangles_removed",
/// "triangles_created", "doubled_area_removed"}]}]}; the topmost sheet first. Points are in lattice
/// steps (2^-lattice_bits mm) of the slice plane. On one line, without a line feed at its end.
std::string describe_sheets(const Scene& scene, const Remesher& remesher);

}  // namespace trocar::runtime
