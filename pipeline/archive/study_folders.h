// SPDX-License-Identifier: GPL-3.0-or-later
// The folder of received studies. A study appears in it whole, by one rename, as FOLDER/STUDY_UID/.
// What is not whole yet is in FOLDER/.incoming/, on the same file system:
//   associations/OWNER/STUDY/   instances of an open association; OWNER names its process
//   released/OWNER/STUDY/       instances of an association that was released, not yet in studies/
//   studies/STUDY/              a study that may still grow: instances of released associations
//   replaced/                   studies that are being extended or removed
//   following/STUDY             an empty file: `--then` has still to mesh this study
//   received/STUDY              an empty file; its modification time is when the study grew last
// Tests: tests/pipeline/archive/study_folders_test.cpp
#pragma once

#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/archive/archive_limits.h"
#include "pipeline/archive/instance_file.h"

namespace trocar::archive {

/// The contribution of an association to a study.
struct TakenStudy {
  std::string uid;
  std::size_t added = 0;
  std::size_t different = 0;  ///< instances that were left out, because another instance with their
                              ///< UID is stored already
  std::size_t excess = 0;     ///< instances that were left out, because the study is full
};

struct PublishedStudy {
  std::size_t instances = 0;  ///< all instances of the study after publishing
  std::uint64_t bytes = 0;    ///< sum of the sizes of `instances`
  std::size_t added = 0;      ///< instances that are new; 0 means that nothing has changed
  std::size_t different = 0;  ///< see TakenStudy::different
};

class StudyFolders {
 public:
  /// Creates missing folders with mode 0700, and removes what killed processes left behind. Errors:
  /// kUnwritable; the message names the folder.
  static Result<StudyFolders> open(const std::filesystem::path& folder);
  StudyFolders(StudyFolders&& other) noexcept;
  StudyFolders& operator=(StudyFolders&&) = delete;
  ~StudyFolders();

  /// Reserves the folder for one receiver, until this object is destroyed. Errors: kUnwritable if
  /// another receiver uses the folder.
  Result<void> reserve();

  /// Removes the folder and its .incoming, if open() created the folder and it is still empty.
  void remove_if_unused() const;

  const std::filesystem::path& folder() const { return folder_; }
  /// A new, empty folder for the instances of an association or a fetch.
  Result<std::filesystem::path> new_association();
  /// Removes the folder of an association with all that it holds.
  void drop_association(const std::filesystem::path& association) const;

  /// The size of a study: its published instances and those in studies/.
  StudySize size_of(const std::string& study) const;

  /// Commits a released association by one rename. From then on all its instances belong to their
  /// studies, even if the receiver is killed.
  Result<void> release(const std::filesystem::path& association) const;
  /// The folders of associations that were committed but not yet passed to take().
  std::vector<std::filesystem::path> released() const;
  /// Moves the instances of a committed association to studies/, and removes its folder. Errors:
  /// kUnwritable if a folder cannot be written; take() can be called again.
  Result<std::vector<TakenStudy>> take(const std::filesystem::path& association,
                                       const ArchiveLimits& limits) const;
  /// The UIDs of the studies in studies/, which are not published yet.
  std::set<std::string> growing() const;
  std::filesystem::path growing_folder(const std::string& study) const;
  std::filesystem::path follow_up_marks() const { return incoming_ / "following"; }

  /// Publishes the instances in `source`, a folder within .incoming, and removes `source`. If the
  /// study exists, it is extended: its folder is exchanged for one with all instances. Stored
  /// instances are never replaced. Errors: kUnwritable if a file cannot be written; the study is
  /// then unchanged, unless only the last sync failed. kBug if `study` is not a UID.
  Result<PublishedStudy> publish(const std::filesystem::path& source,
                                 const std::string& study) const;

  /// Removes the studies that last grew more than `hours` ago, except those in `busy`. A folder
  /// that is not a received study is never removed. Returns the UIDs of the removed studies.
  std::vector<std::string> remove_older(double hours, const std::set<std::string>& busy) const;

 private:
  explicit StudyFolders(std::filesystem::path folder);
  void clear_leftovers() const;
  Result<void> extend(const std::filesystem::path& source, const std::string& study,
                      PublishedStudy& out) const;

  std::filesystem::path folder_, incoming_;
  bool is_new_ = false;  // open() created the folder itself
  int lock_ = -1;
  std::size_t associations_ = 0;
};

}  // namespace trocar::archive
