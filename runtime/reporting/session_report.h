// SPDX-License-Identifier: Apache-2.0
// The files of `trocar-run --session-report`: figures as JSON and as CSV, and a page that shows them.
// session_figures.h defines the figures.
// Tests: tests/e2e/session_report_test.py
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "formats/session/scene.h"
#include "formats/session/trainee.h"
#include "formats/session/xray_use.h"
#include "runtime/reporting/material_section.h"
#include "runtime/reporting/session_figures.h"
#include "runtime/reporting/session_observer.h"
#include "runtime/reporting/wall_violation.h"
#include "runtime/session/session.h"

namespace trocar::runtime {

/// Facts that the report states besides the figures.
struct ReportFacts {
  std::string asset;      ///< name of the asset's file
  std::string force_law;  ///< name of the force law
  bool is_virtual = false;
  SessionEnd end = SessionEnd::kDone;
  std::uint64_t lost_ticks = 0;
  std::vector<FaultEvent> faults;  ///< the session's faults with measured values
  std::vector<ReportSheet> sheets;
  Trainee trainee;
  XrayUse xray;
  std::optional<WallViolation>
      final_wall;  ///< at the final position; none: the tool is not in bone
  /// Intervals over material of each sheet, on the lines through the lowest tip, in m: first along x,
  /// then along y.
  std::array<std::vector<std::vector<std::array<double, 2>>>, 2> material_m;
};

/// Returns the document of formats/session/session_report.schema.json, without a line feed
/// at its end.
std::string session_report_json(const Scene& scene, const SessionFigures& figures,
                                const ReportFacts& facts);
/// Returns the figures of that document as CSV, one line each: figure,value. The name of a figure is its
/// path in the document, such as "path/length_m" or "punctures/0/t_s". The samples are left out.
std::string session_report_csv(const std::string& report_json);
/// Returns one HTML page (session_page.html) that contains the same document and needs
/// no other file.
std::string session_report_page(const Scene& scene, const SessionFigures& figures,
                                const ReportFacts& facts);

}  // namespace trocar::runtime
