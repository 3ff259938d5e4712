// SPDX-License-Identifier: GPL-3.0-or-later
// ISA-L's calls against zlib, and what they leave in the processor.
#include "pipeline/read/volume_file.h"

#include <gtest/gtest.h>
#include <zlib.h>

#include <cstdint>
#include <memory>
#include <random>
#include <vector>

#if defined(__x86_64__)
#include <cpuid.h>
#include <immintrin.h>
#endif

namespace trocar::pipeline {
namespace {

std::vector<std::uint8_t> bytes_of(std::size_t size) {
  std::mt19937 random(1);
  std::vector<std::uint8_t> out(size);
  for (std::size_t i = 0; i < size; ++i)
    out[i] = i < size / 2 ? static_cast<std::uint8_t>(random()) : out[i - size / 2];
  return out;
}

#if defined(__x86_64__)
bool tells_what_is_in_use() {
  unsigned a = 0, b = 0, c = 0, d = 0;
  return __get_cpuid_count(0xd, 1, &a, &b, &c, &d) != 0 && (a & 4U) != 0;
}
// The upper halves of the registers that all vector code uses: bit 2 of AVX, bit 6 of AVX-512.
[[gnu::target("xsave")]] std::uint64_t upper_halves_in_use() {
  return _xgetbv(1) & 0x44U;
}
#else
bool tells_what_is_in_use() {
  return false;
}
std::uint64_t upper_halves_in_use() {
  return 0;
}
#endif

// SSE code that follows would be slowed down.
TEST(Isal, LeavesNoUpperHalvesOfVectorRegistersInUse) {
  if (!tells_what_is_in_use()) GTEST_SKIP() << "this processor does not tell";
  const std::vector<std::uint8_t> plain = bytes_of(1'000'000);
  std::vector<std::uint8_t> packed(compressBound(plain.size()));
  uLongf size = packed.size();
  ASSERT_EQ(compress(packed.data(), &size, plain.data(), plain.size()), Z_OK);
  const auto state = std::make_unique<inflate_state>();
  isal_inflate_init(state.get());
  state->crc_flag = ISAL_ZLIB;
  std::vector<std::uint8_t> back(plain.size());
  state->next_in = packed.data();
  state->avail_in = static_cast<std::uint32_t>(size);
  state->next_out = back.data();
  state->avail_out = static_cast<std::uint32_t>(back.size());
  const int inflated = inflate_on(*state);
  const std::uint64_t after_inflate = upper_halves_in_use();
  const std::uint32_t checksum = gzip_checksum(plain);
  const std::uint64_t after_checksum = upper_halves_in_use();
  EXPECT_EQ(inflated, ISAL_DECOMP_OK);
  EXPECT_EQ(back, plain);
  EXPECT_EQ(checksum, crc32(0, plain.data(), static_cast<uInt>(plain.size())));
  EXPECT_EQ(after_inflate, 0U);
  EXPECT_EQ(after_checksum, 0U);
}

}  // namespace
}  // namespace trocar::pipeline
