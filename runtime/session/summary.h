// SPDX-License-Identifier: Apache-2.0
// The outputs of a session as JSON: the summary, and the sheets before and after the punctures.
#pragma once

#include <string>

#include "runtime/session/session.h"

namespace trocar::runtime {

/// The fields and their units: formats/session/summary.schema.json. No absolute paths: of one, only
/// the last name. ticks, missed_deadlines, tick_us, wake_us (p50, p99, p999, max, samples),
/// allocations_in_loop (null: the program does not count them, see allocation_counter.h),
/// max_force_N (of all that acts on the hand), punctures[], faults[], wrench_error_max,
/// torque_max_Nm, and how the session was run (`realtime`: what was granted). tick_histogram_us and
/// wake_histogram_us are lists of [at most us, count]. All fields are always present, 0 or empty if
/// nothing happened, except `network` (responses, prepare_us, free_nodes_max, error bounds; only
/// with that force law) and `replay`. A puncture's remesh_us and hole_vertices are null if its cut
/// failed. `link_json`: the object `link` as JSON text; empty: the device has no link. The text is
/// indented by two spaces, without a line feed at its end.
std::string summarize(const Scene& scene, const SessionOptions& options,
                      const SessionReport& report, const Remesher& remesher,
                      const std::string& link_json = {});

/// {"schema": "trocar.sheets/1", "lattice_bits", "sheets": [{"slice", "z_m", "at_m", "anchor_mm",
/// "rotation_deg", "before": {"vertices": [[x, y], ...], "triangles": [[a, b, c], ...]}, "after":
/// as "before", "cuts": [{"tool": [[x, y], ...], "hole": [[[x, y], ...], ...], "triangles_removed",
/// "triangles_created", "doubled_area_removed"}]}]}; the topmost sheet first. Points are in lattice
/// steps (2^-lattice_bits mm) of the slice plane. On one line, without a line feed at its end.
std::string describe_sheets(const Scene& scene, const Remesher& remesher);

}  // namespace trocar::runtime
