// SPDX-License-Identifier: Apache-2.0
// Files in, whole or piece by piece, and out. Outputs appear whole or not at all.
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

/// Something of known size that is read piece by piece.
class ByteSource {
 public:
  ByteSource() = default;
  ByteSource(const ByteSource&) = delete;
  ByteSource& operator=(const ByteSource&) = delete;
  virtual ~ByteSource() = default;

  virtual std::uint64_t size() const = 0;
  /// The `into.size()` bytes from `offset` on. Refused if they are not all there.
  Result<void> read(std::uint64_t offset, std::span<std::uint8_t> into);
  std::uint64_t bytes_read() const { return bytes_read_; }  ///< by all calls of read()

 private:
  virtual Result<void> fetch(std::uint64_t offset, std::span<std::uint8_t> into) = 0;
  std::uint64_t bytes_read_ = 0;
};

/// Bytes in memory, which must outlive it.
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

/// Could `file` be written, as far as one can tell beforehand? Better known before the work than
/// after it. An empty path counts as no output wanted.
Result<void> check_writable(const std::filesystem::path& file);

/// A file that is to be written, and the option that says so. An empty path: none is wanted.
struct OutputFile {
  std::string option;
  std::filesystem::path file;
};

/// check_writable() of each; (usage) an output that is also an input, or another output.
Result<void> check_outputs(std::span<const OutputFile> outputs,
                           std::span<const std::filesystem::path> inputs);

/// Writes beside the target, syncs, renames over it. On failure (unwritable) the target
/// is as it was and nothing is left behind.
Result<void> write_file_atomically(const std::filesystem::path& file,
                                   std::span<const std::uint8_t> bytes);
Result<void> write_file_atomically(const std::filesystem::path& file, std::string_view text);

}  // namespace trocar
