// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/farm/sha256.h"

#include <sodium.h>

#include <algorithm>
#include <vector>

#include "formats/base/file_io.h"

namespace trocar::farm {

std::span<const std::uint8_t> text_bytes(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

std::string hex_of(std::span<const std::uint8_t> bytes) {
  std::string out(2 * bytes.size() + 1, '\0');
  sodium_bin2hex(out.data(), out.size(), bytes.data(), bytes.size());
  out.pop_back();
  return out;
}

std::string sha256_of(std::span<const std::uint8_t> bytes) {
  unsigned char hash[crypto_hash_sha256_BYTES];
  crypto_hash_sha256(hash, bytes.data(), bytes.size());
  return hex_of(hash);
}

std::string sha256_of(std::string_view text) {
  return sha256_of(text_bytes(text));
}

Result<std::string> sha256_of_file(const std::filesystem::path& file) {
  const auto source = open_file(file);
  if (!source) return source.error();
  crypto_hash_sha256_state state;
  crypto_hash_sha256_init(&state);
  std::vector<std::uint8_t> block(1 << 18);
  for (std::uint64_t at = 0; at < (*source)->size(); at += block.size()) {
    const auto n = std::min<std::uint64_t>(block.size(), (*source)->size() - at);
    const std::span chunk(block.data(), static_cast<std::size_t>(n));
    if (auto ok = (*source)->read(at, chunk); !ok) return ok.error().after(file.string() + ": ");
    crypto_hash_sha256_update(&state, chunk.data(), chunk.size());
  }
  unsigned char hash[crypto_hash_sha256_BYTES];
  crypto_hash_sha256_final(&state, hash);
  return hex_of(hash);
}

bool is_sha256(std::string_view text) {
  return text.size() == 2 * crypto_hash_sha256_BYTES &&
         text.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

}  // namespace trocar::farm
