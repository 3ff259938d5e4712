// SPDX-License-Identifier: GPL-3.0-or-later
// Decodes the pixels of a plain PNG (W3C recommendation, third edition). ISA-L unpacks the pixels,
// more than twice as fast as zlib.
// Tests: tests/pipeline/read/image/png_pixels_test.cpp
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace trocar::pipeline {

struct PngRows {
  int count = 0;              ///< number of rows, at least 1
  std::size_t row_bytes = 0;  ///< bytes of a row without its filter byte
  int channels = 0;           ///< 1, 3 or 4
  int sample_bytes = 0;       ///< 1 or 2
};

/// Decodes the pixels of a PNG without interlacing, with samples of 8 or 16 bits, to `pixels`: row
/// after row, with interleaved channels, and samples of 16 bits in the host's byte order. `file`
/// has all bytes of the file, `rows` describes the rows according to the header, and `pixels` must
/// have count * row_bytes bytes. The checksums of the data are checked. If anything in the data is
/// damaged or unusual, returns false and leaves `pixels` undefined. The caller then uses a complete
/// decoder, which finds the error or is more lenient.
bool decode_png_pixels(std::span<const std::uint8_t> file, const PngRows& rows,
                       std::span<std::uint8_t> pixels);

}  // namespace trocar::pipeline
