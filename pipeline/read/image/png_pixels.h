// SPDX-License-Identifier: GPL-3.0-or-later
// The pixels of a plain PNG (W3C recommendation, third edition), unpacked by ISA-L: more than twice
// as fast as by zlib.
// Tests: tests/pipeline/read/image/png_pixels_test.cpp
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace trocar::pipeline {

struct PngRows {
  int count = 0;              ///< at least 1
  std::size_t row_bytes = 0;  ///< bytes of a row without its filter byte
  int channels = 0;           ///< 1, 3 or 4
  int sample_bytes = 0;       ///< 1 or 2
};

/// Decodes the pixels of a PNG without interlacing, whose samples have 8 or 16 bits, to `pixels`:
/// row after row, channels interleaved, samples of 16 bits in the host's byte order. `file` has all
/// bytes of the file, `rows` describes the rows by its header, and `pixels` has count * row_bytes
/// bytes. Returns false and leaves `pixels` undefined if anything in the data is damaged or
/// unusual; a complete decoder then finds the error, or is more lenient. Checks the checksums of
/// the data.
bool decode_png_pixels(std::span<const std::uint8_t> file, const PngRows& rows,
                       std::span<std::uint8_t> pixels);

}  // namespace trocar::pipeline
