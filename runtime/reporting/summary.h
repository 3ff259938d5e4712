// SPDX-License-Identifier: Apache-2.0
// Two outputs of a session as JSON: the summary, and the sheets before and after the punctures.
#pragma once

#include <string>

#include "runtime/session/session.h"

namespace trocar::runtime {

/// Returns the document of formats/session/summary.schema.json, which describes the fields and
/// their units. The text is indented by two spaces and has no line feed at its end. All top-level
/// fields are present in every session, with four exceptions: `network` is present only with the
/// force law `network`, `cutting` only with the force law `cutting`, `replay` only in a replay, and
/// `link` only if the device has a link. If there is nothing to count or to list, a field is 0 or
/// an empty list. The field `allocations_in_loop` is null if the program does not count allocations
/// (allocation_counter.h). If the hole of a puncture was not cut, the puncture's fields `remesh_us`
/// and `hole_vertices` are null. If a path is absolute, only the file's name is written.
/// `link_json`: the object `link` as JSON text; empty: the device has no link.
std::string summarize(const Scene& scene, const SessionOptions& options,
                      const SessionResult& report, const Remesher& remesher,
                      const std::string& link_json = {});

/// Returns the document of formats/session/sheets.schema.json, on one line without a line feed at
/// its end. The topmost sheet comes first. The coordinates of points are integers in the slice's
/// plane, in steps of 2^-lattice_bits mm; lattice_bits is a field of the document.
std::string describe_sheets(const Scene& scene, const Remesher& remesher);

}  // namespace trocar::runtime
