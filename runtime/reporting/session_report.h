// SPDX-License-Identifier: Apache-2.0
// The session report for the debriefing (`trocar-run --session-report`): figures as JSON and as
// CSV, and a page that shows these figures. session_figures.h defines the figures. The report also
// states facts, such as names and the measured values at faults (ReportFacts).
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "formats/session/scene.h"
#include "formats/session/trainee.h"
#include "runtime/reporting/material_section.h"
#include "runtime/reporting/session_figures.h"
#include "runtime/reporting/session_observer.h"
#include "runtime/reporting/wall_violation.h"
#include "runtime/session/session_statistics.h"

namespace trocar::runtime {

/// Facts that the report states in addition to the figures.
struct ReportFacts {
  const SessionResult& result;  ///< must outlive the facts
  bool is_virtual = false;      ///< the session had a virtual clock or was a replay
  std::vector<ReportSheet> sheets{};
  Trainee trainee{};
  /// Result of measure_wall_violation() at the final position (definition 10 of session_figures.h).
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
