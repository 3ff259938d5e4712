// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/gzip_reader.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <utility>

#include "pipeline/read/read_at.h"

namespace trocar::pipeline {
namespace {

constexpr std::size_t kPackedBytes = 1 << 17;
constexpr std::array<char, 2> kMagic{'\x1f', '\x8b'};

}  // namespace

bool GzipReader::is_gzip(int descriptor, std::int64_t from) {
  std::array<char, 2> magic{};
  return read_at(descriptor, from, magic) == magic.size() && magic == kMagic;
}

GzipReader::GzipReader(int descriptor, std::string name, std::int64_t from)
    : descriptor_(descriptor),
      name_(std::move(name)),
      at_(from),
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

// Begins the next member, or sets `ended_` if there is none.
Result<void> GzipReader::begin_member() {
  inflate_state& s = *state_;
  // ISA-L has given back the bytes that it had read beyond the member.
  while (s.avail_in < kMagic.size() && fill()) {
  }
  if (s.avail_in >= kMagic.size() && std::memcmp(kMagic.data(), s.next_in, kMagic.size()) == 0) {
    isal_inflate_reset(&s);
    s.crc_flag = ISAL_GZIP;
    return {};
  }
  do {
    if (std::any_of(s.next_in, s.next_in + s.avail_in, [](std::uint8_t b) { return b != 0; }))
      return refused(name_ + ": damaged gzip: other bytes follow its end");
    s.avail_in = 0;
  } while (fill());
  ended_ = true;
  return {};
}

Result<std::size_t> GzipReader::read(std::span<char> to) {
  inflate_state& s = *state_;
  s.next_out = reinterpret_cast<std::uint8_t*>(to.data());
  s.avail_out = static_cast<std::uint32_t>(to.size());
  while (s.avail_out > 0 && !ended_) {
    if (s.block_state == ISAL_BLOCK_FINISH) {
      if (const auto ok = begin_member(); !ok) return ok.error();
      if (ended_) break;
    }
    const std::uint32_t in_before = s.avail_in, out_before = s.avail_out;
    if (inflate_on(s) < 0) return refused(name_ + ": damaged gzip");
    if (s.block_state == ISAL_BLOCK_FINISH || s.avail_out != out_before) continue;
    if (s.avail_in == 0 && fill()) continue;
    is_truncated_ = s.avail_in == 0;
    if (is_truncated_ && s.avail_out < to.size()) break;  // the error follows at the next call
    if (is_truncated_) return refused(name_ + ": truncated: its gzip data end early");
    if (s.avail_in == in_before) return refused(name_ + ": damaged gzip");
  }
  return to.size() - s.avail_out;
}

}  // namespace trocar::pipeline
