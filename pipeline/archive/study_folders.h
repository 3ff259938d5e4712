// SPDX-License-Identifier: GPL-3.0-or-later
// The folder of received studies. A complete study appears by one rename as FOLDER/STUDY_UID/. An
// instance is a DICOM file, and an association is a DICOM connection over which instances come.
// Until its study is complete, an instance is in one of these folders of FOLDER/.incoming/.
// `trocar-mesh receive` moves the instance from each folder to the next; `trocar-mesh fetch` uses
// only the first folder:
//   associations/OWNER/STUDY/   instances of an association that is still open. OWNER names the
//                               process that made the folder (`trocar-mesh receive` or `fetch`),
//                               and ends with a number that counts the folders of this process
//   released/OWNER/STUDY/       instances of an association that the sender has released, which
//                               is the regular end of an association
//   studies/STUDY/              instances of all released associations, until the study appears
// FOLDER/.incoming/ also has:
//   replaced/                   studies that are being extended or removed
//   following/STUDY             empty file for each study that is still to be meshed (option
//                               --then of `trocar-mesh receive`)
//   received/STUDY              empty file; its modification time is when the study last grew
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "formats/base/file_descriptor.h"
#include "formats/base/result.h"
#include "pipeline/archive/archive_limits.h"
#include "pipeline/archive/instance_file.h"

namespace trocar::archive {

/// Numbers of instances of one study that take() has moved or left out.
struct TakenStudy {
  std::string uid;
  std::size_t added = 0;
  std::size_t different = 0;  ///< left out: studies/ has a different instance of the same UID
  /// Number of instances left out, because the study has reached a limit of ArchiveLimits. An
  /// instance that is published already is never left out for this reason.
  std::size_t excess = 0;
};

struct PublishedStudy {
  std::size_t instances = 0;  ///< number of all instances of the study after publishing
  std::uint64_t bytes = 0;    ///< total size of all `instances`
  std::size_t added = 0;      ///< number of new instances; if 0, the published study is unchanged
  /// Number of instances left out, because a different instance of the same UID is published.
  std::size_t different = 0;
};

class StudyFolders {
 public:
  /// Creates missing folders with mode 0700. Clears associations/ and replaced/ of what killed
  /// processes have left there. Errors: kUnwritable; the message names the folder.
  static Result<StudyFolders> open(const std::filesystem::path& folder);

  /// Locks the folder against other receivers until this object is destroyed. A fetch needs no
  /// lock, because it writes to a folder of its own and publish() takes its own lock. Errors:
  /// kUnwritable if another receiver uses the folder.
  Result<void> reserve();

  /// Removes the folder with its .incoming, if open() created it and no study has been stored.
  void remove_if_unused() const;

  const std::filesystem::path& folder() const { return folder_; }
  /// A new, empty folder for the instances of an association or a fetch.
  Result<std::filesystem::path> new_association();
  /// The UIDs of the studies that have instances in the folder of an association. None if the
  /// folder does not exist.
  static std::set<std::string> studies_in(const std::filesystem::path& association);
  /// Removes the folder of an association with all that it holds.
  void drop_association(const std::filesystem::path& association) const;

  /// The size of a study: its published instances and those in studies/. An instance that is in
  /// both places counts once.
  StudySize size_of(const std::string& study) const;
  /// Is a file with this name and size, an instance of the study, published or in studies/? If
  /// another file with this name and size arrives, it is taken for the same instance, which does
  /// not make the study larger.
  bool has_instance(const std::string& study, const std::string& name, std::uint64_t bytes) const;

  /// Moves the folder of a released association to released/. From then on the instances in it are
  /// kept, even if the receiver is killed.
  Result<void> release(const std::filesystem::path& association) const;
  /// The folders in released/. Pass each of them to take().
  std::vector<std::filesystem::path> released() const;
  /// Moves the instances of a folder in released/ to studies/, and removes the folder. Errors:
  /// kUnwritable if a folder cannot be written; the caller can call take() again.
  Result<std::vector<TakenStudy>> take(const std::filesystem::path& association,
                                       const ArchiveLimits& limits) const;
  /// The UIDs of the studies in studies/.
  std::set<std::string> growing() const;
  std::filesystem::path growing_folder(const std::string& study) const;
  std::filesystem::path follow_up_marks() const { return incoming_ / "following"; }

  /// Publishes the instances in `source`, a folder within .incoming, and removes `source`. If the
  /// study is published already, its folder is exchanged for one that also has the new instances; a
  /// published instance is never replaced. Errors: kUnwritable if a file cannot be written; kBug if
  /// `study` is not a UID. After an error the study is unchanged, with two exceptions: the study
  /// has been published if only the last sync failed, and a published study has been extended if
  /// only the file in received/ could not be written.
  Result<PublishedStudy> publish(const std::filesystem::path& source,
                                 const std::string& study) const;

  /// Removes the published studies that last grew more than `hours` ago, except those whose UIDs
  /// are in `busy` (studies that are still to be meshed). Folders that were not received as studies
  /// are never removed. Returns the UIDs of the removed studies.
  std::vector<std::string> remove_older(double hours, const std::set<std::string>& busy) const;

 private:
  explicit StudyFolders(std::filesystem::path folder);
  void clear_leftovers() const;
  Result<void> extend(const std::filesystem::path& source, const std::string& study,
                      PublishedStudy& out) const;

  std::filesystem::path folder_, incoming_;
  bool is_new_ = false;  // open() created the folder itself
  std::optional<FileDescriptor> lock_;
  std::size_t associations_ = 0;
};

}  // namespace trocar::archive
