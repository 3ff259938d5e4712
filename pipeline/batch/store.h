// SPDX-License-Identifier: GPL-3.0-or-later
// Failpoints: named steps at which a test program can kill or stop the process. They do nothing in
// the shipped trocar-mesh.
#pragma once

#include <sys/stat.h>
#include <sys/types.h>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "formats/base/files.h"
#include "formats/base/result.h"
#include "pipeline/batch/scan_files.h"

namespace trocar::farm {

/// The function that is called at each failpoint, with the name of the failpoint. Only the test
/// program tests/pipeline/batch/trocar_mesh_failpoints.cpp sets it, before it starts threads.
inline void (*failpoint_hook)(const char* name) = nullptr;

inline void failpoint(const char* name) {
  if (failpoint_hook != nullptr) failpoint_hook(name);
}

// Atomic files: a file of a store appears complete or not at all. Its bytes are written to a
// temporary file in the store's tmp/, synced, read back and checked. Then the temporary file
// is renamed to its final path, and the folder there is synced. The file appears at the moment
// of the rename, also over NFS. After each step there is a failpoint, at which a test can kill
// the process (failpoint_hook).

/// A path in `folder` for a temporary file, which no other process uses. Its name begins with this
/// process's ProcessIdentity::text().
std::filesystem::path temporary_name(const std::filesystem::path& folder);

/// Gives a new file or folder to the users of the store in which it is made. `like` is a folder of the
/// store. The right owner and group are those of `like`; only root can give away the owner. If `like`
/// is shared by a group (is_shared()), the group gets the same rights as the owner, whatever the
/// umask. `mode` is reduced by the umask first. Returns false and sets errno if the mode cannot be
/// set. That the owner or group cannot be set is no error: Store::open_for_writing() refuses users
/// whose files would get others.
bool give_to_users(int fd, const std::filesystem::path& like, mode_t mode);

/// Is the folder shared by its group: may the group write in it, and do new files get its group (bit
/// setgid)?
bool is_shared(const struct stat& folder);

struct AtomicFile {
  std::filesystem::path target;
  std::filesystem::path tmp;  ///< folder of temporary files, in the same file system as the target
  mode_t mode = 0666;         ///< permissions of the file (give_to_users())
  bool is_synced = true;      ///< false if the file may be lost in a power failure
  /// An optional check of the bytes that were read back, in addition to the comparison with the
  /// written bytes. An error of `prove` prevents the rename.
  std::function<Result<void>(std::span<const std::uint8_t>)> prove = {};
};

/// Writes or replaces the target. If the target's folder is missing, creates it, but not the
/// folder's parents. Errors: kUnwritable if the target cannot be written (the message names the
/// path); those of `prove`. After an error the temporary file is removed, and the target is
/// unchanged unless the error is that of the last step: if the folder cannot be synced, the target
/// has the new bytes.
Result<void> write_atomically(const AtomicFile& file, std::span<const std::uint8_t> bytes);
Result<void> write_atomically(const AtomicFile& file, const std::string& text);

/// The error "FILE: cannot be written: REASON" for an errno.
Error cannot_write(const std::filesystem::path& file, int error);

// The store into which `trocar-mesh batch` writes; store.md describes the store's layout. The
// store's index has an entry for each scan. All files of the store except the journal and the
// leases are written atomically (AtomicFile). A lease is a file by which a process reserves the
// work on one asset (lease.h).

/// The ages at which a temporary file (kStrayAge) and a lease (kLeaseDuration) count as abandoned.
/// The age decides only if it cannot be checked whether the process that made the file is alive,
/// for example because the process runs on another host.
inline constexpr std::chrono::seconds kStrayAge{600}, kLeaseDuration{60};

/// Does a file count as abandoned? True if the file's time lies at least `most` before the present
/// time `now`, or at least `most` after it. A time in the future means that the file server's clock
/// was set back after the file's last change.
constexpr bool is_abandoned(std::chrono::nanoseconds file_time, std::chrono::nanoseconds now,
                            std::chrono::nanoseconds most) {
  const std::chrono::nanoseconds age = now - file_time;
  return age >= most || age <= -most;
}

/// A file of the store that is named by its digest.
struct Object {
  std::string sha256;
  std::uint64_t bytes = 0;
  bool operator==(const Object&) const = default;
};
struct Outputs {
  Object asset, report;
  bool operator==(const Outputs&) const = default;
};

/// The entry of a scan in the index: the last outcome, and the program, parameters and files that
/// led to it. If the scan failed for a reason that may pass, `key` and `outputs` can be those of an
/// earlier run (store.md), so that their files and links stay.
struct ScanEntry {
  std::string name;
  std::string key;      ///< key of the scan's action (scan_files.h); empty if it is not known
  std::string program;  ///< digest of trocar-mesh
  nlohmann::json parameters;
  std::string series = {};
  std::vector<ScanFile> files = {};
  std::optional<Outputs> outputs = {};  ///< always present if the scan is done
  /// The warnings of opening and of meshing the scan that made `outputs`: objects with the texts
  /// `code`, `where` and `sentence`. They may name files.
  nlohmann::json warnings = nlohmann::json::array();
  // Set if the scan failed:
  std::string reason = {};
  int exit_code = 0;
  int signal = 0;  ///< signal that killed the scan's process; 0: none
  /// True: the same program, parameters and input always fail, so the next run does not try again
  /// (a known failure, store.md).
  bool is_lasting = false;
  bool is_done() const { return outputs.has_value() && reason.empty() && exit_code == 0; }
};
nlohmann::json entry_json(const ScanEntry& entry);
/// Reads the result of entry_json(); std::nullopt if it is damaged.
std::optional<ScanEntry> entry_from(std::string_view text);

class Store {
 public:
  /// Creates the store, or folders that are missing in it, and removes files that killed processes
  /// have left in it. A store belongs to the owner of its folder `tmp`. If this folder is shared by
  /// a group (AtomicFile), it belongs to the group. Root may write for them. Errors: kUsage if
  /// the folder has files that are not a store's, or is a store of another version; kRefused if it
  /// cannot be read; kUnwritable if a file or folder cannot be written, or if the store belongs to
  /// others, who could not read what this process writes.
  static Result<Store> open_for_writing(const std::filesystem::path& folder);
  /// Opens a store. If the folder does not exist, the store is empty. Errors: kUsage and kRefused,
  /// as in open_for_writing(); kUnwritable if the folder cannot be listed.
  static Result<Store> open_for_reading(const std::filesystem::path& folder);

  const std::filesystem::path& folder() const { return folder_; }
  std::filesystem::path tmp() const { return folder_ / "tmp"; }
  std::filesystem::path action_file(const std::string& key) const;
  std::filesystem::path content_file(const std::string& sha256) const;
  std::filesystem::path entry_file(const std::string& name) const;
  std::filesystem::path lease_file(const std::string& key) const {
    return folder_ / "claims" / key;
  }

  /// All files that the action with this key names as outputs; std::nullopt if there is no such
  /// action. Errors: kRefused if its file cannot be read (then the error is temporary), or is damaged.
  Result<std::optional<std::vector<Object>>> outputs_of(const std::string& key) const;
  /// The outputs of the action with this key; std::nullopt if the action is missing or damaged, or
  /// if an output is missing or has another size (has()).
  std::optional<Outputs> find(const std::string& key) const;
  /// Do the files exist with the recorded sizes? The files are not read.
  bool has(const Outputs& outputs) const { return has(outputs.asset) && has(outputs.report); }
  bool has(const Object& object) const;
  /// Is it certain that the store does not have the file? has() is also false if the file system
  /// does not answer.
  bool lacks(const Object& object) const;
  /// Sets the modification times of the action and its outputs to now, so that garbage collection
  /// (garbage.h) keeps them. Returns false if one of these files no longer exists.
  bool renew(const std::string& key, const Outputs& outputs) const;

  /// Writes the bytes of an asset or a report. If the store already has a file with this
  /// digest and size, the function only sets the file's time to the present. `prove` checks the
  /// bytes that are read back (AtomicFile::prove). Errors: kUnwritable if the bytes cannot be
  /// written; those of `prove`.
  Result<Object> put_content(
      std::span<const std::uint8_t> bytes,
      const std::function<Result<void>(std::span<const std::uint8_t>)>& prove) const;
  /// Records the outputs of an action.
  Result<void> put_action(const std::string& key, const nlohmann::json& action,
                          const Outputs& outputs) const;

  /// The index entry of a scan; std::nullopt if there is none. Errors: kRefused if its file cannot
  /// be read (then the error is temporary), or is damaged.
  Result<std::optional<ScanEntry>> read_entry(const std::string& name) const;
  /// The same, but std::nullopt instead of an error.
  std::optional<ScanEntry> entry(const std::string& name) const;
  /// True if the scan's links in assets/ and reports/ lead to the outputs of the entry, or are absent
  /// if it has none.
  bool links_fit(const ScanEntry& entry) const;
  /// Writes the entry, then its links.
  Result<void> put_entry(const ScanEntry& entry) const;
  /// Removes the entry and its links. Errors: kUnwritable if the entry cannot be removed.
  Result<void> drop_entry(const std::string& name) const;
  /// The names of all scans in the index, sorted. Errors: kRefused if the index cannot be listed.
  Result<std::vector<std::string>> names() const;

  /// The current time by the clock of the store's file system. The ages of files are measured by
  /// this clock, because the clocks of two hosts may differ. Errors: kUnwritable if no file can
  /// be written there.
  Result<std::chrono::nanoseconds> now() const;
  /// Removes temporary files and leases of dead processes, and those that count as abandoned
  /// (kStrayAge, kLeaseDuration). Returns the number of removed files.
  std::size_t remove_strays() const;

 private:
  explicit Store(std::filesystem::path folder) : folder_(std::move(folder)) {}
  /// A link of a scan, and where it should lead to; std::nullopt if there should be no link.
  struct Link {
    std::filesystem::path link;
    std::optional<std::filesystem::path> target;
  };
  std::vector<Link> links_of(const ScanEntry& entry) const;
  std::filesystem::path folder_;
};

/// The paths of all that a folder holds. Errors: kRefused if it cannot be listed to its end.
Result<std::vector<std::filesystem::path>> listed(const std::filesystem::path& folder);

/// Modification time of a file, counted from 1970; std::nullopt if the file does not exist.
std::optional<std::chrono::nanoseconds> time_of(const std::filesystem::path& file);

// The journal of a store: times and outcomes of the work on scans. Each batch writes a file of its
// own, with one line of JSON for each scan. It is for people; nothing else depends on it.

class Journal {
 public:
  /// The journal's file is created when the first line is added.
  explicit Journal(std::filesystem::path folder) : folder_(std::move(folder)) {}
  /// Adds the current time and this process's host and pid to the line (as `time`, `host` and
  /// `pid`) and writes the line. Returns false if the line could not be written.
  bool add(nlohmann::json line);

 private:
  std::filesystem::path folder_;
  std::optional<FileDescriptor> fd_;
};

}  // namespace trocar::farm
