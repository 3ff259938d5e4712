// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/digest.h"

#include <sodium.h>

#include <cerrno>
#include <fstream>

#include "formats/base/system_message.h"

namespace trocar::pipeline {
namespace {

std::string hex_digest(crypto_generichash_state& state) {
  unsigned char hash[crypto_generichash_BYTES];
  crypto_generichash_final(&state, hash, sizeof hash);
  char hex[2 * sizeof hash + 1];
  sodium_bin2hex(hex, sizeof hex, hash, sizeof hash);
  return hex;
}

}  // namespace

Result<std::string> digest_file(const std::filesystem::path& file) {
  if (sodium_init() < 0) return bug("libsodium does not initialise");
  crypto_generichash_state state;
  crypto_generichash_init(&state, nullptr, 0, crypto_generichash_BYTES);
  std::ifstream in(file, std::ios::binary);
  if (!in) return refused_by_system(file.string(), errno);
  std::vector<char> block(1 << 16);
  while (in.read(block.data(), static_cast<std::streamsize>(block.size())), in.gcount() > 0) {
    crypto_generichash_update(&state, reinterpret_cast<const unsigned char*>(block.data()),
                              static_cast<unsigned long long>(in.gcount()));
  }
  if (in.bad()) return refused_for_now(file.string() + ": cannot be read");
  return hex_digest(state);
}

std::string digest_input(const std::vector<std::string>& file_digests,
                         const std::vector<std::uint8_t>& key) {
  static_assert(kMinKeyBytes == crypto_generichash_KEYBYTES_MIN &&
                kMaxKeyBytes == crypto_generichash_KEYBYTES_MAX);
  crypto_generichash_state state;
  crypto_generichash_init(&state, key.data(), key.size(), crypto_generichash_BYTES);
  for (const std::string& digest : file_digests) {
    crypto_generichash_update(&state, reinterpret_cast<const unsigned char*>(digest.data()),
                              digest.size());
  }
  return hex_digest(state);
}

}  // namespace trocar::pipeline
