// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/isal.h"

#include <isa-l/crc.h>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace trocar::pipeline {
namespace {

#if defined(__x86_64__)
[[gnu::target("avx")]] void clear_upper_halves() {
  _mm256_zeroupper();
}
void clear_vector_registers() {
  if (__builtin_cpu_supports("avx")) clear_upper_halves();
}
#else
void clear_vector_registers() {}
#endif

}  // namespace

int inflate_on(inflate_state& state) {
  const int out = isal_inflate(&state);
  clear_vector_registers();
  return out;
}

std::uint32_t gzip_checksum(std::span<const std::uint8_t> bytes) {
  const std::uint32_t out = crc32_gzip_refl(0, bytes.data(), bytes.size());
  clear_vector_registers();
  return out;
}

}  // namespace trocar::pipeline
