// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <utility>

#include "formats/base/file_descriptor.h"
#include "formats/base/file_io.h"
#include "formats/base/system_message.h"
#include "formats/session/recording.h"
#include "formats/session/recording_fields.h"

namespace trocar {
namespace {

using SteadyClock = std::chrono::steady_clock;

constexpr std::size_t kFlushBytes = std::size_t{64} << 10;
constexpr mode_t kPrivate = 0600;

/// Appends each field of a row (visit_fields()), followed by a comma.
class RowWriter {
 public:
  explicit RowWriter(std::string& out) : out_(out) {}

  template <typename Number>
  void number(Number x) {
    std::array<char, 32> text;
    const auto end = std::to_chars(text.data(), text.data() + text.size(), x).ptr;
    out_.append(text.data(), end).push_back(',');
  }
  void finite(double x) { number(x); }
  template <std::size_t N>
  void finite(const std::array<double, N>& numbers) {
    for (const double x : numbers)
      number(x);
  }
  void flag(std::uint8_t x) { number(x); }
  void bits(std::uint8_t x, unsigned) { number(x); }
  template <typename Enum, std::size_t N>
  void name(Enum value, const std::array<const char*, N>& names) {
    out_.append(names.at(static_cast<std::size_t>(value))).push_back(',');
  }

 private:
  std::string& out_;
};

// Renames a file to a name that must be free. Returns false and sets errno on failure (EEXIST: the
// name is taken). link() would do that in one step, but not every file system has hard links.
bool rename_to_free(const std::string& from, const std::string& to) {
  const int placeholder = ::open(to.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, kPrivate);
  if (placeholder < 0) return false;
  ::close(placeholder);
  if (::rename(from.c_str(), to.c_str()) == 0) return true;
  const int error = errno;
  ::unlink(to.c_str());
  errno = error;
  return false;
}

// Locks a file that nobody writes. is_being_recorded() of another program holds a lock for a moment.
bool lock(int fd) {
  constexpr int kTimes = 20;
  constexpr useconds_t kWait_us = 1000;
  for (int i = 0; i < kTimes; ++i) {
    if (::flock(fd, LOCK_EX | LOCK_NB) == 0) return true;
    if (errno != EWOULDBLOCK) return false;
    ::usleep(kWait_us);
  }
  errno = EWOULDBLOCK;
  return false;
}

// Renames the file left by an interrupted recording to the first free name of partial.1, partial.2
// and so on. Returns false and sets errno on failure (EWOULDBLOCK: another program is writing it).
bool move_aside(const std::string& partial) {
  constexpr int kMaxKept = 10000;
  const int old = ::open(partial.c_str(), O_WRONLY | O_NONBLOCK | O_NOFOLLOW | O_CLOEXEC);
  if (old < 0) return false;
  bool moved = false;
  if (lock(old)) {
    errno = EEXIST;
    for (int n = 1; n < kMaxKept && !moved && errno == EEXIST; ++n)
      moved = rename_to_free(partial, partial + "." + std::to_string(n));
  }
  const int error = errno;
  ::close(old);
  errno = error;
  return moved;
}

// Creates a file that is locked while it is open. Returns -1 and sets errno like move_aside().
int open_partial(const std::string& partial) {
  constexpr int kFlags = O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC;
  int fd = ::open(partial.c_str(), kFlags, kPrivate);
  if (fd < 0 && errno == EEXIST && move_aside(partial))
    fd = ::open(partial.c_str(), kFlags, kPrivate);
  if (fd >= 0) static_cast<void>(lock(fd));
  return fd;
}

}  // namespace

bool is_partial_name(std::string_view name) {
  const std::size_t number = name.find_last_not_of("0123456789");
  if (number != std::string_view::npos && number + 1 < name.size() && name[number] == '.')
    name = name.substr(0, number);
  return name.ends_with(kPartialSuffix);
}

bool is_being_recorded(const std::filesystem::path& partial) {
  const FileDescriptor file(
      ::open(partial.c_str(), O_RDONLY | O_NONBLOCK | O_NOFOLLOW | O_CLOEXEC));
  return file.get() >= 0 && ::flock(file.get(), LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
}

RecordingWriter::RecordingWriter(std::filesystem::path file, std::string partial, int fd,
                                 const RecordingKind& kind)
    : file_(std::move(file)),
      partial_(std::move(partial)),
      fd_(fd),
      kind_(kind),
      rows_in_(partial_),
      flushed_at_(SteadyClock::now()) {}

RecordingWriter::RecordingWriter(RecordingWriter&& other) noexcept
    : file_(std::move(other.file_)),
      partial_(std::exchange(other.partial_, {})),
      fd_(std::exchange(other.fd_, -1)),
      buffer_(std::move(other.buffer_)),
      kind_(other.kind_),
      origin_(std::move(other.origin_)),
      lines_(other.lines_),
      rows_(other.rows_),
      bytes_(other.bytes_),
      rows_in_(std::move(other.rows_in_)),
      flushed_at_(other.flushed_at_) {}

RecordingWriter::~RecordingWriter() {
  if (fd_ >= 0 && !partial_.empty()) static_cast<void>(flush());
  end();
}

/// Closes the partial file, and removes it if it has no row.
void RecordingWriter::end() {
  if (fd_ >= 0) {
    ::fsync(fd_);
    ::close(std::exchange(fd_, -1));
  }
  if (!partial_.empty() && lines_ < 2) ::unlink(partial_.c_str());
  partial_.clear();
}

Error RecordingWriter::failure(int error) const {
  return unwritable(file_.string() + ": " + system_message(error));
}

std::string RecordingWriter::kept() const {
  return lines_ < 2
             ? "no row was kept"
             : "the first " + std::to_string(lines_ - 1) + " rows are in " + rows_in_.string();
}

double RecordingWriter::bytes_per_row() const {
  return rows_ == 0 ? 0 : static_cast<double>(bytes_) / static_cast<double>(rows_);
}

std::optional<std::uint64_t> RecordingWriter::free_bytes() const {
  struct statvfs disk {};
  if (::fstatvfs(fd_, &disk) != 0) return std::nullopt;
  return std::uint64_t{disk.f_bavail} * disk.f_frsize;
}

Result<RecordingWriter> RecordingWriter::open(const std::filesystem::path& file,
                                              const RecordingOrigin& origin) {
  if (const Result<void> ok = check_writable(file); !ok) return ok.error();
  const std::string partial = file.string() + kPartialSuffix;
  const int fd = open_partial(partial);
  if (fd < 0 && errno == EWOULDBLOCK)
    return unwritable(partial + ": another program is recording there");
  if (fd < 0) return unwritable(partial + ": " + system_message(errno));
  const RecordingKind kind = recording_kind(origin);
  RecordingWriter writer(file, partial, fd, kind);
  writer.buffer_.reserve(kFlushBytes + (std::size_t{1} << 14));
  writer.buffer_ = recording_header(kind) + "\n";
  writer.origin_ = to_text(origin);
  if (Result<void> flushed = writer.flush(); !flushed) return flushed.error();
  return writer;
}

Result<void> RecordingWriter::append(std::span<const RecordingRow> rows) {
  for (const RecordingRow& row : rows) {
    const std::size_t before = buffer_.size();
    RowWriter fields(buffer_);
    visit_fields(row, kind_, fields);
    ++rows_;
    bytes_ += buffer_.size() - before;
    buffer_ += std::exchange(origin_, {});
    buffer_ += '\n';
  }
  const bool is_due = SteadyClock::now() - flushed_at_ >= kFlushWithin;
  return buffer_.size() >= kFlushBytes || (is_due && !buffer_.empty()) ? flush() : Result<void>{};
}

Result<void> RecordingWriter::flush() {
  std::size_t done = 0;
  int error = 0;
  while (done < buffer_.size() && error == 0) {
    const ssize_t put = ::write(fd_, buffer_.data() + done, buffer_.size() - done);
    if (put >= 0) {
      done += static_cast<std::size_t>(put);
    } else if (errno != EINTR) {
      error = errno;
    }
  }
  if (error != 0) {
    // The incomplete last row is removed. If that fails, too, the next call goes on within the row.
    const std::size_t whole = std::string_view(buffer_).substr(0, done).rfind('\n') + 1;
    const off_t end = ::lseek(fd_, 0, SEEK_CUR), whole_end = end - static_cast<off_t>(done - whole);
    if (whole < done && end >= 0 && ::ftruncate(fd_, whole_end) == 0 &&
        ::lseek(fd_, whole_end, SEEK_SET) >= 0)
      done = whole;
  }
  const auto written = buffer_.begin() + static_cast<std::ptrdiff_t>(done);
  lines_ += static_cast<std::uint64_t>(std::count(buffer_.begin(), written, '\n'));
  buffer_.erase(buffer_.begin(), written);
  flushed_at_ = error == 0 ? SteadyClock::now() : SteadyClock::time_point{};
  return error == 0 ? Result<void>{} : failure(error);
}

Result<void> RecordingWriter::commit() {
  if (Result<void> flushed = flush(); !flushed) return flushed;
  if (lines_ < 2) {
    end();
    return {};
  }
  struct stat replaced {};
  if (::stat(file_.c_str(), &replaced) == 0)
    static_cast<void>(::fchmod(fd_, replaced.st_mode & 0777));
  if (::fsync(fd_) != 0) return failure(errno);
  if (::close(std::exchange(fd_, -1)) != 0) return failure(errno);
  if (::rename(partial_.c_str(), file_.c_str()) != 0) return failure(errno);
  partial_.clear();
  rows_in_ = file_;
  return {};
}

}  // namespace trocar
