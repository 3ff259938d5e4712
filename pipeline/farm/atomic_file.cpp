// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/farm/atomic_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <system_error>
#include <utility>

#include "formats/base/file_descriptor.h"
#include "formats/base/file_io.h"
#include "formats/base/system_message.h"
#include "pipeline/farm/failpoint.h"
#include "pipeline/farm/process_identity.h"
#include "pipeline/farm/sha256.h"

namespace trocar::farm {
namespace {

namespace fs = std::filesystem;

// Removes a temporary file that has not become the target.
class Temporary {
 public:
  explicit Temporary(fs::path path) : path_(std::move(path)) {}
  Temporary(const Temporary&) = delete;
  Temporary& operator=(const Temporary&) = delete;
  ~Temporary() {
    if (!renamed_) ::unlink(path_.c_str());
  }
  const char* name() const { return path_.c_str(); }
  const fs::path& path() const { return path_; }
  bool rename_to(const fs::path& target) {
    return renamed_ = ::rename(path_.c_str(), target.c_str()) == 0;
  }

 private:
  fs::path path_;
  bool renamed_ = false;
};

// The first call must precede all threads, because the mask can be read only by setting it.
mode_t process_mask() {
  static const mode_t mask = [] {
    const mode_t now = ::umask(077);
    ::umask(now);
    return now;
  }();
  return mask;
}

}  // namespace

bool is_shared(const struct stat& folder) {
  constexpr mode_t kBits = S_ISGID | S_IWGRP;
  return (folder.st_mode & kBits) == kBits;
}

bool give_to_users(int fd, const fs::path& like, mode_t mode) {
  struct stat users {
  }, own{};
  if (::stat(like.c_str(), &users) != 0 || ::fstat(fd, &own) != 0) return false;
  const uid_t owner = ::geteuid() == 0 ? users.st_uid : own.st_uid;
  const gid_t group = is_shared(users) || ::geteuid() == 0 ? users.st_gid : own.st_gid;
  if ((owner != own.st_uid || group != own.st_gid) && ::fchown(fd, owner, group) == 0)
    own.st_gid = group;
  mode &= ~process_mask();
  if (is_shared(users) && own.st_gid == users.st_gid) mode |= (mode & S_IRWXU) >> 3;
  if (S_ISDIR(own.st_mode) && is_shared(users)) mode |= S_ISGID;
  return ::fchmod(fd, mode) == 0;
}

// The new folder's own entry is not synced here: file systems with a journal write it together with
// the later sync of a file in the folder.
Result<void> make_folder(const fs::path& folder, const fs::path& like) {
  if (::mkdir(folder.c_str(), 0777) != 0) {
    if (errno == EEXIST) return {};
    return cannot_write(folder, errno);
  }
  const FileDescriptor fd(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (fd.get() < 0 || !give_to_users(fd.get(), like, 0777)) return cannot_write(folder, errno);
  return {};
}

fs::path temporary_name(const fs::path& folder) {
  static std::atomic<unsigned> count{0};
  return folder / (this_process().text() + "." + std::to_string(++count));
}

Error cannot_write(const fs::path& file, int error) {
  return unwritable(file.string() + ": cannot be written: " + system_message(error));
}

bool write_all(int fd, std::span<const std::uint8_t> bytes) {
  while (!bytes.empty()) {
    const ssize_t put = ::write(fd, bytes.data(), bytes.size());
    if (put < 0 && errno == EINTR) continue;
    if (put < 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(put));
  }
  return true;
}

bool write_all(int fd, std::string_view text) {
  return write_all(fd, text_bytes(text));
}

Result<void> sync_folder(const fs::path& folder) {
  const FileDescriptor fd(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (fd.get() < 0) return cannot_write(folder, errno);
  // Some file systems cannot sync folders.
  if (::fsync(fd.get()) != 0 && errno != EINVAL && errno != ENOTSUP)
    return cannot_write(folder, errno);
  return {};
}

Result<void> write_atomically(const AtomicFile& file, std::span<const std::uint8_t> bytes) {
  const fs::path folder = file.target.parent_path();
  if (auto ok = make_folder(folder, file.tmp); !ok) return ok;
  Temporary temporary(temporary_name(file.tmp));
  FileDescriptor fd(::open(temporary.name(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
  if (fd.get() < 0) return cannot_write(file.target, errno);
  failpoint("created");
  const std::size_t half = bytes.size() / 2;
  if (!write_all(fd.get(), bytes.first(half))) return cannot_write(file.target, errno);
  failpoint("half-written");
  if (!write_all(fd.get(), bytes.subspan(half))) return cannot_write(file.target, errno);
  failpoint("written");
  if (!give_to_users(fd.get(), file.tmp, file.mode) || (file.is_synced && ::fsync(fd.get()) != 0) ||
      !fd.close())
    return cannot_write(file.target, errno);
  failpoint("synced");
  const auto back = read_file(temporary.path());
  if (!back || !std::ranges::equal(*back, bytes))
    return unwritable(file.target.string() + ": the bytes read back differ from those written");
  if (file.prove) {
    if (auto ok = file.prove(*back); !ok) return ok;
  }
  failpoint("proven");
  if (!temporary.rename_to(file.target)) return cannot_write(file.target, errno);
  failpoint("renamed");
  if (!file.is_synced) return {};
  auto synced = sync_folder(folder);
  failpoint("folder-synced");
  return synced;
}

Result<void> write_atomically(const AtomicFile& file, const std::string& text) {
  return write_atomically(file, text_bytes(text));
}

Result<void> link_atomically(const fs::path& target, const fs::path& link, const fs::path& tmp) {
  std::error_code error;
  if (fs::read_symlink(link, error) == target && !error) return {};
  Temporary temporary(temporary_name(tmp));
  if (::symlink(target.c_str(), temporary.name()) != 0) return cannot_write(link, errno);
  failpoint("link-made");
  if (!temporary.rename_to(link)) return cannot_write(link, errno);
  failpoint("link-renamed");
  return {};
}

}  // namespace trocar::farm
