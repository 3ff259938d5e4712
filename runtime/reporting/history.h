// SPDX-License-Identifier: Apache-2.0
// The record of learning: the sessions whose figures are in a folder, as one series for each trainee,
// course and scene, ordered by attempt and time. In: the files that `trocar-run --session-report` and
// `--summary` write. Out: JSON (formats/session/history.schema.json), a table and one HTML page.
// The files are not trusted. This is a library of its own (trocar_history), because the console has it too.
// Tests: tests/e2e/history_test.py
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "formats/base/result.h"

namespace trocar::runtime {

inline constexpr std::size_t kMaxHistoryFiles = 10000;
inline constexpr int kMaxHistoryDepth = 8;  ///< largest depth of a folder that is read

struct History {
  std::string json;  ///< the document, on one line
  std::size_t sessions = 0;
  std::vector<std::string>
      skipped;  ///< "NAME: why", for each file that is no session, or is damaged
};

/// Reads all files that end in .json, also in folders below, without following links. A summary is only
/// taken if its folder has no report, because it is then of the same session; it has fewer figures. A
/// session's time is that at which its file was last changed. Errors: (refused) `folder` cannot be read.
Result<History> read_history(const std::filesystem::path& folder);

/// The table as text for a terminal, and as CSV with a line for each session.
std::string history_text(const History& history);
std::string history_csv(const History& history);

/// One HTML page (history_page.html) that contains the same document and needs no other file.
std::string history_page(const History& history);

}  // namespace trocar::runtime
