// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/archive/study_folders.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstdio>
#include <system_error>
#include <utility>

#include "pipeline/archive/archive_names.h"
#include "pipeline/farm/atomic_file.h"
#include "pipeline/farm/process_identity.h"
#include "pipeline/farm/sha256.h"
#include "pipeline/farm/store.h"

namespace trocar::archive {
namespace {

namespace fs = std::filesystem;

constexpr const char* kParts[] = {"associations", "released",  "studies",
                                  "replaced",     "following", "received"};

// The entries of a folder; none if it cannot be read.
std::vector<fs::path> entries_of(const fs::path& folder) {
  std::vector<fs::path> out;
  std::error_code error;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error))
    out.push_back(at->path());
  return out;
}

// A folder and no link to one. It belongs to this user, so that no other can change it.
Result<void> make_private(const fs::path& folder) {
  if (::mkdir(folder.c_str(), 0700) == 0) return {};
  if (errno != EEXIST) return farm::cannot_write(folder, errno);
  struct stat state {};
  if (::lstat(folder.c_str(), &state) != 0) return farm::cannot_write(folder, errno);
  if (!S_ISDIR(state.st_mode)) return unwritable(folder.string() + ": is not a folder");
  if (state.st_uid != ::geteuid()) return unwritable(folder.string() + ": belongs to another user");
  return {};
}

// Has the process that made this folder ended? Of other computers nothing is known.
bool is_left_over(const fs::path& association) {
  const auto owner = farm::identity_in(association.filename().string());
  if (!owner) return true;
  const farm::ProcessIdentity self = farm::this_process();
  return farm::life_of(*owner) == farm::Life::kDead ||
         (owner->host == self.host && owner->boot != self.boot);
}

// The size of a regular file; std::nullopt if there is none.
std::optional<std::uint64_t> size_of_file(const fs::path& file) {
  struct stat state {};
  if (::lstat(file.c_str(), &state) != 0 || !S_ISREG(state.st_mode)) return {};
  return static_cast<std::uint64_t>(state.st_size);
}

StudySize size_of_folder(const fs::path& folder) {
  StudySize out;
  for (const fs::path& file : entries_of(folder)) {
    const auto bytes = size_of_file(file);
    if (!bytes) continue;
    ++out.instances;
    out.bytes += *bytes;
  }
  return out;
}

bool is_there(const fs::path& path) {
  struct stat state {};
  return ::lstat(path.c_str(), &state) == 0;
}

// Held while a study is published, so that a receiver and a fetch do not overtake each other.
class PublishLock {
 public:
  explicit PublishLock(const fs::path& file)
      : fd_(::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600)) {
    while (fd_.get() >= 0 && ::flock(fd_.get(), LOCK_EX) != 0 && errno == EINTR) {
    }
  }

 private:
  FileDescriptor fd_;
};

// Sets the time at which a study grew last to now.
Result<void> touch(const fs::path& mark) {
  const FileDescriptor fd(::open(mark.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600));
  if (fd.get() < 0 || ::futimens(fd.get(), nullptr) != 0) return farm::cannot_write(mark, errno);
  return farm::sync_folder(mark.parent_path());
}

}  // namespace

StudyFolders::StudyFolders(fs::path folder)
    : folder_(std::move(folder)), incoming_(folder_ / ".incoming") {}

Result<StudyFolders> StudyFolders::open(const fs::path& folder) {
  StudyFolders out(folder);
  out.is_new_ = ::mkdir(folder.c_str(), 0700) == 0;
  if (!out.is_new_ && errno != EEXIST) return farm::cannot_write(folder, errno);
  std::error_code error;
  if (!fs::is_directory(folder, error)) return unwritable(folder.string() + ": is not a folder");
  if (auto ok = make_private(out.incoming_); !ok) return ok.error();
  for (const char* part : kParts)
    if (auto ok = make_private(out.incoming_ / part); !ok) return ok.error();
  const PublishLock lock(out.incoming_ / "publish.lock");
  out.clear_leftovers();
  return out;
}

void StudyFolders::clear_leftovers() const {
  std::error_code ignored;
  for (const fs::path& association : entries_of(incoming_ / "associations"))
    if (is_left_over(association)) fs::remove_all(association, ignored);
  for (const fs::path& old : entries_of(incoming_ / "replaced")) {
    // Without RENAME_EXCHANGE, a kill between two renames leaves a study under this name.
    const std::string study = old.filename().string();
    if (is_uid(study) && !is_there(folder_ / study)) {
      fs::rename(old, folder_ / study, ignored);
    } else {
      fs::remove_all(old, ignored);
    }
  }
}

void StudyFolders::remove_if_unused() const {
  if (!is_new_) return;
  std::error_code ignored;
  for (const char* part : kParts)
    fs::remove(incoming_ / part, ignored);
  if (entries_of(incoming_).size() > 1) return;
  fs::remove(incoming_ / "publish.lock", ignored);
  fs::remove(incoming_, ignored);
  fs::remove(folder_, ignored);
}

Result<void> StudyFolders::reserve() {
  const fs::path file = incoming_ / "receiver.lock";
  lock_.emplace(::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600));
  if (lock_->get() < 0) return farm::cannot_write(file, errno);
  if (::flock(lock_->get(), LOCK_EX | LOCK_NB) != 0)
    return unwritable(folder_.string() + ": another receiver stores its studies here");
  return {};
}

Result<fs::path> StudyFolders::new_association() {
  fs::path out = incoming_ / "associations" /
                 (farm::this_process().text() + "." + std::to_string(associations_++));
  if (::mkdir(out.c_str(), 0700) != 0) return farm::cannot_write(out, errno);
  return out;
}

std::set<std::string> StudyFolders::studies_in(const fs::path& association) {
  std::set<std::string> out;
  for (const fs::path& study : entries_of(association))
    if (is_uid(study.filename().string())) out.insert(study.filename().string());
  return out;
}

void StudyFolders::drop_association(const fs::path& association) const {
  std::error_code ignored;
  fs::remove_all(association, ignored);
}

Result<void> StudyFolders::release(const fs::path& association) const {
  const fs::path target = incoming_ / "released" / association.filename();
  if (::rename(association.c_str(), target.c_str()) != 0) return farm::cannot_write(target, errno);
  return farm::sync_folder(incoming_ / "released");
}

std::vector<fs::path> StudyFolders::released() const {
  return entries_of(incoming_ / "released");
}

fs::path StudyFolders::growing_folder(const std::string& study) const {
  return incoming_ / "studies" / study;
}

std::set<std::string> StudyFolders::growing() const {
  return studies_in(incoming_ / "studies");
}

StudySize StudyFolders::size_of(const std::string& study) const {
  StudySize out = size_of_folder(folder_ / study);
  for (const fs::path& file : entries_of(growing_folder(study))) {
    const auto bytes = size_of_file(file);
    if (!bytes || size_of_file(folder_ / study / file.filename()) == bytes) continue;
    ++out.instances;
    out.bytes += *bytes;
  }
  return out;
}

bool StudyFolders::has_instance(const std::string& study, const std::string& name,
                                std::uint64_t bytes) const {
  return size_of_file(folder_ / study / name) == bytes ||
         size_of_file(growing_folder(study) / name) == bytes;
}

Result<std::vector<TakenStudy>> StudyFolders::take(const fs::path& association,
                                                   const ArchiveLimits& limits) const {
  std::vector<TakenStudy> out;
  for (const fs::path& source : entries_of(association)) {
    TakenStudy taken;
    taken.uid = source.filename().string();
    if (!is_uid(taken.uid)) continue;
    const fs::path target = growing_folder(taken.uid);
    if (auto ok = make_private(target); !ok) return ok.error();
    StudySize size = size_of(taken.uid);
    for (const fs::path& file : entries_of(source)) {
      const fs::path name = target / file.filename();
      if (is_there(name)) {
        if (!farm::same_sha256(file, name)) ++taken.different;
        continue;
      }
      const std::uint64_t bytes = size_of_file(file).value_or(0);
      // The study may be removed before it is extended, so the instance is kept in any case.
      const bool is_published = size_of_file(folder_ / taken.uid / file.filename()) == bytes;
      if (!is_published &&
          (size.instances >= limits.study_instances || size.bytes + bytes > limits.study_bytes)) {
        ++taken.excess;
        continue;
      }
      if (::rename(file.c_str(), name.c_str()) != 0) return farm::cannot_write(name, errno);
      ++taken.added;
      if (is_published) continue;
      ++size.instances;
      size.bytes += bytes;
    }
    if (auto ok = farm::sync_folder(target); !ok) return ok.error();
    std::error_code ignored;
    fs::remove(target, ignored);  // only if it is empty
    out.push_back(std::move(taken));
  }
  if (auto ok = farm::sync_folder(incoming_ / "studies"); !ok) return ok.error();
  drop_association(association);
  return out;
}

Result<PublishedStudy> StudyFolders::publish(const fs::path& source,
                                             const std::string& study) const {
  if (!is_uid(study)) return bug(study + ": is not a UID");
  const PublishLock lock(incoming_ / "publish.lock");
  const fs::path target = folder_ / study;
  PublishedStudy out;
  if (is_there(target)) {
    if (auto ok = extend(source, study, out); !ok) return ok.error();
    if (out.added > 0)
      if (auto ok = touch(incoming_ / "received" / study); !ok) return ok.error();
  } else {
    out.added = size_of_folder(source).instances;
    if (auto ok = touch(incoming_ / "received" / study); !ok) return ok.error();
    if (auto ok = farm::sync_folder(source); !ok) return ok.error();
    if (::rename(source.c_str(), target.c_str()) != 0) return farm::cannot_write(target, errno);
  }
  if (auto ok = farm::sync_folder(folder_); !ok) return ok.error();
  std::error_code ignored;
  fs::remove_all(source, ignored);
  const StudySize size = size_of_folder(target);
  out.instances = size.instances;
  out.bytes = size.bytes;
  return out;
}

// Replaces a published study by a folder that has links to its files and to the new ones.
Result<void> StudyFolders::extend(const fs::path& source, const std::string& study,
                                  PublishedStudy& out) const {
  const fs::path target = folder_ / study, both = incoming_ / "replaced" / ("new-" + study),
                 old = incoming_ / "replaced" / study;
  std::error_code error;
  if (!fs::is_directory(fs::symlink_status(target, error)))
    return unwritable(target.string() + ": is not a folder");
  std::vector<fs::path> added;
  for (const fs::path& file : entries_of(source)) {
    const fs::path stored = target / file.filename();
    if (!is_there(stored)) {
      added.push_back(file);
    } else if (!farm::same_sha256(file, stored)) {
      ++out.different;
    }
  }
  if (added.empty()) return {};
  fs::remove_all(both, error);
  if (auto ok = make_private(both); !ok) return ok.error();
  const auto fail_with = [&both](int why) {
    std::error_code ignored;
    fs::remove_all(both, ignored);
    return farm::cannot_write(both, why);
  };
  std::vector<fs::path> all = entries_of(target);
  all.insert(all.end(), added.begin(), added.end());
  for (const fs::path& file : all)
    if (::link(file.c_str(), (both / file.filename()).c_str()) != 0) return fail_with(errno);
  if (auto ok = farm::sync_folder(both); !ok) return ok.error();
  if (::renameat2(AT_FDCWD, both.c_str(), AT_FDCWD, target.c_str(), RENAME_EXCHANGE) != 0) {
    // Some file systems cannot exchange two folders. Then the study is missing for a moment; if the
    // program is killed in it, clear_leftovers() brings the old one back.
    if (::rename(target.c_str(), old.c_str()) != 0) return fail_with(errno);
    if (::rename(both.c_str(), target.c_str()) != 0) {
      const int why = errno;
      ::rename(old.c_str(), target.c_str());
      return fail_with(why);
    }
  }
  fs::remove_all(both, error);
  fs::remove_all(old, error);
  out.added = added.size();
  return {};
}

std::vector<std::string> StudyFolders::remove_older(double hours,
                                                    const std::set<std::string>& busy) const {
  std::vector<std::string> out;
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  const PublishLock lock(incoming_ / "publish.lock");
  for (const fs::path& mark : entries_of(incoming_ / "received")) {
    const std::string study = mark.filename().string();
    const auto time = farm::time_of(mark);
    if (!is_uid(study) || busy.contains(study) || !time) continue;
    if (std::chrono::duration<double>(now - *time).count() <= hours * 3600) continue;
    const fs::path trash = incoming_ / "replaced" / ("old-" + study);
    std::error_code error;
    fs::remove_all(trash, error);
    const bool is_removed = ::rename((folder_ / study).c_str(), trash.c_str()) == 0;
    if (!is_removed && errno != ENOENT) continue;
    fs::remove_all(trash, error);
    fs::remove(mark, error);
    if (is_removed) out.push_back(study);
  }
  return out;
}

}  // namespace trocar::archive
