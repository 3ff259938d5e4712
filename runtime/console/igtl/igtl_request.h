// SPDX-License-Identifier: Apache-2.0
// Reads the messages of OpenIGTLink clients, which are not trusted.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

namespace trocar::runtime {

inline constexpr std::size_t kIgtlHeaderBytes = 58;
inline constexpr std::size_t kMaxIgtlBody = std::size_t{64} << 10;

struct IgtlHeader {
  std::string type;
  std::size_t body_bytes = 0;  ///< at most kMaxIgtlBody
  std::uint64_t crc = 0;       ///< checksum of the body
};

/// Reads a header. Returns nullopt if the header is malformed, has an unknown version, or announces
/// a body of more than kMaxIgtlBody bytes.
std::optional<IgtlHeader> read_igtl_header(std::span<const std::uint8_t, kIgtlHeaderBytes> bytes);

/// Returns true if the body has the checksum that the header states.
bool is_igtl_body(const IgtlHeader& header, std::span<const std::uint8_t> body);

}  // namespace trocar::runtime
