// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/image_file.h"

#include <openjpeg.h>
#include <spng.h>
#include <tiffio.h>
#include <turbojpeg.h>
#include <bit>
#include <cstdarg>
#include <cstdlib>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace trocar::pipeline {
namespace {

Result<void> check_size(std::int64_t width, std::int64_t height, const std::string& name) {
  if (width < 1 || height < 1 || width > kMaxImageSide || height > kMaxImageSide ||
      width * height > kMaxSlicePixels) {
    return refused(name + ": " + std::to_string(width) + " x " + std::to_string(height) +
                   " pixels");
  }
  return {};
}

// A buffer for a decoder's output. Unless it is large, it is reused for the next file, because
// allocating it takes longer than using it.
cv::Mat decode_buffer(int height, int width, int type) {
  constexpr std::size_t kMaxReusedBytes = std::size_t{1} << 24;
  thread_local cv::Mat kept;
  if (static_cast<std::size_t>(height) * width * CV_ELEM_SIZE(type) > kMaxReusedBytes)
    return cv::Mat(height, width, type);
  kept.create(height, width, type);
  return kept;
}

bool has_colours(const cv::Mat& pixels) {
  cv::Mat first, other;
  cv::extractChannel(pixels, first, 0);
  for (int c = 1; c < 3; ++c) {
    cv::extractChannel(pixels, other, c);
    if (cv::norm(first, other, cv::NORM_INF) != 0) return true;
  }
  return false;
}

// Unpacks samples of less than 8 bits to one byte each. A packed row begins at a byte, and the
// highest bits are the first sample.
cv::Mat unpacked(const cv::Mat& packed, int width, int bits) {
  cv::Mat samples(packed.rows, width, CV_8UC1);
  for (int y = 0; y < packed.rows; ++y) {
    for (int x = 0; x < width; ++x) {
      const int bit = x * bits;
      samples.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(
          packed.at<std::uint8_t>(y, bit / 8) >> (8 - bits - bit % 8) & ((1 << bits) - 1));
    }
  }
  return samples;
}

// Converts pixels of 1, 3 or 4 channels to grey levels; `to_grey` (of cv::cvtColor) gives the order
// of the channels. Converts a few rows at a time, so that they stay in the cache.
Result<Image> to_image(const cv::Mat& pixels, int to_grey, Levels wanted, const std::string& name) {
  if (wanted == Levels::kStored && pixels.channels() > 1 && has_colours(pixels))
    return refused(name + ": colours cannot be labels; use grey levels or a palette's indices");
  constexpr int kRows = 32;
  thread_local cv::Mat grey, levels;
  const bool deep = pixels.depth() == CV_16U && wanted == Levels::kTo255;
  const double scale = deep ? 1.0 / 257.0 : 1.0;
  Image image{pixels.cols, pixels.rows, {}};
  image.values.reserve(pixels.total());
  for (int y = 0; y < pixels.rows; y += kRows) {
    const cv::Mat rows = pixels.rowRange(y, std::min(y + kRows, pixels.rows));
    if (pixels.channels() > 1) cv::cvtColor(rows, grey, to_grey);
    (pixels.channels() > 1 ? grey : rows).convertTo(levels, CV_32F, scale);
    const auto* first = levels.ptr<float>();
    image.values.insert(image.values.end(), first, first + levels.total());
  }
  return image;
}

// Does the file go on to its last chunk? Decoders do not look for it behind the pixels.
bool has_png_end(const std::vector<std::uint8_t>& bytes) {
  PngChunks chunks(bytes);
  while (chunks.next())
    if (chunks.is("IEND")) return chunks.is_whole();
  return false;
}

Result<Image> read_png(const std::vector<std::uint8_t>& bytes, const std::string& name,
                       Levels wanted) {
  const std::unique_ptr<spng_ctx, void (*)(spng_ctx*)> png(spng_ctx_new(0), spng_ctx_free);
  if (!png) return refused_for_now(name + ": not enough memory");
  const auto broken = [&name](int error) {
    return refused(name + ": broken PNG (" + spng_strerror(error) + ")");
  };
  spng_set_chunk_limits(png.get(), 1 << 20, 1 << 22);
  spng_ihdr header;
  if (int e = spng_set_png_buffer(png.get(), bytes.data(), bytes.size()); e != 0) return broken(e);
  if (int e = spng_get_ihdr(png.get(), &header); e != 0) return broken(e);
  if (auto ok = check_size(header.width, header.height, name); !ok) return ok.error();
  // If OpenCV has a type for the file's own format, the file is decoded to that (in the host's byte
  // order). Transparency is ignored.
  const int width = static_cast<int>(header.width), height = static_cast<int>(header.height);
  int format = SPNG_FMT_PNG, type = CV_8UC3, columns = width;
  const bool one_sample = header.color_type == SPNG_COLOR_TYPE_INDEXED ||
                          header.color_type == SPNG_COLOR_TYPE_GRAYSCALE;
  const bool packed = wanted == Levels::kStored && one_sample && header.bit_depth < 8;
  if (packed) columns = (width * header.bit_depth + 7) / 8;
  if (packed || (wanted == Levels::kStored && one_sample && header.bit_depth == 8)) {
    type = CV_8UC1;
  } else if (header.color_type == SPNG_COLOR_TYPE_GRAYSCALE) {
    if (header.bit_depth < 8) format = SPNG_FMT_G8;
    type = header.bit_depth == 16 ? CV_16UC1 : CV_8UC1;
  } else if (header.color_type == SPNG_COLOR_TYPE_TRUECOLOR) {
    type = header.bit_depth == 16 ? CV_16UC3 : CV_8UC3;
  } else if (header.color_type == SPNG_COLOR_TYPE_TRUECOLOR_ALPHA) {
    type = header.bit_depth == 16 ? CV_16UC4 : CV_8UC4;
  } else if (header.bit_depth == 16) {
    format = SPNG_FMT_RGBA16;
    type = CV_16UC4;
  } else {
    format = SPNG_FMT_RGB8;
  }
  std::size_t size = 0;
  if (int e = spng_decoded_image_size(png.get(), format, &size); e != 0) return broken(e);
  cv::Mat pixels = decode_buffer(height, columns, type);
  if (packed) pixels.setTo(0);  // libspng adds an interlaced file's samples to the buffer
  if (size != pixels.total() * pixels.elemSize())
    return bug(name + ": the decoded PNG's size differs from its header's");
  const bool plain =
      format == SPNG_FMT_PNG && header.bit_depth >= 8 && header.interlace_method == 0;
  if (plain) {
    if (int e = spng_decode_chunks(png.get()); e != 0) return broken(e);
  }
  const PngRows rows{height, pixels.step[0], pixels.channels(),
                     static_cast<int>(pixels.elemSize1())};
  if (!plain || !decode_png_pixels(bytes, rows, {pixels.data, size})) {
    if (int e = spng_decode_image(png.get(), pixels.data, size, format, 0); e != 0)
      return broken(e);
  }
  if (!has_png_end(bytes)) return refused(name + ": broken PNG (it ends early)");
  return to_image(packed ? unpacked(pixels, width, header.bit_depth) : pixels,
                  pixels.channels() == 4 ? cv::COLOR_RGBA2GRAY : cv::COLOR_RGB2GRAY, wanted, name);
}

Result<Image> read_jpeg(const std::vector<std::uint8_t>& bytes, const std::string& name) {
  const std::unique_ptr<void, int (*)(void*)> jpeg(tjInitDecompress(), tjDestroy);
  if (!jpeg) return refused_for_now(name + ": not enough memory");
  const auto broken = [&] {
    std::string why = tjGetErrorStr2(jpeg.get());
    for (char& c : why)
      c = c == '\n' ? ' ' : c;
    return refused(name + ": broken JPEG (" + why + ")");
  };
  int width = 0, height = 0, subsampling = 0, colours = 0;
  if (tjDecompressHeader3(jpeg.get(), bytes.data(), bytes.size(), &width, &height, &subsampling,
                          &colours) != 0)
    return broken();
  if (auto ok = check_size(width, height, name); !ok) return ok.error();
  const bool grey = colours == TJCS_GRAY;
  const cv::Mat pixels = decode_buffer(height, width, grey ? CV_8UC1 : CV_8UC3);
  // A warning means that the decoder substituted missing pixels, so it is treated as an error. The
  // number of scans (passes of a progressive JPEG) is limited.
  if (tjDecompress2(jpeg.get(), bytes.data(), bytes.size(), pixels.data, width,
                    static_cast<int>(pixels.step[0]), height, grey ? TJPF_GRAY : TJPF_BGR,
                    TJFLAG_ACCURATEDCT | TJFLAG_STOPONWARNING | TJFLAG_LIMITSCANS) != 0) {
    return broken();
  }
  return to_image(pixels, cv::COLOR_BGR2GRAY, Levels::kTo255, name);
}

// Turns an image whose first row is at the bottom, or whose first column is at the right.
void turn_upright(cv::Mat& pixels, std::uint16_t orientation) {
  constexpr int kUpDown = 0, kLeftRight = 1, kBoth = -1;
  if (orientation == ORIENTATION_BOTLEFT) cv::flip(pixels, pixels, kUpDown);
  if (orientation == ORIENTATION_TOPRIGHT) cv::flip(pixels, pixels, kLeftRight);
  if (orientation == ORIENTATION_BOTRIGHT) cv::flip(pixels, pixels, kBoth);
}

// The tags of a TIFF that say what its samples are.
struct TiffSamples {
  std::uint16_t bits = 1, channels = 1, format = SAMPLEFORMAT_UINT, compression = COMPRESSION_NONE,
                photometric = PHOTOMETRIC_MINISBLACK, orientation = ORIENTATION_TOPLEFT,
                extra = EXTRASAMPLE_UNSPECIFIED;  ///< kind of the last channel, if has_extra()

  bool is_grey() const {
    return photometric == PHOTOMETRIC_MINISBLACK || photometric == PHOTOMETRIC_MINISWHITE;
  }
  bool is_palette() const { return photometric == PHOTOMETRIC_PALETTE; }
  int colours() const { return photometric == PHOTOMETRIC_RGB ? 3 : 1; }
  bool has_extra() const {
    return (is_grey() || is_palette() || photometric == PHOTOMETRIC_RGB) && channels > colours();
  }
};

TiffSamples samples_of(TIFF* tiff) {
  TiffSamples out;
  std::uint16_t extras = 0, *kinds = nullptr;
  TIFFGetFieldDefaulted(tiff, TIFFTAG_BITSPERSAMPLE, &out.bits);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLESPERPIXEL, &out.channels);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLEFORMAT, &out.format);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_COMPRESSION, &out.compression);
  TIFFGetField(tiff, TIFFTAG_PHOTOMETRIC, &out.photometric);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_ORIENTATION, &out.orientation);
  if (TIFFGetFieldDefaulted(tiff, TIFFTAG_EXTRASAMPLES, &extras, &kinds) == 1 && extras == 1)
    out.extra = kinds[0];
  return out;
}

// Reads the stored samples row by row. libtiff's own conversion would reduce 16 bits per channel to
// 8, invert labels if white is zero, and multiply grey levels by transparency.
Result<Image> read_tiff_rows(TIFF* tiff, int width, int height, const TiffSamples& is,
                             const std::string& name, Levels wanted) {
  std::uint16_t planar = PLANARCONFIG_CONTIG;
  TIFFGetFieldDefaulted(tiff, TIFFTAG_PLANARCONFIG, &planar);
  if (TIFFIsTiled(tiff) != 0 || planar != PLANARCONFIG_CONTIG || is.channels > is.colours() + 1 ||
      (is.bits == 1 && is.channels > 1)) {
    return refused(name + ": a TIFF of " + std::to_string(is.bits) + " bits in tiles, planes or " +
                   std::to_string(is.channels) + " channels");
  }
  cv::Mat pixels = decode_buffer(height, is.bits == 1 ? (width + 7) / 8 : width,
                                 CV_MAKETYPE(is.bits == 16 ? CV_16U : CV_8U, is.channels));
  if (TIFFScanlineSize64(tiff) != pixels.step[0])
    return refused(name + ": broken TIFF (rows of another length)");
  for (int y = 0; y < height; ++y) {
    if (TIFFReadScanline(tiff, pixels.ptr(y), static_cast<std::uint32_t>(y), 0) != 1)
      return refused(name + ": broken TIFF (row " + std::to_string(y) + ")");
  }
  if (is.bits == 1) pixels = unpacked(pixels, width, 1);
  if (is.has_extra()) {
    cv::Mat alpha;
    cv::extractChannel(pixels, alpha, is.channels - 1);
    double least = 0;
    cv::minMaxLoc(alpha, &least);
    if (is.extra != EXTRASAMPLE_UNASSALPHA && least < (is.bits == 16 ? 65535 : 255))
      return refused(name +
                     ": its levels are multiplied by a transparency, or it has a channel of "
                     "another kind; save it without this channel");
    std::vector<cv::Mat> channels;
    cv::split(pixels, channels);
    channels.pop_back();
    cv::merge(channels, pixels);
  }
  if (is.photometric == PHOTOMETRIC_MINISWHITE && wanted == Levels::kTo255)
    cv::bitwise_not(pixels, pixels);  // of 8 or 16 bits
  turn_upright(pixels, is.orientation);
  return to_image(pixels, cv::COLOR_RGB2GRAY, wanted, name);
}

Result<Image> read_tiff(const std::filesystem::path& file, const std::string& name, Levels wanted) {
  const auto silent = [](TIFF*, void*, const char*, const char*, va_list) { return 1; };
  std::unique_ptr<TIFFOpenOptions, void (*)(TIFFOpenOptions*)> options(TIFFOpenOptionsAlloc(),
                                                                       TIFFOpenOptionsFree);
  if (!options) return refused_for_now(name + ": not enough memory");
  TIFFOpenOptionsSetMaxSingleMemAlloc(options.get(), tmsize_t{1} << 29);
  TIFFOpenOptionsSetErrorHandlerExtR(options.get(), silent, nullptr);
  TIFFOpenOptionsSetWarningHandlerExtR(options.get(), silent, nullptr);
  const std::unique_ptr<TIFF, void (*)(TIFF*)> tiff(TIFFOpenExt(file.c_str(), "rm", options.get()),
                                                    TIFFClose);
  std::uint32_t width = 0, height = 0;
  if (!tiff || TIFFGetField(tiff.get(), TIFFTAG_IMAGEWIDTH, &width) != 1 ||
      TIFFGetField(tiff.get(), TIFFTAG_IMAGELENGTH, &height) != 1) {
    return refused(name + ": broken TIFF");
  }
  if (TIFFLastDirectory(tiff.get()) == 0) {
    return refused(name +
                   ": a TIFF of several pages; only files of one image are read (tiffsplit "
                   "splits it)");
  }
  if (auto ok = check_size(width, height, name); !ok) return ok.error();
  const TiffSamples is = samples_of(tiff.get());
  if (is.orientation < ORIENTATION_TOPLEFT || is.orientation > ORIENTATION_BOTLEFT)
    return refused(name + ": a TIFF whose rows are columns of the picture (Orientation " +
                   std::to_string(is.orientation) + "); save it upright");
  if ((is.bits != 1 && is.bits != 8 && is.bits != 16) || is.format != SAMPLEFORMAT_UINT)
    return refused(name + ": neither 8 nor 16 bits a channel");
  const int w = static_cast<int>(width), h = static_cast<int>(height);
  const bool is_rgb = is.photometric == PHOTOMETRIC_RGB;
  if (wanted == Levels::kStored) {
    if (is.compression == COMPRESSION_JPEG || is.compression == COMPRESSION_OJPEG)
      return refused(name + ": a JPEG in a TIFF cannot hold labels: its levels are not exact");
    if (!is.is_grey() && !is.is_palette() && !is_rgb)
      return refused(name + ": colours cannot be labels; use grey levels or a palette's indices");
  }
  const bool is_deep = is.bits == 16 && (is.is_grey() || is_rgb);
  const bool is_label_row =
      wanted == Levels::kStored && (is.is_palette() || is.photometric == PHOTOMETRIC_MINISWHITE ||
                                    (is.is_grey() && is.bits == 1));
  if (is_deep || is_label_row || (is.has_extra() && !is.is_palette()))
    return read_tiff_rows(tiff.get(), w, h, is, name, wanted);
  const cv::Mat pixels = decode_buffer(h, w, CV_8UC4);
  if (TIFFReadRGBAImageOriented(tiff.get(), width, height,
                                reinterpret_cast<std::uint32_t*>(pixels.data), ORIENTATION_TOPLEFT,
                                1) != 1) {
    return refused(name + ": broken TIFF");
  }
  return to_image(pixels, cv::COLOR_RGBA2GRAY, wanted, name);
}

// The indices of a BMP with a palette and 8 bits a pixel, which libturbojpeg replaces by colours.
// Rows are padded to words; the lowest row comes first, unless the height is negative.
Result<Image> bmp_indices(const std::vector<std::uint8_t>& bytes, int width, int height,
                          bool is_top_down, const std::string& name) {
  std::uint32_t start = 0;
  std::memcpy(&start, bytes.data() + 10, 4);
  const std::size_t row = (static_cast<std::size_t>(width) + 3) / 4 * 4,
                    size = row * static_cast<std::size_t>(height);
  if (start > bytes.size() || size > bytes.size() - start) return refused(name + ": broken BMP");
  Image image{width, height, {}};
  image.values.reserve(static_cast<std::size_t>(width) * height);
  for (int y = 0; y < height; ++y) {
    const std::uint8_t* first =
        bytes.data() + start + row * static_cast<std::size_t>(is_top_down ? y : height - 1 - y);
    image.values.insert(image.values.end(), first, first + width);
  }
  return image;
}

// Width and height are at fixed offsets. The header's size determines whether they have 16 or 32
// bits.
Result<Image> read_bmp(const std::filesystem::path& file, const std::vector<std::uint8_t>& bytes,
                       const std::string& name, Levels wanted) {
  if (bytes.size() < 30) return refused(name + ": broken BMP");
  const auto i32 = [&bytes](std::size_t at) {
    std::int32_t value;
    std::memcpy(&value, bytes.data() + at, 4);
    return static_cast<std::int64_t>(value);
  };
  const bool old = i32(14) == 12;
  const std::int64_t columns = old ? bytes[18] | bytes[19] << 8 : i32(18);
  const std::int64_t rows = old ? bytes[20] | bytes[21] << 8 : std::abs(i32(22));
  if (auto ok = check_size(columns, rows, name); !ok) return ok.error();
  const std::size_t bits_at = old ? 24 : 28;
  if (wanted == Levels::kStored && (bytes[bits_at] | bytes[bits_at + 1] << 8) == 8) {
    constexpr std::size_t kNewHeader = 54;
    if (!old && (bytes.size() < kNewHeader || i32(30) != 0))
      return refused(name + ": broken BMP, or a compressed one");
    return bmp_indices(bytes, static_cast<int>(columns), static_cast<int>(rows),
                       !old && i32(22) < 0, name);
  }
  int width = 0, height = 0, format = TJPF_BGR;
  const std::unique_ptr<unsigned char, void (*)(unsigned char*)> loaded(
      tjLoadImage(file.c_str(), &width, 1, &height, &format, 0), tjFree);
  if (!loaded || width != columns || height != rows)
    return refused(name + ": broken BMP, or one of neither 8, 24 nor 32 bits a pixel");
  return to_image(cv::Mat(height, width, CV_8UC3, loaded.get()), cv::COLOR_BGR2GRAY, wanted, name);
}

// The state of an OpenJPEG stream over bytes in memory.
struct Memory {
  std::span<const std::uint8_t> bytes;
  std::size_t at = 0;
};

OPJ_SIZE_T read_bytes(void* to, OPJ_SIZE_T count, void* user) {
  auto& m = *static_cast<Memory*>(user);
  const std::size_t n = std::min<std::size_t>(count, m.bytes.size() - m.at);
  if (n == 0) return static_cast<OPJ_SIZE_T>(-1);
  std::memcpy(to, m.bytes.data() + m.at, n);
  m.at += n;
  return n;
}

OPJ_BOOL seek_to(OPJ_OFF_T place, void* user) {
  auto& m = *static_cast<Memory*>(user);
  if (place < 0 || static_cast<std::size_t>(place) > m.bytes.size()) return OPJ_FALSE;
  m.at = static_cast<std::size_t>(place);
  return OPJ_TRUE;
}

OPJ_OFF_T skip_bytes(OPJ_OFF_T count, void* user) {
  auto& m = *static_cast<Memory*>(user);
  return seek_to(static_cast<OPJ_OFF_T>(m.at) + count, user) ? count : -1;
}

// OpenJPEG allocates tiles as soon as it has read the header, so their number is checked before
// that. SIZ is always the first marker segment, and its fields are at fixed offsets (ISO 15444-1,
// A.5.1).
bool has_expected_size(std::span<const std::uint8_t> c, int width, int height) {
  const auto u32 = [&c](std::size_t at) {
    return static_cast<std::uint32_t>(c[at]) << 24 | static_cast<std::uint32_t>(c[at + 1]) << 16 |
           static_cast<std::uint32_t>(c[at + 2]) << 8 | c[at + 3];
  };
  if (c.size() < 42 || c[0] != 0xff || c[1] != 0x4f || c[2] != 0xff || c[3] != 0x51) return false;
  const std::uint32_t tile_x = u32(24), tile_y = u32(28);
  if (u32(8) != static_cast<std::uint32_t>(width) || u32(12) != static_cast<std::uint32_t>(height))
    return false;
  if (u32(16) != 0 || u32(20) != 0 || u32(32) != 0 || u32(36) != 0 || tile_x == 0 || tile_y == 0)
    return false;
  const std::uint64_t across = (static_cast<std::uint64_t>(width) + tile_x - 1) / tile_x;
  const std::uint64_t down = (static_cast<std::uint64_t>(height) + tile_y - 1) / tile_y;
  return across * down <= 4096 && c[40] == 0 && c[41] == 1;
}

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

Result<Image> read_image_file(const std::filesystem::path& file, Levels wanted) {
  const std::string name = file.string();
  const auto read = read_file(file);
  if (!read) return read.error();
  const std::vector<std::uint8_t>& bytes = *read;
  const auto starts = [&bytes](std::string_view magic) {
    return bytes.size() > magic.size() &&
           std::memcmp(bytes.data(), magic.data(), magic.size()) == 0;
  };
  try {
    using namespace std::string_view_literals;
    if (starts("\x89PNG\r\n\x1a\n"sv)) return read_png(bytes, name, wanted);
    if (starts("\xff\xd8\xff"sv)) {
      if (wanted == Levels::kStored)
        return refused(name + ": a JPEG cannot hold labels: its levels are not exact");
      return read_jpeg(bytes, name);
    }
    if (starts("II*\0"sv) || starts("MM\0*"sv)) return read_tiff(file, name, wanted);
    if (starts("BM"sv)) return read_bmp(file, bytes, name, wanted);
    return refused(name + ": not a readable image (neither PNG, JPEG, TIFF nor BMP)");
  } catch (const cv::Exception& e) {
    return refused(name + ": " + e.err);
  } catch (const std::bad_alloc&) {
    return refused_for_now(name + ": not enough memory to decode it");
  }
}

Result<Jpeg2000> decode_jpeg2000(std::span<const std::uint8_t> codestream, int width, int height,
                                 const std::string& name) {
  if (!has_expected_size(codestream, width, height)) {
    return refused(name + ": not a JPEG 2000 codestream of one component of " +
                   std::to_string(width) + " x " + std::to_string(height));
  }
  const std::unique_ptr<opj_codec_t, void (*)(opj_codec_t*)> codec(
      opj_create_decompress(OPJ_CODEC_J2K), opj_destroy_codec);
  Memory memory{codestream};
  const std::unique_ptr<opj_stream_t, void (*)(opj_stream_t*)> stream(
      opj_stream_create(1 << 16, OPJ_TRUE), opj_stream_destroy);
  if (!codec || !stream) return refused_for_now(name + ": not enough memory to decode JPEG 2000");
  opj_stream_set_user_data(stream.get(), &memory, nullptr);
  opj_stream_set_user_data_length(stream.get(), codestream.size());
  opj_stream_set_read_function(stream.get(), read_bytes);
  opj_stream_set_skip_function(stream.get(), skip_bytes);
  opj_stream_set_seek_function(stream.get(), seek_to);
  opj_dparameters_t parameters;
  opj_set_default_decoder_parameters(&parameters);
  opj_image_t* raw = nullptr;
  const bool has_header = opj_setup_decoder(codec.get(), &parameters) &&
                          opj_decoder_set_strict_mode(codec.get(), OPJ_TRUE) &&
                          opj_read_header(stream.get(), codec.get(), &raw);
  const std::unique_ptr<opj_image_t, void (*)(opj_image_t*)> image(raw, opj_image_destroy);
  const auto fits = [&] {
    return image->numcomps == 1 && image->comps[0].w == static_cast<OPJ_UINT32>(width) &&
           image->comps[0].h == static_cast<OPJ_UINT32>(height) && image->comps[0].prec <= 16;
  };
  if (!has_header || !image || !fits())
    return refused(name + ": its JPEG 2000 header is damaged or of more than 16 bits");
  if (!opj_decode(codec.get(), stream.get(), image.get()) ||
      !opj_end_decompress(codec.get(), stream.get()) || !fits() ||
      image->comps[0].data == nullptr) {
    return refused(name + ": its JPEG 2000 data is damaged or truncated");
  }
  const opj_image_comp_t& samples = image->comps[0];
  Jpeg2000 out;
  out.samples.assign(samples.data, samples.data + static_cast<std::size_t>(width) * height);
  out.is_signed = samples.sgnd != 0;
  return out;
}

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
