// SPDX-License-Identifier: GPL-3.0-or-later
// The bytes of a volume on disk, which are read block by block. A gzipped volume is unpacked once,
// as a stream, to a temporary file without a name. Memory therefore does not grow with the size of
// the volume, and nothing is left behind, however the program ends. A separate thread can unpack
// the volume while its first bytes are already read.
// Tests: tests/pipeline/read/readers_test.cpp
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

  /// Opens the bytes from `start` to start + size of the (unpacked) file, all of which must exist.
  /// Of a gzip file, nothing behind these bytes is unpacked. If the gzip file is so short that it
  /// cannot unpack to this size, it is refused before anything is unpacked. With `behind`, open()
  /// returns immediately and another thread unpacks; damage of the gzip file is then an error of
  /// read() and of finish(). Errors: kRefused if the file is truncated, the gzip data are damaged,
  /// or the folder for temporary files (TMPDIR) has no space.
  static Result<VolumeFile> open(const std::filesystem::path& file, std::int64_t start,
                                 std::int64_t size, bool behind = false);

  /// Makes an empty temporary file, for append(). Messages name `for_file`. Errors: kRefused if the
  /// folder for temporary files cannot be used.
  static Result<VolumeFile> temporary(const std::filesystem::path& for_file);
  Result<void> append(std::span<const char> bytes, const std::filesystem::path& for_file);

  /// Reads to.size() bytes from offset `at` after `start`; waits until these bytes are unpacked.
  /// Errors: kRefused if the file has become shorter; those of open(). Thread-safe.
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
