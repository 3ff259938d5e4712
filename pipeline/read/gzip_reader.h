// SPDX-License-Identifier: GPL-3.0-or-later
// Unpacks a gzip file (RFC 1952) as a stream. Intel's library ISA-L does this about twice as fast
// as zlib.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/isal.h"

namespace trocar::pipeline {

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

}  // namespace trocar::pipeline
