// SPDX-License-Identifier: GPL-3.0-or-later
// Decodes the pixels of the usual kinds of PNG (W3C recommendation, third edition). Intel's library
// ISA-L unpacks the pixels, more than twice as fast as zlib.
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

/// Decodes a PNG without interlacing and with samples of 8 or 16 bits. `file` has all bytes of the
/// file. The caller fills `rows` from the header of the PNG. The pixels are written to `pixels`,
/// row after row, with interleaved channels. Samples of 16 bits get the host's byte order. The
/// checksums of the data are verified.
///
/// If the data are damaged or unusual, or `pixels` does not have count * row_bytes bytes, returns
/// false and leaves `pixels` undefined. The caller must then use a complete decoder, which finds
/// the error or is more lenient.
bool decode_png_pixels(std::span<const std::uint8_t> file, const PngRows& rows,
                       std::span<std::uint8_t> pixels);

}  // namespace trocar::pipeline
