// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <span>
#include <string_view>

#include "pipeline/read/isal.h"

namespace trocar::pipeline {

/// Iterates over the chunks of a PNG file. A chunk consists of length, name, data, and the checksum
/// of name and data. The functions below next() describe the chunk to which next() went last.
class PngChunks {
 public:
  using Bytes = std::span<const std::uint8_t>;

  /// Precondition: `file` begins with the signature of PNG.
  explicit PngChunks(Bytes file) : left_(file.subspan(std::min<std::size_t>(file.size(), 8))) {}
  /// Goes to the next chunk. Returns false if there is no further complete chunk.
  bool next() {
    if (left_.size() < 12) return false;
    const std::uint32_t length = big_endian(left_.data());
    if (length > left_.size() - 12) return false;
    named_ = left_.subspan(4, length + std::size_t{4});
    checksum_ = big_endian(left_.data() + 8 + length);
    left_ = left_.subspan(length + std::size_t{12});
    return true;
  }
  bool is(std::string_view name) const { return std::memcmp(named_.data(), name.data(), 4) == 0; }
  /// Does the checksum agree with the name and the data?
  bool is_whole() const { return gzip_checksum(named_) == checksum_; }
  Bytes data() const { return named_.subspan(4); }

 private:
  static std::uint32_t big_endian(const std::uint8_t* at) {
    std::uint32_t value;
    std::memcpy(&value, at, 4);
    return __builtin_bswap32(value);
  }

  Bytes left_, named_;
  std::uint32_t checksum_ = 0;
};

}  // namespace trocar::pipeline
