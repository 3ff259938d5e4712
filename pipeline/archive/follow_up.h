// SPDX-License-Identifier: GPL-3.0-or-later
// What follows when a study is complete (`--then COLLECTION STORE`): its usable scans are added to
// a collection (a list of scans to mesh), and `trocar-mesh batch` makes their assets.
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

/// Adds the scans of a study to a collection and returns the result. A scan of the study replaces a
/// scan of the same name, but keeps the `parameters` of the replaced one. All other scans and the
/// collection's `defaults` stay as they are. `text` is the collection as JSON, or empty if there is
/// none. `list` is the result of list_scans() for `folder`, the study's folder. Paths in the result
/// are relative to `base`. A scan is named after the UID of its study and a digest of the UID of
/// its series. `names` receives the names of the study's scans. Errors: kUsage if `text` is not a
/// collection; the message names `file`.
Result<nlohmann::ordered_json> with_study(std::string_view text, const std::filesystem::path& file,
                                          const nlohmann::json& list,
                                          const std::filesystem::path& folder,
                                          const std::filesystem::path& base,
                                          const std::string& study,
                                          std::vector<std::string>& names);

struct FollowUpSettings {
  std::filesystem::path collection, store;  ///< absolute paths
  std::filesystem::path studies;            ///< folder of the studies, an absolute path
  std::filesystem::path marks;  ///< folder with an empty file for each study to be meshed
  mode_t umask = 022;           ///< file mode mask of the collection and the store
};

/// A queue of complete studies. One batch runs at a time, in a process of its own. The queue
/// survives the program: studies that wait when the program ends are meshed after its next start.
class FollowUp {
 public:
  explicit FollowUp(FollowUpSettings settings);
  FollowUp(const FollowUp&) = delete;
  FollowUp& operator=(const FollowUp&) = delete;
  /// Stops the running batch and waits for its end. Assets that it has finished are in the store.
  ~FollowUp();

  /// Marks a study that is about to be published. If the program ends before add(), the mark puts
  /// the study into the queue at the next start.
  void expect(const std::string& study) const;
  /// Adds a published study to the queue.
  void add(const std::string& study);
  /// Reports a batch that has ended, and starts the next one if none is running. Does not block.
  void step();
  /// UIDs of the studies that wait or are being meshed.
  std::set<std::string> busy() const;

 private:
  void report_end(int status) const;

  FollowUpSettings settings_;
  std::deque<std::string> waiting_;
  std::string current_;
  pid_t process_ = 0;  // 0: none
};

}  // namespace trocar::archive
