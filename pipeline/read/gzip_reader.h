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
  /// Precondition: is_gzip(descriptor) holds, and the caller keeps the descriptor open. The file is
  /// read from its start. `name` is the file's name in error messages.
  GzipReader(int descriptor, std::string name);

  static bool is_gzip(int descriptor);

  /// Fills `to` with the next unpacked bytes and returns their number, which is less than to.size()
  /// only at the end of the data. A gzip file consists of members, which are unpacked one after
  /// another. The checksum of a member is verified when its last bytes are read. Bytes behind the
  /// last member are ignored, as by the program gzip. If the file ends early, the data end there
  /// without an error. Errors: kRefused if the gzip data are damaged.
  Result<std::size_t> read(std::span<char> to);

 private:
  bool fill();

  int descriptor_;
  std::string name_;
  std::int64_t at_ = 0;  ///< offset in the file of the bytes that follow `packed_`
  std::vector<char> packed_;
  std::unique_ptr<inflate_state> state_;  ///< state of ISA-L's decoder, 88 kB
  bool ended_ = false;
};

}  // namespace trocar::pipeline
