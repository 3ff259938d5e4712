// SPDX-License-Identifier: Apache-2.0
// Reading files, whole or piece by piece, and writing them. Outputs appear whole or not at all.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"

namespace trocar {

/// The file's bytes; refused if it cannot be read or is larger than `max_bytes`.
Result<std::vector<std::uint8_t>> read_file(const std::filesystem::path& file,
                                            std::uint64_t max_bytes = std::uint64_t{1} << 32);

/// Bytes of known size that are read piece by piece.
class ByteSource {
 public:
  ByteSource() = default;
  ByteSource(const ByteSource&) = delete;
  ByteSource& operator=(const ByteSource&) = delete;
  virtual ~ByteSource() = default;

  virtual std::uint64_t size() const = 0;
  /// Reads `into.size()` bytes from `offset` on. Refused if there are fewer.
  Result<void> read(std::uint64_t offset, std::span<std::uint8_t> into);
  std::uint64_t bytes_read() const { return bytes_read_; }  ///< by all calls of read()

 private:
  virtual Result<void> fetch(std::uint64_t offset, std::span<std::uint8_t> into) = 0;
  std::uint64_t bytes_read_ = 0;
};

/// Bytes in memory. They must outlive the source.
class MemorySource : public ByteSource {
 public:
  explicit MemorySource(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  std::uint64_t size() const override { return bytes_.size(); }

 private:
  Result<void> fetch(std::uint64_t offset, std::span<std::uint8_t> into) override;
  std::span<const std::uint8_t> bytes_;
};

/// A regular file, open while this lives; refused if it cannot be opened.
Result<std::unique_ptr<ByteSource>> open_file(const std::filesystem::path& file);

/// Whether `file` could be written, as far as this can be known without writing: programs ask
/// before long work. (Unwritable) if not. An empty path means that no output is wanted.
Result<void> check_writable(const std::filesystem::path& file);

/// An output file and the command-line option that names it. An empty path: no output is wanted.
struct OutputFile {
  std::string option;
  std::filesystem::path file;
};

/// check_writable() of each. Fails (usage) if an output is also an input, or another output.
Result<void> check_outputs(std::span<const OutputFile> outputs,
                           std::span<const std::filesystem::path> inputs);

/// The path in a report that is passed on, which holds no absolute paths: a relative one as it is,
/// the last name of an absolute one.
std::string without_folder(const std::filesystem::path& file);

/// Writes a temporary file beside the target, syncs it and renames it to the target. On failure
/// (unwritable) the target is unchanged and the temporary file is removed.
Result<void> write_file_atomically(const std::filesystem::path& file,
                                   std::span<const std::uint8_t> bytes);
Result<void> write_file_atomically(const std::filesystem::path& file, std::string_view text);

}  // namespace trocar
