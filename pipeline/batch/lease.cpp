// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/batch/lease.h"

#include <fcntl.h>
#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <fstream>
#include <sstream>
#include <tuple>

namespace trocar::farm {
namespace {

namespace fs = std::filesystem;

std::string host_name() {
  std::array<char, 256> name{};
  if (::gethostname(name.data(), name.size() - 1) != 0) return "unknown";
  std::string out = name.data();
  std::replace_if(
      out.begin(), out.end(),
      [](unsigned char c) { return std::isalnum(c) == 0 && c != '-' && c != '.'; }, '_');
  return out.empty() ? "unknown" : out;
}

std::string boot_name() {
  std::string text;
  std::ifstream in("/proc/sys/kernel/random/boot_id");
  std::getline(in, text);
  std::array<char, 64> space{};
  const ssize_t n = ::readlink("/proc/self/ns/pid", space.data(), space.size() - 1);
  if (n > 0) text.append(space.data(), static_cast<std::size_t>(n));
  return sha256_of(text).substr(0, 12);
}

template <typename T>
bool number(std::string_view text, T& out) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), out);
  return error == std::errc() && end == text.data() + text.size();
}

// Reads field 22 of /proc/PID/stat. The second field, the program's name, may contain spaces.
std::optional<std::uint64_t> start_of(int pid) {
  std::ifstream in("/proc/" + std::to_string(pid) + "/stat");
  std::string line;
  if (!std::getline(in, line)) return std::nullopt;
  const std::size_t close = line.rfind(')');
  if (close == std::string::npos) return std::nullopt;
  std::istringstream rest(line.substr(close + 1));
  std::string state, field;
  rest >> state;
  if (state == "Z" || state == "X") return std::nullopt;  // it has ended
  for (int k = 4; k <= 22; ++k)
    rest >> field;
  std::uint64_t start = 0;
  if (!rest || !number(field, start)) return std::nullopt;
  return start;
}

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

std::string ProcessIdentity::text() const {
  return host + "." + boot + "." + std::to_string(pid) + "." + std::to_string(start);
}

ProcessIdentity this_process() {
  static const std::string host = host_name(), boot = boot_name();
  static ProcessIdentity known;
  const int pid = ::getpid();
  if (known.pid != pid) known = {host, boot, pid, start_of(pid).value_or(0)};
  return known;
}

std::optional<ProcessIdentity> identity_in(std::string_view text) {
  std::vector<std::string_view> parts;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t dot = std::min(text.find('.', at), text.size());
    parts.push_back(text.substr(at, dot - at));
    at = dot + 1;
  }
  if (parts.size() < 5) return std::nullopt;
  const std::size_t n = parts.size();
  ProcessIdentity out;
  out.boot = parts[n - 4];
  if (!number(parts[n - 3], out.pid) || !number(parts[n - 2], out.start)) return std::nullopt;
  for (std::size_t k = 0; k + 4 < n; ++k)
    out.host.append(k == 0 ? "" : ".").append(parts[k]);
  return out;
}

Life life_of(const ProcessIdentity& process) {
  const ProcessIdentity here = this_process();
  if (process.host != here.host || process.boot != here.boot) return Life::kUnknown;
  const auto start = start_of(process.pid);
  return start && *start == process.start ? Life::kAlive : Life::kDead;
}

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
