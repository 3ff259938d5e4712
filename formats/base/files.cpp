// SPDX-License-Identifier: Apache-2.0
#include "formats/base/files.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/stat.h>
#include <algorithm>
#include <cstdio>

#include "formats/base/text.h"

namespace trocar {

Result<void> ByteSource::read(std::uint64_t offset, std::span<std::uint8_t> into) {
  if (offset > size() || into.size() > size() - offset)
    return refused("ends before byte " + std::to_string(offset + into.size()));
  bytes_read_ += into.size();
  return fetch(offset, into);
}

Result<void> MemorySource::fetch(std::uint64_t offset, std::span<std::uint8_t> into) {
  std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(offset), into.size(), into.begin());
  return {};
}

namespace {

class FileSource : public ByteSource {
 public:
  FileSource(FileDescriptor fd, std::uint64_t size) : fd_(std::move(fd)), size_(size) {}
  std::uint64_t size() const override { return size_; }

 private:
  Result<void> fetch(std::uint64_t offset, std::span<std::uint8_t> into) override {
    std::size_t done = 0;
    while (done < into.size()) {
      const ssize_t got = ::pread(fd_.get(), into.data() + done, into.size() - done,
                                  static_cast<off_t>(offset + done));
      if (got < 0 && errno == EINTR) continue;
      if (got < 0)
        return Error{ExitCode::kRefused, system_message(errno), is_of_circumstances(errno)};
      if (got == 0) return refused_for_now("shrank while being read");
      done += static_cast<std::size_t>(got);
    }
    return {};
  }

  FileDescriptor fd_;
  std::uint64_t size_;
};

/// The canonical path of a file that may not exist. It is made absolute first, because
/// weakly_canonical does not change a relative path of which no part exists.
std::filesystem::path canonical_path(const std::filesystem::path& file) {
  std::error_code ignored;
  return std::filesystem::weakly_canonical(std::filesystem::absolute(file, ignored), ignored);
}

/// Returns the permissions of a file that is to be written: those of the file that it replaces, or
/// those of a new one.
mode_t mode_of(const std::filesystem::path& file, Readers readers) {
  struct stat replaced {};
  if (::lstat(file.c_str(), &replaced) == 0 && S_ISREG(replaced.st_mode))
    return replaced.st_mode & 0777;
  if (readers == Readers::kOwner) return 0600;
  const mode_t mask = ::umask(0);
  ::umask(mask);
  return 0666 & ~mask;
}

/// Standard output is a pipe or a socket that nobody reads any more.
bool reader_is_gone() {
  pollfd out{STDOUT_FILENO, POLLOUT, 0};
  return ::poll(&out, 1, 0) > 0 && (out.revents & POLLERR) != 0;
}

}  // namespace

Result<std::unique_ptr<ByteSource>> open_file(const std::filesystem::path& file) {
  // O_NONBLOCK avoids waiting for the other end if the file is a pipe.
  FileDescriptor fd(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (fd.get() < 0) return refused_by_system(file.string(), errno);
  struct stat status {};
  if (::fstat(fd.get(), &status) != 0) return refused_by_system(file.string(), errno);
  if (S_ISDIR(status.st_mode)) return refused(file.string() + ": is a folder, not a file");
  if (!S_ISREG(status.st_mode)) return refused(file.string() + ": not a regular file");
  return std::unique_ptr<ByteSource>(
      std::make_unique<FileSource>(std::move(fd), static_cast<std::uint64_t>(status.st_size)));
}

Result<std::vector<std::uint8_t>> read_file(const std::filesystem::path& file,
                                            std::uint64_t max_bytes) {
  const auto source = open_file(file);
  if (!source) return source.error();
  const std::uint64_t size = (*source)->size();
  if (size > max_bytes)
    return refused(file.string() + ": larger than " + std::to_string(max_bytes) + " bytes");
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(size));
  if (auto ok = (*source)->read(0, bytes); !ok) return ok.error().after(file.string() + ": ");
  return bytes;
}

Result<void> check_writable(const std::filesystem::path& file) {
  if (file.empty()) return {};
  const std::filesystem::path folder = file.has_parent_path() ? file.parent_path() : ".";
  std::error_code ignored;
  // The final rename would replace a device or a pipe by a file.
  const std::filesystem::file_status there = std::filesystem::status(file, ignored);
  if (std::filesystem::exists(there) && !std::filesystem::is_regular_file(there))
    return unwritable(file.string() + ": exists and is not a regular file");
  if (!std::filesystem::is_directory(folder, ignored))
    return unwritable(file.string() + ": there is no folder " + folder.string());
  if (::access(folder.c_str(), W_OK) != 0) {
    return unwritable(file.string() +
                      ": its folder cannot be written to: " + system_message(errno));
  }
  return {};
}

Result<void> check_outputs(std::span<const OutputFile> outputs,
                           std::span<const std::filesystem::path> inputs) {
  std::error_code ignored;
  for (const OutputFile& output : outputs) {
    if (output.file.empty()) continue;
    if (auto ok = check_writable(output.file); !ok) return ok;
    const std::string said = output.option + " " + output.file.string();
    for (const std::filesystem::path& input : inputs) {
      if (std::filesystem::equivalent(output.file, input, ignored))
        return usage(said + ": would write over the input " + input.string());
    }
    for (const OutputFile& other : outputs) {
      if (&other != &output && !other.file.empty() &&
          canonical_path(other.file) == canonical_path(output.file)) {
        return usage(said + ": is also the file of " + other.option);
      }
    }
  }
  return {};
}

std::string without_folder(const std::filesystem::path& file) {
  if (!file.is_absolute()) return file.string();
  return (file.has_filename() ? file : file.parent_path()).filename().string();
}

Result<void> write_file_atomically(const std::filesystem::path& file,
                                   std::span<const std::uint8_t> bytes, Readers readers) {
  if (auto ok = check_writable(file); !ok) return ok;
  std::string temporary = file.string() + ".XXXXXX";
  FileDescriptor fd(::mkostemp(temporary.data(), O_CLOEXEC));
  if (fd.get() < 0) return unwritable(file.string() + ": " + system_message(errno));
  const auto fail = [&]() -> Error {
    const int error = errno;
    ::unlink(temporary.c_str());
    return unwritable(file.string() + ": " + system_message(error));
  };
  if (!write_all(fd.get(), {reinterpret_cast<const char*>(bytes.data()), bytes.size()}))
    return fail();
  if (::fchmod(fd.get(), mode_of(file, readers)) != 0 || ::fsync(fd.get()) != 0 || !fd.close() ||
      ::rename(temporary.c_str(), file.c_str()) != 0) {
    return fail();
  }
  const std::filesystem::path folder = file.has_parent_path() ? file.parent_path() : ".";
  const FileDescriptor directory(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (directory.get() >= 0) ::fsync(directory.get());
  return {};
}

Result<void> write_file_atomically(const std::filesystem::path& file, std::string_view text,
                                   Readers readers) {
  return write_file_atomically(
      file, std::span(reinterpret_cast<const std::uint8_t*>(text.data()), text.size()), readers);
}

bool write_all(int fd, std::span<const char> bytes) {
  while (!bytes.empty()) {
    const ssize_t put = ::write(fd, bytes.data(), bytes.size());
    if (put < 0 && errno == EINTR) continue;
    if (put <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(put));
  }
  return true;
}

int finish_output(const char* program, int code) {
  const bool failed_before = std::ferror(stdout) != 0;
  errno = 0;
  const bool fails_now = std::fflush(stdout) != 0;
  if (!failed_before && !fails_now) return code;
  // An error before this call has left no errno.
  if (errno == EPIPE || (errno == 0 && reader_is_gone())) return code;
  const std::string why = errno == 0 ? "" : ": " + system_message(errno);
  print(stderr, "%s: standard output could not be written%s\n", program, why);
  return code == 0 ? static_cast<int>(ExitCode::kUnwritable) : code;
}

}  // namespace trocar
