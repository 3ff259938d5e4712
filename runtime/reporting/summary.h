// SPDX-License-Identifier: Apache-2.0
// The outputs of a session as JSON: the summary, and the sheets before and after the punctures.
// Tests: tests/runtime/session/puncture_experiment_test.cpp
#pragma once

#include <string>

#include "runtime/session/session.h"

namespace trocar::runtime {

/// The document of formats/session/summary.schema.json, which describes the fields and their units.
/// The text is indented by two spaces and has no line feed at its end. All fields are always
/// present, 0 or empty if nothing happened, apart from those of one force law (`network`,
/// `cutting`), `replay` and `link`. `allocations_in_loop` is null if the program does not count
/// allocations (allocation_counter.h). A puncture's remesh_us and hole_vertices are null if its cut
/// failed. Of absolute paths only the last name is written. `link_json` is the object `link` as
/// JSON text, or empty if the device has no link.
std::string summarize(const Scene& scene, const SessionOptions& options,
                      const SessionReport& report, const Remesher& remesher,
                      const std::string& link_json = {});

/// The document of formats/session/sheets.schema.json, on one line without a line feed at its
/// end. The topmost sheet comes first. Points are in lattice steps (2^-lattice_bits mm) of
/// the slice's plane.
std::string describe_sheets(const Scene& scene, const Remesher& remesher);

}  // namespace trocar::runtime
