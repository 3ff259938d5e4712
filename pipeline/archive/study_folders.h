// SPDX-License-Identifier: GPL-3.0-or-later
// The folder of received studies. A study appears in it whole, by one rename, as FOLDER/STUDY_UID/.
// What is not whole yet is in FOLDER/.incoming/, on the same file system:
//   associations/OWNER/STUDY/   instances of an open association (OWNER: farm/process_identity.h)
//   released/OWNER/STUDY/       instances of an association that was released; they belong to studies
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
  std::size_t instances = 0;  ///< all that the study has now
  std::uint64_t bytes = 0;
  std::size_t added = 0;  ///< 0: all instances were there already, and nothing has changed
  std::size_t different = 0;
};

class StudyFolders {
 public:
  /// Creates the folders that are missing, with mode 0700, and removes what processes left that have
  /// been killed. Errors (unwritable) name the folder.
  static Result<StudyFolders> open(const std::filesystem::path& folder);
  StudyFolders(StudyFolders&& other) noexcept;
  StudyFolders& operator=(StudyFolders&&) = delete;
  ~StudyFolders();

  /// Reserves the folder for one receiver, until this object is destroyed. Errors (unwritable):
  /// another receiver uses it.
  Result<void> reserve();

  /// Removes the folders that open() has created, if nothing is in them.
  void remove_if_unused() const;

  const std::filesystem::path& folder() const { return folder_; }
  /// A new, empty folder for the instances of an association or a fetch.
  Result<std::filesystem::path> new_association();
  /// Removes the folder of an association with all that it holds.
  void drop_association(const std::filesystem::path& association) const;

  /// The size of a study, of which a part may not be published yet.
  StudySize size_of(const std::string& study) const;

  /// Commits an association that was released, by one rename: from now on all its instances belong to
  /// their studies, also if the receiver is killed.
  Result<void> release(const std::filesystem::path& association) const;
  /// The folders of associations that are committed and not taken yet.
  std::vector<std::filesystem::path> released() const;
  /// Moves the instances of such a folder to the studies that may still grow, and removes it. Errors
  /// (unwritable): it can be called again.
  Result<std::vector<TakenStudy>> take(const std::filesystem::path& association,
                                       const ArchiveLimits& limits) const;
  /// The studies that are not published yet.
  std::set<std::string> growing() const;
  std::filesystem::path growing_folder(const std::string& study) const;
  std::filesystem::path follow_up_marks() const { return incoming_ / "following"; }

  /// Publishes the instances in `source`, a folder within .incoming, which is removed. An existing
  /// study is extended: its folder is replaced at once by one with all instances. Instances that are
  /// stored already are never replaced. Errors (unwritable): nothing has changed.
  Result<PublishedStudy> publish(const std::filesystem::path& source,
                                 const std::string& study) const;

  /// Removes the studies that last grew more than `hours` ago, except those in `busy`. Folders that
  /// were not received are never removed. Returns the UIDs of those removed.
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
