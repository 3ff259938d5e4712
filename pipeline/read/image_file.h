// SPDX-License-Identifier: GPL-3.0-or-later
// Image files as grey levels: PNG, TIFF, JPEG, JPEG 2000.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/read/volume_file.h"

namespace trocar::pipeline {

// Reads one image file as grey levels.

enum class Levels {
  kTo255,  ///< grey levels of 0..255; levels of 16 bits are divided by 257 without rounding
  /// The stored numbers of 1 to 16 bits; used for labels. If a PNG, TIFF or BMP has a palette (a
  /// table of colours), the stored numbers are the indices into the palette.
  kStored,
};

/// Reads a PNG, JPEG, BMP or TIFF; the first bytes tell the format. Images have up to 16 bits per
/// channel. Colours are converted to grey levels. The size is checked before anything is decoded.
///
/// Errors: kRefused if the file cannot be read, is damaged or has an unsupported format, if a TIFF
/// has several pages, or if labels are wanted (kStored) but the image is a JPEG or has colours. The
/// colours of a palette do not count if its indices are returned. The message names the file and
/// the reason.
///
/// OpenCV's imread() is not used, because it prints to stderr, accepts up to 2^30 pixels and tries
/// further formats.
Result<Image> read_image_file(const std::filesystem::path& file, Levels wanted = Levels::kTo255);

// Decodes JPEG 2000 with OpenJPEG, since DCMTK has no decoder for it.

struct Jpeg2000 {
  std::vector<std::int32_t> samples;  ///< row by row
  bool is_signed = false;
};

/// Decodes a codestream with one component of up to 16 bits. It must not have the header of a JP2
/// file. `name` is the input's name in error messages. Errors: kRefused if the bytes are not such a
/// codestream, if the size is not width x height, or if the codestream is damaged.
Result<Jpeg2000> decode_jpeg2000(std::span<const std::uint8_t> codestream, int width, int height,
                                 const std::string& name);

/// Iterates over the chunks of a PNG file. A chunk consists of length, name, data, and the checksum
/// of name and data. The functions below next() describe the chunk to which next() went last.
class PngChunks {
 public:
  using Bytes = std::span<const std::uint8_t>;

  /// Precondition: `file` begins with the signature of PNG.
  explicit PngChunks(Bytes file) : left_(file.subspan(std::min<std::size_t>(file.size(), 8))) {}
  /// Goes to the next chunk. Returns false if there is no further complete chunk.
  bool next() {
    if (left_.size() < 12) return false;
    const std::uint32_t length = big_endian(left_.data());
    if (length > left_.size() - 12) return false;
    named_ = left_.subspan(4, length + std::size_t{4});
    checksum_ = big_endian(left_.data() + 8 + length);
    left_ = left_.subspan(length + std::size_t{12});
    return true;
  }
  bool is(std::string_view name) const { return std::memcmp(named_.data(), name.data(), 4) == 0; }
  /// Does the checksum agree with the name and the data?
  bool is_whole() const { return gzip_checksum(named_) == checksum_; }
  Bytes data() const { return named_.subspan(4); }

 private:
  static std::uint32_t big_endian(const std::uint8_t* at) {
    std::uint32_t value;
    std::memcpy(&value, at, 4);
    return __builtin_bswap32(value);
  }

  Bytes left_, named_;
  std::uint32_t checksum_ = 0;
};

// Decodes the pixels of the usual kinds of PNG (W3C recommendation, third edition). Intel's library
// ISA-L unpacks the pixels, more than twice as fast as zlib.

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
