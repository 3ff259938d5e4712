// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/farm/lease.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <optional>
#include <system_error>
#include <tuple>
#include <utility>

#include "formats/base/file_descriptor.h"
#include "formats/base/file_io.h"
#include "pipeline/farm/atomic_file.h"
#include "pipeline/farm/failpoint.h"
#include "pipeline/farm/process_identity.h"

namespace trocar::farm {
namespace {

namespace fs = std::filesystem;

constexpr std::chrono::seconds kRenewal{5};

// The content of a lease file: the process identity in the form of a temporary file's name, and the
// name of the scan for people.
std::string lease_text(const std::string& scan) {
  return this_process().text() + ".0\n" + scan + "\n";
}

struct Held {
  ino_t inode = 0;
  bool is_valid = false;
};

// The state of a lease; std::nullopt if the file does not exist.
std::optional<Held> read_lease(const Store& store, const fs::path& file) {
  struct stat status {};
  if (::stat(file.c_str(), &status) != 0) return std::nullopt;
  const auto bytes = read_file(file, 4096);
  // Of a lease that cannot be read, only the age counts.
  const std::string text = bytes ? std::string(bytes->begin(), bytes->end()) : "";
  const auto process = identity_in(text.substr(0, text.find('\n')));
  const Life life = process ? life_of(*process) : Life::kUnknown;
  Held out{status.st_ino, life == Life::kAlive};
  if (life != Life::kUnknown) return out;
  const auto now = store.now();
  const auto time = time_of(file);
  if (!time) return std::nullopt;
  out.is_valid = now && !is_abandoned(*time, *now, kLeaseDuration);
  return out;
}

// Moves an expired lease away. If another process has put its own lease there in the meantime, that
// lease is put back. At worst both processes compute the same outputs.
void remove_expired(const Store& store, const fs::path& file, ino_t inode) {
  const fs::path away = temporary_name(store.tmp());
  if (::rename(file.c_str(), away.c_str()) != 0) return;
  struct stat status {};
  const bool is_another = ::stat(away.c_str(), &status) == 0 && status.st_ino != inode;
  if (is_another) std::ignore = ::link(away.c_str(), file.c_str());
  ::unlink(away.c_str());
}

// Errors of link() on a file system that has no hard links.
bool is_without_links(int error) {
  return error == EPERM || error == EOPNOTSUPP || error == ENOSYS || error == EMLINK;
}

// Makes a file with the text of a lease: 0, or the error. Until the text is written, the file names
// no process, so that other processes would wait for as long as for one of another host.
int create_lease(const fs::path& file, const std::string& text) {
  const FileDescriptor fd(::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
  if (fd.get() < 0) return errno;
  give_to_users(fd.get(), file.parent_path(), 0600);
  const ssize_t put = ::write(fd.get(), text.data(), text.size());
  const int error = put == static_cast<ssize_t>(text.size()) ? 0 : (put < 0 ? errno : ENOSPC);
  if (error != 0) ::unlink(file.c_str());
  return error;
}

}  // namespace

Result<std::unique_ptr<Lease>> Lease::take(const Store& store, const std::string& key,
                                           const std::string& scan) {
  const fs::path file = store.lease_file(key), mine = temporary_name(store.tmp());
  const std::string text = lease_text(scan);
  if (const int failed = create_lease(mine, text); failed != 0) return cannot_write(file, failed);
  failpoint("lease-made");
  Result<std::unique_ptr<Lease>> out = std::unique_ptr<Lease>();
  for (int attempt = 0; attempt < 3; ++attempt) {
    int error = ::link(mine.c_str(), file.c_str()) == 0 ? 0 : errno;
    struct stat status {};
    // Over NFS the reply to a successful link() can be lost. The number of links then shows that it
    // succeeded.
    if (error != 0 && ::stat(mine.c_str(), &status) == 0 && status.st_nlink == 2) error = 0;
    if (is_without_links(error)) error = create_lease(file, text);
    if (error == 0) {
      failpoint("lease-linked");
      out = std::unique_ptr<Lease>(new Lease(file));
      break;
    }
    if (error != EEXIST) {
      out = cannot_write(file, error);
      break;
    }
    const auto held = read_lease(store, file);
    if (held && held->is_valid) break;
    if (held) remove_expired(store, file, held->inode);
  }
  ::unlink(mine.c_str());
  failpoint("leased");
  return out;
}

Lease::Lease(fs::path file)
    : file_(std::move(file)), renewer_(&Lease::renew_until_released, this) {}

void Lease::renew_until_released() {
  std::unique_lock lock(mutex_);
  while (!released_.wait_for(lock, kRenewal, [this] { return is_released_; }))
    ::utimensat(AT_FDCWD, file_.c_str(), nullptr, 0);
}

Lease::~Lease() {
  {
    const std::lock_guard lock(mutex_);
    is_released_ = true;
  }
  released_.notify_one();
  renewer_.join();
  ::unlink(file_.c_str());
}

bool is_leased(const Store& store, const std::string& key) {
  const auto held = read_lease(store, store.lease_file(key));
  return held && held->is_valid;
}

}  // namespace trocar::farm
