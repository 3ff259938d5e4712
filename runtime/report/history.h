// SPDX-License-Identifier: Apache-2.0
// The history of sessions: one document with the figures of all sessions in a folder. The sessions
// of the same trainee, course and scene form a series, ordered by attempt and then by time. The
// history is made from the files that `trocar-run --session-report` and `--summary` write. The
// content of these files is checked, since others may have changed it. The results are JSON
// (formats/session/history.schema.json), a table and one HTML page. The history is a separate
// library (trocar_history), because the console uses it too.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "formats/base/result.h"

namespace trocar::runtime {

inline constexpr std::size_t kMaxHistoryFiles = 10000;
inline constexpr int kMaxHistoryDepth = 8;  ///< number of levels of subfolders that are read

struct History {
  std::string json;          ///< document of history.schema.json, on one line
  std::size_t sessions = 0;  ///< number of sessions in the document
  /// "NAME: REASON" for each file that was left out. Such a file is damaged or does not have the
  /// figures of a session.
  std::vector<std::string> skipped;
};

/// Reads all files whose names end in .json, in `folder` and in its subfolders down to
/// kMaxHistoryDepth levels. Files in deeper subfolders are ignored. Links are not followed. If a
/// folder directly contains a session report, the summaries in this folder are ignored, because
/// they are assumed to be of the same session. The time of a session is the time at which its file
/// was last changed. A subfolder that the user may not read is left out. Errors: kRefused if a
/// folder cannot be read for another reason (the message names the entry at which reading ended),
/// or if more than kMaxHistoryFiles names end in .json.
Result<History> read_history(const std::filesystem::path& folder);

/// Returns a table of the sessions: history_text() for a terminal, history_csv() as CSV. Each
/// session has one line.
std::string history_text(const History& history);
std::string history_csv(const History& history);

/// Returns an HTML page that contains the JSON document and needs no other file
/// (formats/base/html_page.h). history_page.js draws it.
std::string history_page(const History& history);

}  // namespace trocar::runtime
