// SPDX-License-Identifier: Apache-2.0
// Files: errors of the system, descriptors, reading in sections, and writing at once.
#pragma once

#include <unistd.h>
#include <cerrno>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "formats/base/result.h"

namespace trocar {

/// The message for `error`, a value of errno, for example "No such file or directory". Thread-safe.
inline std::string system_message(int error) {
  return std::generic_category().message(error);
}

/// Does the reason `error` lie outside of the input (Error::is_temporary)? False for what is wrong with
/// the path itself. The storage, the memory, the number of open files and the rights may change while
/// the input stays the same.
inline bool is_of_circumstances(int error) {
  return error != ENOENT && error != ENOTDIR && error != ELOOP && error != EISDIR &&
         error != ENAMETOOLONG && error != EINVAL && error != ENXIO;
}

/// The refusal of an input that the system did not give, for the reason `error`: "WHAT: REASON".
inline Error refused_by_system(const std::string& what, int error) {
  return {ExitCode::kRefused, what + ": " + system_message(error), is_of_circumstances(error)};
}

// Owner of a file descriptor. Its destructor closes the descriptor.

class FileDescriptor {
 public:
  /// Owns `fd`. A negative `fd` is allowed, because it is the result of an open() that failed.
  explicit FileDescriptor(int fd = -1) : fd_(fd) {}
  FileDescriptor(FileDescriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  FileDescriptor& operator=(FileDescriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~FileDescriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  int get() const { return fd_; }
  /// Closes the descriptor now. Returns false and sets errno if data that was written may be lost.
  bool close() { return ::close(std::exchange(fd_, -1)) == 0; }

 private:
  int fd_;
};

/// Writes all bytes to a descriptor. Returns false and sets errno if they cannot be written.
bool write_all(int fd, std::span<const char> bytes);

// Reading files, completely or in sections, and writing them atomically: an output appears complete
// or not at all.

/// Returns the file's bytes. Errors: kRefused if the file cannot be read or is larger than
/// `max_bytes`.
Result<std::vector<std::uint8_t>> read_file(const std::filesystem::path& file,
                                            std::uint64_t max_bytes = std::uint64_t{1} << 32);

/// A source of bytes, such as a file, that is read in sections. Its size is known in advance.
class ByteSource {
 public:
  ByteSource() = default;
  ByteSource(const ByteSource&) = delete;
  ByteSource& operator=(const ByteSource&) = delete;
  virtual ~ByteSource() = default;

  virtual std::uint64_t size() const = 0;
  /// Reads `into.size()` bytes from `offset` on. Errors: kRefused if fewer bytes are left, or if
  /// the file cannot be read.
  Result<void> read(std::uint64_t offset, std::span<std::uint8_t> into);
  /// Total number of bytes that all calls of read() so far have read.
  std::uint64_t bytes_read() const { return bytes_read_; }

 private:
  virtual Result<void> fetch(std::uint64_t offset, std::span<std::uint8_t> into) = 0;
  std::uint64_t bytes_read_ = 0;
};

/// A source of bytes in memory. The bytes must outlive the source.
class MemorySource : public ByteSource {
 public:
  explicit MemorySource(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  std::uint64_t size() const override { return bytes_.size(); }

 private:
  Result<void> fetch(std::uint64_t offset, std::span<std::uint8_t> into) override;
  std::span<const std::uint8_t> bytes_;
};

/// Opens a file, which stays open for the lifetime of the result. Errors: kRefused if the file
/// cannot be opened or is not a regular file.
Result<std::unique_ptr<ByteSource>> open_file(const std::filesystem::path& file);

/// Checks whether `file` can be written, as far as a check without writing can tell. Call this
/// function before long work. An empty path passes: it means that no output is wanted. Errors:
/// kUnwritable if `file` cannot be written.
Result<void> check_writable(const std::filesystem::path& file);

/// An output file and the command-line option that names it. An empty path means no output.
struct OutputFile {
  std::string option;
  std::filesystem::path file;
};

/// Calls check_writable() for each output. Errors: those of check_writable(); kUsage if an output
/// is also an input, or if two outputs are the same file.
Result<void> check_outputs(std::span<const OutputFile> outputs,
                           std::span<const std::filesystem::path> inputs);

/// Shortens a path for reports that are passed on and must not show absolute paths. A relative path
/// stays unchanged; an absolute path is reduced to its file name.
std::string without_folder(const std::filesystem::path& file);

/// Who may read a new file: whom the umask admits, or only the owner, because it names trainees.
enum class Readers : std::uint8_t { kByUmask, kOwner };

/// Writes a temporary file in the folder of `file`, syncs it and renames it to `file`. A file that
/// is replaced passes its permissions on. Errors: kUnwritable if a step fails; `file` is then
/// unchanged and the temporary file is removed.
Result<void> write_file_atomically(const std::filesystem::path& file,
                                   std::span<const std::uint8_t> bytes,
                                   Readers readers = Readers::kByUmask);
Result<void> write_file_atomically(const std::filesystem::path& file, std::string_view text,
                                   Readers readers = Readers::kByUmask);

// Flushes standard output at the end of a program, and reports text that could not be written.

/// Flushes standard output and returns the program's exit code; call this function last in main().
/// If some printed text could not be written, for example because the disk is full, the function
/// prints a line on stderr and replaces a `code` of 0 by 4 (kUnwritable). Otherwise the exit code
/// is `code`. A closed pipe does not count as a failure.
int finish_output(const char* program, int code);

}  // namespace trocar
