// SPDX-License-Identifier: GPL-3.0-or-later
// A volume's bytes on disk, read block by block. A gzipped volume is unpacked once, as a stream, to
// a temporary file without a name, so that nothing is left behind however the program ends and
// memory does not grow with the volume. A thread of its own can unpack it while its first bytes
// are already read.
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
  /// The first `bytes` of the (unpacked) file, or as many as there are.
  static Result<std::vector<std::uint8_t>> head(const std::filesystem::path& file,
                                                std::size_t bytes);

  /// Bytes start .. start + size of the (unpacked) file, all of which must exist. Errors (refused):
  /// truncated, damaged gzip, no space in the folder for temporary files (TMPDIR). Unpacks no more
  /// than these bytes, and refuses at once a size that a gzip file of this length cannot unpack to.
  /// With `behind` it returns at once and unpacks on another thread; damage of the gzip file is
  /// then an error of read() and of finish().
  static Result<VolumeFile> open(const std::filesystem::path& file, std::int64_t start,
                                 std::int64_t size, bool behind = false);

  /// An empty temporary file, for append(). `for_file` is named in messages. Errors (refused): as
  /// above.
  static Result<VolumeFile> temporary(const std::filesystem::path& for_file);
  Result<void> append(std::span<const char> bytes, const std::filesystem::path& for_file);

  /// Reads to.size() bytes from offset `at` after `start`, as soon as they are unpacked. Errors
  /// (refused): the file has shrunk meanwhile, and those of open(). Thread-safe.
  Result<void> read(std::int64_t at, std::span<char> to, const std::string& name) const;

  /// Waits until all is unpacked and returns its error, if any. Thread-safe.
  Result<void> finish() const;

  /// The total time of all threads that read() has waited so far for bytes to be unpacked.
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
