// SPDX-License-Identifier: GPL-3.0-or-later
// A volume's bytes on disk, read piece by piece. A gzipped one is unpacked once, as a stream, to
// a temporary file that has no name (nothing is left behind, however the program ends): memory
// does not grow with the volume. It can be unpacked on a thread of its own while its first bytes
// are already read.
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

  /// Bytes start .. start + size of the (unpacked) file, which must all be there. Errors
  /// (refused): truncated, damaged gzip, no space in the folder for temporary files (TMPDIR).
  /// Never unpacks more than asked for, and refuses at once a size that a gzip file of this length
  /// cannot unpack to. `behind`: returns at once and unpacks behind the caller; what is wrong with
  /// the gzip file is then an error of read() and of finish().
  static Result<VolumeFile> open(const std::filesystem::path& file, std::int64_t start,
                                 std::int64_t size, bool behind = false);

  /// An empty temporary file, for append(). `for_file` is for messages. Errors (refused): as above.
  static Result<VolumeFile> temporary(const std::filesystem::path& for_file);
  Result<void> append(std::span<const char> bytes, const std::filesystem::path& for_file);

  /// Reads to.size() bytes from offset `at` after `start`, as soon as they are unpacked. Errors
  /// (refused): the file has shrunk meanwhile, and those of open(). Thread-safe.
  Result<void> read(std::int64_t at, std::span<char> to, const std::string& name) const;

  /// Waits until all is unpacked; its error, if any. Thread-safe.
  Result<void> finish() const;

  /// The time that read() has waited so far, in all threads together, for bytes to be unpacked.
  double waited_ms() const;

  VolumeFile();
  VolumeFile(VolumeFile&& other) noexcept;
  VolumeFile& operator=(VolumeFile&& other) noexcept;
  ~VolumeFile();

 private:
  class Unpacking;
  int descriptor_ = -1;
  std::int64_t start_ = 0;
  std::unique_ptr<Unpacking> unpacking_;  ///< of a gzip file; writes to descriptor_
};

}  // namespace trocar::pipeline
