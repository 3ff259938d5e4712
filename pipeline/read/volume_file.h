// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <isa-l/igzip_lib.h>
#include <unistd.h>
#include <cerrno>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "formats/base/files.h"
#include "formats/base/result.h"

namespace trocar::pipeline {

/// Reads to.size() bytes from offset `at` of a file. Returns the number of bytes read, which is
/// smaller than to.size() at the end of the file and after an error.
inline std::size_t read_at(int descriptor, std::int64_t at, std::span<char> to) {
  std::size_t done = 0;
  while (done < to.size()) {
    const ssize_t n = ::pread(descriptor, to.data() + done, to.size() - done,
                              at + static_cast<std::int64_t>(done));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) break;
    done += static_cast<std::size_t>(n);
  }
  return done;
}

// Calls functions of Intel's library ISA-L and then clears the upper halves of the vector
// registers. ISA-L 2.30 leaves the upper halves in use, because its code for AVX2 and AVX-512 has
// no vzeroupper. All later SSE code of the thread would then be slow: after a .nii.gz was read,
// contours and simplification took 1.35 to 1.65 times as long.

/// Calls isal_inflate().
int inflate_on(inflate_state& state);
/// Calls crc32_gzip_refl(), which computes the checksum of gzip and PNG.
std::uint32_t gzip_checksum(std::span<const std::uint8_t> bytes);

// Unpacks a gzip file (RFC 1952) as a stream. Intel's library ISA-L does this about twice as fast
// as zlib.

class GzipReader {
 public:
  /// Precondition: is_gzip(descriptor, from) holds, and the caller keeps the descriptor open. The
  /// file is read from byte `from`. `name` is the file's name in error messages.
  GzipReader(int descriptor, std::string name, std::int64_t from = 0);

  static bool is_gzip(int descriptor, std::int64_t from = 0);

  /// Fills `to` with the next unpacked bytes and returns their number, which is less than to.size()
  /// only at the end of the data. A gzip file consists of members, which are unpacked one after
  /// another. The checksum and the length of a member are verified when its last bytes are read.
  /// Zeros behind the last member are ignored, as by the program gzip. Errors: kRefused if the gzip
  /// data are damaged or end early, or if other bytes follow the last member. Data that end early
  /// are unpacked as far as they go before the error.
  Result<std::size_t> read(std::span<char> to);

  /// True if the last error of read() was that the file ends early.
  bool is_truncated() const { return is_truncated_; }

 private:
  bool fill();
  Result<void> begin_member();

  int descriptor_;
  std::string name_;
  std::int64_t at_;  ///< offset in the file of the bytes that follow `packed_`
  std::vector<char> packed_;
  std::unique_ptr<inflate_state> state_;  ///< state of ISA-L's decoder, 88 kB
  bool ended_ = false, is_truncated_ = false;
};

// The bytes of a volume on disk, which are read block by block. A gzipped volume is unpacked once,
// as a stream, to a temporary file. Memory therefore does not grow with the size of the volume. The
// temporary file has no name, so the system removes it however the program ends. A separate thread
// can unpack the volume. The caller can then read the first bytes before the last are unpacked.

class VolumeFile {
 public:
  /// The first `bytes` bytes of the (unpacked) file, or all if there are fewer.
  static Result<std::vector<std::uint8_t>> head(const std::filesystem::path& file,
                                                std::size_t bytes);

  /// Opens the bytes from `start` to start + size of the (unpacked) file. `whole` is the number of
  /// bytes that the file has according to its header; 0: start + size. A gzip file is unpacked to
  /// this end, where it is verified. With `behind`, open() returns immediately and another thread
  /// unpacks; if the gzip file is damaged, read() and finish() return the error.
  ///
  /// Errors: kRefused if the file cannot be opened or is truncated, if the gzip data are damaged,
  /// or if the folder for temporary files (TMPDIR) has no space (a temporary error). gzip cannot
  /// compress data by a factor of more than 1032. A gzip file that is therefore too short to hold
  /// start + size bytes is refused before anything is unpacked.
  static Result<VolumeFile> open(const std::filesystem::path& file, std::int64_t start,
                                 std::int64_t size, bool behind = false, std::int64_t whole = 0);

  /// The same for data that begin at byte `from` of the file and are certainly packed by gzip
  /// (`is_gzip`), or certainly not. `start`, `size` and `whole` count unpacked bytes from there.
  static Result<VolumeFile> open_part(const std::filesystem::path& file, std::int64_t from,
                                      bool is_gzip, std::int64_t start, std::int64_t size,
                                      bool behind, std::int64_t whole);

  /// Makes an empty temporary file, which append() fills. Error messages name `for_file`, the input
  /// whose voxels the temporary file holds. Errors: kRefused if the folder for temporary files
  /// cannot be used (a temporary error).
  static Result<VolumeFile> temporary(const std::filesystem::path& for_file);
  /// Appends bytes to a file of temporary(). Errors: kRefused if there is no space (a temporary
  /// error).
  Result<void> append(std::span<const char> bytes, const std::filesystem::path& for_file);

  /// Fills `to` with the bytes from offset `at` on; offset 0 is `start` of open(). Waits until
  /// these bytes are unpacked. `name` is the file's name in error messages. Errors: kRefused if the
  /// file has become shorter; those of open(). Thread-safe.
  Result<void> read(std::int64_t at, std::span<char> to, const std::string& name) const;

  /// Waits until everything is unpacked. Returns the error of unpacking, if there was one.
  /// Thread-safe.
  Result<void> finish() const;

  /// The time that read() has waited so far for bytes to be unpacked, added up over all threads.
  double waited_ms() const;

  VolumeFile();
  VolumeFile(VolumeFile&& other) noexcept;
  VolumeFile& operator=(VolumeFile&& other) noexcept;
  ~VolumeFile();

 private:
  class Unpacking;
  FileDescriptor descriptor_;
  std::int64_t start_ = 0;
  std::unique_ptr<Unpacking> unpacking_;  ///< unpacks a gzip file to descriptor_; ends before it
};

}  // namespace trocar::pipeline
