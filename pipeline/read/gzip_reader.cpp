// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/gzip_reader.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>

#include "pipeline/read/read_at.h"

namespace trocar::pipeline {
namespace {

constexpr std::size_t kPackedBytes = 1 << 17;
constexpr std::array<char, 2> kMagic{'\x1f', '\x8b'};

}  // namespace

bool GzipReader::is_gzip(int descriptor) {
  std::array<char, 2> magic{};
  return read_at(descriptor, 0, magic) == magic.size() && magic == kMagic;
}

GzipReader::GzipReader(int descriptor, std::string name)
    : descriptor_(descriptor),
      name_(std::move(name)),
      packed_(kPackedBytes),
      state_(std::make_unique<inflate_state>()) {
  isal_inflate_init(state_.get());
  state_->crc_flag = ISAL_GZIP;
}

// Reads more packed bytes behind those that are left. False if the file has no more bytes.
bool GzipReader::fill() {
  inflate_state& s = *state_;
  std::copy_n(s.next_in, s.avail_in, packed_.begin());  // downwards, if they overlap
  const std::size_t n = read_at(descriptor_, at_, std::span(packed_).subspan(s.avail_in));
  at_ += static_cast<std::int64_t>(n);
  s.next_in = reinterpret_cast<std::uint8_t*>(packed_.data());
  s.avail_in += static_cast<std::uint32_t>(n);
  return n > 0;
}

Result<std::size_t> GzipReader::read(std::span<char> to) {
  inflate_state& s = *state_;
  s.next_out = reinterpret_cast<std::uint8_t*>(to.data());
  s.avail_out = static_cast<std::uint32_t>(to.size());
  while (s.avail_out > 0 && !ended_) {
    if (s.block_state == ISAL_BLOCK_FINISH) {
      // ISA-L has given back the bytes that it had read beyond the member.
      while (s.avail_in < kMagic.size() && fill()) {
      }
      ended_ =
          s.avail_in < kMagic.size() || std::memcmp(kMagic.data(), s.next_in, kMagic.size()) != 0;
      if (ended_) break;
      isal_inflate_reset(&s);
      s.crc_flag = ISAL_GZIP;
    }
    const std::uint32_t in_before = s.avail_in, out_before = s.avail_out;
    if (inflate_on(s) < 0) return refused(name_ + ": damaged gzip");
    if (s.block_state == ISAL_BLOCK_FINISH) continue;
    const bool stands_still = s.avail_out == out_before;
    if (s.avail_in == 0) {
      ended_ = !fill() && stands_still;
    } else if (stands_still && s.avail_in == in_before) {
      return refused(name_ + ": damaged gzip");
    }
  }
  return to.size() - s.avail_out;
}

}  // namespace trocar::pipeline
