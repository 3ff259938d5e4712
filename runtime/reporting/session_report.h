// SPDX-License-Identifier: Apache-2.0
// The two files of `trocar-run --session-report`: figures as JSON, and a page that shows them.
// session_figures.h defines the figures.
// Tests: tests/e2e/session_report_test.py
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "formats/session/scene.h"
#include "runtime/reporting/material_section.h"
#include "runtime/reporting/session_figures.h"
#include "runtime/reporting/session_observer.h"
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
  /// Intervals over material of each sheet, on the lines through the lowest tip, in m: first along x,
  /// then along y.
  std::array<std::vector<std::vector<std::array<double, 2>>>, 2> material_m;
};

/// Returns the document of formats/session/session_report.schema.json, without a line feed
/// at its end.
std::string session_report_json(const Scene& scene, const SessionFigures& figures,
                                const ReportFacts& facts);
/// Returns one HTML page (session_page.html) that contains the same document and needs
/// no other file.
std::string session_report_page(const Scene& scene, const SessionFigures& figures,
                                const ReportFacts& facts);

}  // namespace trocar::runtime
