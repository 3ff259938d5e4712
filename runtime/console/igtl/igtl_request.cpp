// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/igtl/igtl_request.h"

#include <igtl_util.h>

#include <algorithm>
#include <boost/endian/conversion.hpp>
#include <vector>

namespace trocar::runtime {
namespace {

// The header: version (2 bytes), type (12), name of the device (20), time (8), bytes of the body (8),
// checksum (8); numbers are big-endian.
constexpr std::size_t kTypeAt = 2, kDeviceAt = 14, kTimeAt = 34, kBodyAt = 42, kCrcAt = 50;
constexpr std::uint16_t kLastVersion = 3;

/// The printable text before the first zero; none: it has other characters.
std::optional<std::string> text(std::span<const std::uint8_t> bytes) {
  const auto end = std::find(bytes.begin(), bytes.end(), 0);
  if (!std::all_of(bytes.begin(), end, [](std::uint8_t c) { return c >= ' ' && c <= '~'; }))
    return std::nullopt;
  return std::string(bytes.begin(), end);
}

}  // namespace

std::optional<IgtlHeader> read_igtl_header(std::span<const std::uint8_t, kIgtlHeaderBytes> bytes) {
  const std::uint16_t version = boost::endian::load_big_u16(bytes.data());
  const auto type = text(bytes.subspan(kTypeAt, kDeviceAt - kTypeAt));
  const auto device = text(bytes.subspan(kDeviceAt, kTimeAt - kDeviceAt));
  const std::uint64_t body_bytes = boost::endian::load_big_u64(&bytes[kBodyAt]);
  if (version < 1 || version > kLastVersion || !type || type->empty() || !device ||
      body_bytes > kMaxIgtlBody)
    return std::nullopt;
  return IgtlHeader{*type, static_cast<std::size_t>(body_bytes),
                    boost::endian::load_big_u64(&bytes[kCrcAt])};
}

bool is_igtl_body(const IgtlHeader& header, std::span<const std::uint8_t> body) {
  std::vector<std::uint8_t> bytes(body.begin(), body.end());  // the library takes no constant bytes
  return crc64(bytes.data(), bytes.size(), 0) == header.crc;
}

}  // namespace trocar::runtime
