// SPDX-License-Identifier: GPL-3.0-or-later
// What follows when `trocar-mesh receive --then COLLECTION STORE` has got a complete study: its
// usable scans are added to a collection (a list of scans to mesh), and `trocar-mesh batch`
// makes their assets.
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

/// Adds scans of a study to a collection, and returns the new collection. Scans are added if `list`
/// marks them as usable and they are not localisers. `text` is the old collection as JSON, or empty
/// if there is none. `list` is the result of list_scans() for `folder`, the study's folder. `study`
/// is the study's UID. The paths of the added scans are relative to `base`, the folder of the
/// collection. The names of these scans are appended to `names`. A name consists of the study's UID
/// and a digest: the digest of the series' UID or, for a scan that is no DICOM series, the digest
/// of the name of its file or folder. So the name of a series stays the same while its files
/// arrive. If the collection has a scan of this name, that scan is replaced, but its `parameters`
/// are kept. All other scans and the collection's `defaults` stay as they are. Errors: kUsage if
/// `text` is not a collection; the message names `file`.
Result<nlohmann::ordered_json> with_study(std::string_view text, const std::filesystem::path& file,
                                          const nlohmann::json& list,
                                          const std::filesystem::path& folder,
                                          const std::filesystem::path& base,
                                          const std::string& study,
                                          std::vector<std::string>& names);

struct FollowUpSettings {
  std::filesystem::path collection, store;  ///< absolute paths
  std::filesystem::path studies;            ///< folder of the studies, an absolute path
  std::filesystem::path marks;  ///< folder of the marks: an empty file for each study to mesh
  mode_t umask = 022;           ///< umask with which the collection and the store are written
};

/// A queue of complete studies that are to be meshed. One batch runs at a time, in a process of its
/// own. The marks keep the queue on the disk: studies that still wait or are being meshed when the
/// program ends are queued again at its next start. A study whose batch failed is not queued again.
class FollowUp {
 public:
  explicit FollowUp(FollowUpSettings settings);
  FollowUp(const FollowUp&) = delete;
  FollowUp& operator=(const FollowUp&) = delete;
  /// Stops the running batch and waits for its end. Assets that are finished stay in the store.
  ~FollowUp();

  /// Writes the mark of a study. Call expect() before the study is published: if the program then
  /// ends before add(), the mark puts the study into the queue at the next start.
  void expect(const std::string& study) const;
  /// Adds a published study to the queue.
  void add(const std::string& study);
  /// Reports a batch that has ended. If no batch is running, starts one for the next study. The
  /// function does not block; call it regularly.
  void step();
  /// UIDs of the studies that wait or are being meshed. They must not be removed.
  std::set<std::string> busy() const;

 private:
  void report_end(int status) const;

  FollowUpSettings settings_;
  std::deque<std::string> waiting_;
  std::string current_;
  pid_t process_ = 0;  // 0: none
};

}  // namespace trocar::archive
