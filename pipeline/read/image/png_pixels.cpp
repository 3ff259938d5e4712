// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/image/png_pixels.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string_view>
#include <utility>
#include <vector>

#include "pipeline/read/image/png_chunks.h"
#include "pipeline/read/isal.h"

namespace trocar::pipeline {
namespace {

using ByteSpan = std::span<const std::uint8_t>;

// Unpacks the data of all IDAT chunks. Returns false if they do not fill `to` exactly.
bool unpack(ByteSpan file, std::span<std::uint8_t> to) {
  thread_local const auto state = std::make_unique<inflate_state>();  // 88 kB
  inflate_state& s = *state;
  isal_inflate_init(&s);
  s.crc_flag = ISAL_ZLIB;
  s.next_out = to.data();
  s.avail_out = static_cast<std::uint32_t>(to.size());
  PngChunks chunks(file);
  bool has_begun = false;
  while (chunks.next()) {
    if (!chunks.is("IDAT")) {
      if (has_begun) return false;  // IDAT chunks must follow each other
      continue;
    }
    has_begun = true;
    if (!chunks.is_whole()) return false;
    s.next_in = const_cast<std::uint8_t*>(chunks.data().data());  // ISA-L only reads it
    s.avail_in = static_cast<std::uint32_t>(chunks.data().size());
    while (s.avail_in > 0 && s.block_state != ISAL_BLOCK_FINISH) {
      const std::uint32_t in_before = s.avail_in, out_before = s.avail_out;
      if (inflate_on(s) != ISAL_DECOMP_OK) return false;
      if (s.avail_in == in_before && s.avail_out == out_before) return false;
    }
    if (s.block_state == ISAL_BLOCK_FINISH) return s.avail_out == 0;
  }
  return false;
}

// The predictor of filter 4: the one of left, above and above_left that is nearest to
// left + above - above_left.
std::uint8_t paeth(int left, int above, int above_left) {
  const int to_left = std::abs(above - above_left), to_above = std::abs(left - above_left);
  const int to_both = std::abs(left + above - 2 * above_left);
  const int second = to_above <= to_both ? above : above_left;
  return static_cast<std::uint8_t>(to_left <= to_above && to_left <= to_both ? left : second);
}

// Decodes one row of pixels of kStep bytes from its filtered bytes and the row above. False if
// there is no such filter.
template <std::size_t kStep>
bool unfilter(const std::uint8_t* in, const std::uint8_t* above, std::uint8_t* out,
              std::size_t size) {
  const std::uint8_t filter = *in++;
  std::array<std::uint8_t, kStep> left{},
      above_left{};  // bytes of the neighbouring pixels, in registers
  const auto each = [&](auto predict) {
    for (std::size_t i = 0; i < size; i += kStep) {
      for (std::size_t k = 0; k < kStep; ++k) {
        left[k] =
            static_cast<std::uint8_t>(in[i + k] + predict(left[k], above[i + k], above_left[k]));
        above_left[k] = above[i + k];
        out[i + k] = left[k];
      }
    }
  };
  switch (filter) {
    case 0:
      std::memcpy(out, in, size);
      return true;
    case 1:
      each([](int l, int, int) { return l; });
      return true;
    case 2:
      for (std::size_t i = 0; i < size; ++i)
        out[i] = static_cast<std::uint8_t>(in[i] + above[i]);
      return true;
    case 3:
      each([](int l, int a, int) { return (l + a) / 2; });
      return true;
    case 4:
      each([](int l, int a, int al) { return paeth(l, a, al); });
      return true;
    default:
      return false;
  }
}

using Unfilter = bool (*)(const std::uint8_t*, const std::uint8_t*, std::uint8_t*, std::size_t);

// The functions for pixels of 0 to 8 bytes; null if no kind of PNG has pixels of this size.
constexpr std::array<Unfilter, 9> kUnfilters{nullptr,     unfilter<1>, unfilter<2>,
                                             unfilter<3>, unfilter<4>, nullptr,
                                             unfilter<6>, nullptr,     unfilter<8>};

void to_host_order(std::span<std::uint8_t> samples) {
  if constexpr (std::endian::native == std::endian::big) return;
  for (std::size_t i = 0; i + 1 < samples.size(); i += 2)
    std::swap(samples[i], samples[i + 1]);
}

}  // namespace

bool decode_png_pixels(ByteSpan file, const PngRows& rows, std::span<std::uint8_t> pixels) {
  // ISA-L counts in 32 bits.
  constexpr std::size_t kMaxBytes = std::size_t{1} << 31, kMaxReusedBytes = std::size_t{1} << 24;
  const std::size_t packed_row = rows.row_bytes + 1, count = static_cast<std::size_t>(rows.count);
  const std::size_t pixel_bytes =
      static_cast<std::size_t>(rows.channels) * static_cast<std::size_t>(rows.sample_bytes);
  const Unfilter unfilter_row = pixel_bytes < kUnfilters.size() ? kUnfilters[pixel_bytes] : nullptr;
  if (unfilter_row == nullptr || rows.row_bytes == 0 || rows.row_bytes % pixel_bytes != 0 ||
      pixels.size() / rows.row_bytes != count || pixels.size() % rows.row_bytes != 0 ||
      packed_row > kMaxBytes / count)
    return false;
  // Unless it is large, the buffer is kept for the next file, since fresh pages take time.
  thread_local std::vector<std::uint8_t> kept;
  std::vector<std::uint8_t> own;
  std::vector<std::uint8_t>& filtered = packed_row * count > kMaxReusedBytes ? own : kept;
  filtered.resize(packed_row * count);
  if (!unpack(file, filtered)) return false;
  const std::vector<std::uint8_t> zeros(rows.row_bytes);
  const std::uint8_t* above = zeros.data();
  for (std::size_t y = 0; y < count; ++y) {
    std::uint8_t* out = pixels.data() + y * rows.row_bytes;
    if (!unfilter_row(filtered.data() + y * packed_row, above, out, rows.row_bytes)) return false;
    // A row keeps the file's byte order until the next row has been decoded.
    if (rows.sample_bytes == 2 && y > 0)
      to_host_order(pixels.subspan((y - 1) * rows.row_bytes, rows.row_bytes));
    above = out;
  }
  if (rows.sample_bytes == 2) to_host_order(pixels.last(rows.row_bytes));
  return true;
}

}  // namespace trocar::pipeline
