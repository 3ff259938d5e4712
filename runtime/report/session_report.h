// SPDX-License-Identifier: Apache-2.0
// Outputs of a session: summary, sheets, and the report for the debriefing.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "formats/session/scene.h"
#include "formats/session/trainee.h"
#include "runtime/report/session_observer.h"
#include "runtime/session/session.h"
#include "runtime/session/session_statistics.h"

namespace trocar::runtime {

// Two outputs of a session as JSON: the summary, and the sheets before and after the punctures.

/// Returns the document of formats/session/summary.schema.json, which describes the fields and
/// their units. The text is indented by two spaces and has no line feed at its end. All top-level
/// fields are present in every session, with four exceptions: `network` is present only with the
/// force law `network`, `cutting` only with the force law `cutting`, `replay` only in a replay, and
/// `link` only if the device has a link. If there is nothing to count or to list, a field is 0 or
/// an empty list. The field `allocations_in_loop` is null if the program does not count allocations
/// (realtime_thread.h). If the hole of a puncture was not cut, the puncture's fields `remesh_us`
/// and `hole_vertices` are null. If a path is absolute, only the file's name is written.
/// `link_json`: the object `link` as JSON text; empty: the device has no link.
std::string summarize(const Scene& scene, const SessionOptions& options,
                      const SessionResult& report, const Remesher& remesher,
                      const std::string& link_json = {});

/// Returns the document of formats/session/sheets.schema.json, on one line without a line feed at
/// its end. The topmost sheet comes first. The coordinates of points are integers in the slice's
/// plane, in steps of 2^-lattice_bits mm; lattice_bits is a field of the document.
std::string describe_sheets(const Scene& scene, const Remesher& remesher);

// The session report for the debriefing (`trocar-run --session-report`): figures as JSON and as
// CSV, and a page that shows these figures. session_observer.h defines the figures. The report also
// states facts, such as names and the measured values at faults (ReportFacts).

/// Facts that the report states in addition to the figures.
struct ReportFacts {
  const SessionResult& result;  ///< must outlive the facts
  bool is_virtual = false;      ///< the session had a virtual clock or was a replay
  std::vector<ReportSheet> sheets{};
  Trainee trainee{};
  /// Result of measure_wall_violation() at the final position (definition 10 of session_observer.h).
  std::optional<WallViolation> final_wall{};
  /// Material of the uncut sheets in two vertical planes through the tip's lowest position.
  /// material_m[0][i]: intervals of x, in m, in which sheet i has material in the plane parallel to
  /// x. material_m[1][i]: intervals of y, in m, in the plane parallel to y.
  std::array<std::vector<std::vector<std::array<double, 2>>>, 2> material_m{};
};

/// Returns the document of formats/session/session_report.schema.json, without a line feed
/// at its end.
std::string session_report_json(const Scene& scene, const SessionFigures& figures,
                                const ReportFacts& facts);
/// Converts the document that session_report_json() returned to CSV, with one line "figure,value"
/// for each value. The name of a figure is its path in the document, such as "path/length_m" or
/// "punctures/0/t_s". The samples are left out.
std::string session_report_csv(const std::string& report_json);
/// Returns one HTML page that contains the document of session_report_json() and needs no other
/// file (formats/base/html_page.h). session_page.js draws it.
std::string session_report_page(const Scene& scene, const SessionFigures& figures,
                                const ReportFacts& facts);

}  // namespace trocar::runtime
