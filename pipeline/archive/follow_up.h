// SPDX-License-Identifier: GPL-3.0-or-later
// What follows when a study is complete (`--then COLLECTION STORE`): its usable scans are added to a
// collection, and `trocar-mesh batch` makes their assets.
// Tests: tests/pipeline/archive/follow_up_test.cpp, tests/e2e/archive_test.py
#pragma once

#include <sys/types.h>

#include <deque>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"

namespace trocar::archive {

/// The collection with the scans of a study, which replace those of the same name. `text` is the
/// collection's file, or empty if there is none; its `defaults` and all other scans stay as they are.
/// `list` is the result of list_scans() in `folder`, the study's folder; paths are relative to
/// `base`. A scan is named after the UID of its study and a digest of the UID of its series. `names`
/// receives the names. Errors (usage): the text is no collection; names `file`.
Result<nlohmann::ordered_json> with_study(std::string_view text, const std::filesystem::path& file,
                                          const nlohmann::json& list,
                                          const std::filesystem::path& folder,
                                          const std::filesystem::path& base,
                                          const std::string& study,
                                          std::vector<std::string>& names);

struct FollowUpSettings {
  std::filesystem::path collection, store;  ///< absolute paths
  std::filesystem::path studies;            ///< folder of the studies, an absolute path
  std::filesystem::path marks;              ///< folder with an empty file for each study that waits
  mode_t umask = 022;                       ///< file mode mask of the collection and the store
};

/// A queue of complete studies; one batch runs at a time, in a process of its own. The queue survives
/// the program: what waits when it ends is done after the next start.
class FollowUp {
 public:
  explicit FollowUp(FollowUpSettings settings);
  FollowUp(const FollowUp&) = delete;
  FollowUp& operator=(const FollowUp&) = delete;
  /// Stops the running batch and waits for it. What it has finished is in the store.
  ~FollowUp();

  /// Notes a study that is about to be published, so that it is not forgotten.
  void expect(const std::string& study) const;
  /// Adds a published study to the queue.
  void add(const std::string& study);
  /// Starts the next batch if none is running, and reports one that has ended. Does not wait.
  void step();
  /// UIDs of the studies that are waiting or being meshed.
  std::set<std::string> busy() const;

 private:
  void report_end(int status) const;

  FollowUpSettings settings_;
  std::deque<std::string> waiting_;
  std::string current_;
  pid_t process_ = 0;  // 0: none
};

}  // namespace trocar::archive
