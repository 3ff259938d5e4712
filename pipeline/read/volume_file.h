// SPDX-License-Identifier: GPL-3.0-or-later
// The bytes of a volume on disk, which are read block by block. A gzipped volume is unpacked once,
// as a stream, to a temporary file. Memory therefore does not grow with the size of the volume. The
// temporary file has no name, so the system removes it however the program ends. A separate thread
// can unpack the volume. The caller can then read the first bytes before the last are unpacked.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "formats/base/result.h"

namespace trocar::pipeline {

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
  int descriptor_ = -1;
  std::int64_t start_ = 0;
  std::unique_ptr<Unpacking> unpacking_;  ///< unpacks a gzip file to descriptor_
};

}  // namespace trocar::pipeline
