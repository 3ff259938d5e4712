// SPDX-License-Identifier: GPL-3.0-or-later
// PNG files made here byte by byte, decoded by decode_png_pixels() and by libspng. Images as labels:
// the stored numbers and the indices of palettes, not grey levels.
#include "pipeline/read/image_file.h"

#include <gtest/gtest.h>

#include <spng.h>
#include <zlib.h>
#include <algorithm>
#include <array>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "formats/base/files.h"
#include "pipeline/open/open_stack.h"
#include "pipeline/read/slice_stack.h"
#include "tests/support/take.h"
#include "tests/support/temporary_folder.h"

namespace trocar::pipeline {
namespace {

using Bytes = std::vector<std::uint8_t>;

struct Kind {
  int color_type = 0, channels = 1, bits = 8;
};
constexpr Kind kKinds[] = {
    {SPNG_COLOR_TYPE_GRAYSCALE, 1, 8},       {SPNG_COLOR_TYPE_GRAYSCALE, 1, 16},
    {SPNG_COLOR_TYPE_TRUECOLOR, 3, 8},       {SPNG_COLOR_TYPE_TRUECOLOR, 3, 16},
    {SPNG_COLOR_TYPE_TRUECOLOR_ALPHA, 4, 8}, {SPNG_COLOR_TYPE_TRUECOLOR_ALPHA, 4, 16}};

PngRows rows_of(const Kind& kind, int width, int height) {
  return {height, static_cast<std::size_t>(width * kind.channels * kind.bits / 8), kind.channels,
          kind.bits / 8};
}

void append_number(Bytes& to, std::uint32_t value) {
  for (const int shift : {24, 16, 8, 0})
    to.push_back(static_cast<std::uint8_t>(value >> shift));
}

void append_chunk(Bytes& to, const std::string& name, const Bytes& data) {
  append_number(to, static_cast<std::uint32_t>(data.size()));
  const std::size_t at = to.size();
  to.insert(to.end(), name.begin(), name.end());
  to.insert(to.end(), data.begin(), data.end());
  append_number(
      to, static_cast<std::uint32_t>(crc32(0, to.data() + at, static_cast<uInt>(to.size() - at))));
}

Bytes deflated(const Bytes& bytes, int level = 6) {
  uLongf size = compressBound(bytes.size());
  Bytes out(size);
  EXPECT_EQ(compress2(out.data(), &size, bytes.data(), bytes.size(), level), Z_OK);
  out.resize(size);
  return out;
}

Bytes start_of_png(const Kind& kind, int width, int height) {
  Bytes file{0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'}, header;
  append_number(header, static_cast<std::uint32_t>(width));
  append_number(header, static_cast<std::uint32_t>(height));
  for (const int value : {kind.bits, kind.color_type, 0, 0, 0})
    header.push_back(static_cast<std::uint8_t>(value));
  append_chunk(file, "IHDR", header);
  append_chunk(file, "tEXt", {'k', 0, 'v'});
  return file;
}

// Writes a PNG whose packed data are in chunks of at most `most` bytes.
Bytes png_of(const Kind& kind, int width, int height, const Bytes& packed,
             std::size_t most = 1 << 20) {
  Bytes file = start_of_png(kind, width, height);
  for (std::size_t at = 0; at < packed.size(); at += most) {
    const auto first = packed.begin() + static_cast<std::ptrdiff_t>(at);
    append_chunk(file, "IDAT",
                 {first, first + static_cast<std::ptrdiff_t>(std::min(most, packed.size() - at))});
  }
  append_chunk(file, "IEND", {});
  return file;
}

// Filtered rows; the filter `filter`, or for -1 a random one in each row. Few different values, so
// that the predictors meet ties, or all.
Bytes filtered_rows(const PngRows& rows, int filter, int values, std::mt19937& random) {
  Bytes out;
  for (int y = 0; y < rows.count; ++y) {
    out.push_back(static_cast<std::uint8_t>(filter < 0 ? static_cast<int>(random() % 5) : filter));
    for (std::size_t i = 0; i < rows.row_bytes; ++i)
      out.push_back(static_cast<std::uint8_t>(random() % static_cast<unsigned>(values)));
  }
  return out;
}

std::optional<Bytes> ours(const Bytes& file, const PngRows& rows) {
  Bytes pixels(rows.row_bytes * static_cast<std::size_t>(rows.count));
  if (!decode_png_pixels(file, rows, pixels)) return std::nullopt;
  return pixels;
}

std::optional<Bytes> libspng(const Bytes& file, const PngRows& rows) {
  const std::unique_ptr<spng_ctx, void (*)(spng_ctx*)> png(spng_ctx_new(0), spng_ctx_free);
  Bytes pixels(rows.row_bytes * static_cast<std::size_t>(rows.count));
  std::size_t size = 0;
  if (spng_set_png_buffer(png.get(), file.data(), file.size()) != 0 ||
      spng_decoded_image_size(png.get(), SPNG_FMT_PNG, &size) != 0 || size != pixels.size() ||
      spng_decode_image(png.get(), pixels.data(), size, SPNG_FMT_PNG, 0) != 0)
    return std::nullopt;
  return pixels;
}

TEST(PngPixels, AreThoseOfLibspng) {
  std::mt19937 random(1);
  for (const Kind& kind : kKinds) {
    for (const auto& [width, height] : {std::pair{1, 1}, {1, 9}, {7, 1}, {33, 20}, {512, 40}}) {
      const PngRows rows = rows_of(kind, width, height);
      for (int filter = -1; filter < 5; ++filter) {
        for (const int values : {3, 256}) {
          const Bytes packed = deflated(filtered_rows(rows, filter, values, random),
                                        static_cast<int>(random() % 10));
          const Bytes file = png_of(kind, width, height, packed, random() % 2 == 0 ? 5 : 1 << 20);
          const auto pixels = ours(file, rows);
          ASSERT_TRUE(pixels) << kind.channels << " channels, filter " << filter;
          EXPECT_EQ(pixels, libspng(file, rows));
        }
      }
    }
  }
}

TEST(PngPixels, AreNotThoseOfDamagedData) {
  std::mt19937 random(2);
  const Kind kind = kKinds[0];
  const int width = 20, height = 10;
  const PngRows rows = rows_of(kind, width, height);
  const Bytes filtered = filtered_rows(rows, -1, 256, random);
  const auto file_of = [&](const Bytes& packed) { return png_of(kind, width, height, packed); };
  ASSERT_TRUE(ours(file_of(deflated(filtered)), rows));

  Bytes wrong = filtered;
  wrong[rows.row_bytes + 1] = 5;
  EXPECT_FALSE(ours(file_of(deflated(wrong)), rows)) << "no such filter";
  for (const std::size_t size :
       {filtered.size() - 1, filtered.size() + 1, filtered.size() + 100000}) {
    Bytes other = filtered;
    other.resize(size);
    EXPECT_FALSE(ours(file_of(deflated(other)), rows)) << size << " bytes";
  }
  Bytes packed = deflated(filtered);
  packed.back() ^= 1;
  EXPECT_FALSE(ours(file_of(packed), rows)) << "checksum of the data";
  packed.back() ^= 1;
  Bytes file = file_of(packed);
  file[file.size() - 13] ^= 1;
  EXPECT_FALSE(ours(file, rows)) << "checksum of the chunk";

  const auto half = packed.begin() + static_cast<std::ptrdiff_t>(packed.size() / 2);
  Bytes interrupted = start_of_png(kind, width, height);
  append_chunk(interrupted, "IDAT", {packed.begin(), half});
  append_chunk(interrupted, "tEXt", {'k', 0, 'v'});
  append_chunk(interrupted, "IDAT", {half, packed.end()});
  EXPECT_FALSE(ours(interrupted, rows)) << "chunks that do not follow each other";

  file = file_of(packed);
  for (std::size_t size = 0; size + 12 < file.size(); ++size)
    EXPECT_FALSE(ours({file.begin(), file.begin() + static_cast<std::ptrdiff_t>(size)}, rows))
        << size << " bytes";
}

TEST(PngPixels, OfMutatedFilesAreThoseOfLibspng) {
  std::mt19937 random(3);
  int decoded = 0;
  for (int round = 0; round < 20000; ++round) {
    const Kind kind = kKinds[random() % std::size(kKinds)];
    const int width = 1 + static_cast<int>(random() % 12),
              height = 1 + static_cast<int>(random() % 12);
    const PngRows rows = rows_of(kind, width, height);
    Bytes packed = deflated(filtered_rows(rows, -1, 4, random));
    // Inside the packed data, so that the chunk's checksum is right, or anywhere.
    if (random() % 2 == 0)
      packed[random() % packed.size()] ^= static_cast<std::uint8_t>(1 << random() % 8);
    Bytes file = png_of(kind, width, height, packed, 1 + random() % 40);
    if (random() % 2 == 0)
      file[random() % file.size()] ^= static_cast<std::uint8_t>(1 << random() % 8);
    const auto pixels = ours(file, rows);
    if (!pixels) continue;
    ++decoded;
    const auto theirs = libspng(file, rows);
    if (theirs) {  // libspng refuses damage in front of the data, too
      EXPECT_EQ(pixels, theirs);
    }
  }
  EXPECT_GT(decoded, 1000);
}

TEST(PngPixels, RefuseRowsThatDoNotFit) {
  std::mt19937 random(4);
  const PngRows rows = rows_of(kKinds[0], 8, 4);
  const Bytes file = png_of(kKinds[0], 8, 4, deflated(filtered_rows(rows, 0, 256, random)));
  Bytes pixels(32);
  EXPECT_TRUE(decode_png_pixels(file, rows, pixels));
  EXPECT_FALSE(decode_png_pixels(file, rows, std::span(pixels).first(31)));
  EXPECT_FALSE(decode_png_pixels(file, {4, 8, 5, 1}, pixels));
  EXPECT_FALSE(decode_png_pixels(file, {4, 8, 3, 1}, pixels));
  EXPECT_FALSE(decode_png_pixels(file, {4, 0, 1, 1}, pixels));
  EXPECT_FALSE(decode_png_pixels(file, {1 << 30, std::size_t{1} << 40, 1, 1}, pixels));
}

namespace fs = std::filesystem;

class LabelImages : public testing::Test {
 protected:
  static void expect_refused(const Result<Image>& result, const std::string& text) {
    ASSERT_FALSE(result);
    EXPECT_EQ(result.error().code, ExitCode::kRefused) << result.error().message;
    EXPECT_NE(result.error().message.find(text), std::string::npos) << result.error().message;
    EXPECT_EQ(result.error().message.find('\n'), std::string::npos);
  }

  test::TemporaryFolder folder_;
};

// The expected indices are taken from the BMP's bytes: the lowest row first, rows padded to words.
TEST_F(LabelImages, OfFewBitsOrAPaletteAreReadUnscaled) {
  const fs::path corpus = fs::path(TROCAR_CORPUS) / "image";
  const auto bmp = *read_file(corpus / "palette.bmp");
  constexpr int kWidth = 19, kHeight = 14, kRow = 20, kPixels = 1078;
  ASSERT_EQ(bmp.size(), kPixels + kRow * kHeight);
  std::vector<float> indices, bits;
  for (int y = kHeight - 1; y >= 0; --y)
    for (int x = 0; x < kWidth; ++x)
      indices.push_back(
          bmp[kPixels + kRow * static_cast<std::size_t>(y) + static_cast<std::size_t>(x)]);
  const cv::Mat black_or_white = cv::imread((corpus / "bits.png").string(), cv::IMREAD_GRAYSCALE);
  ASSERT_EQ(black_or_white.total(), indices.size());
  for (int i = 0; i < kWidth * kHeight; ++i)
    bits.push_back(black_or_white.at<std::uint8_t>(i / kWidth, i % kWidth) > 0 ? 1.0F : 0.0F);
  ASSERT_EQ(*std::max_element(bits.begin(), bits.end()), 1);
  ASSERT_GT(*std::max_element(indices.begin(), indices.end()), 2);
  const auto as_labels = [&](const fs::path& file) {
    return read_image_file(file, Levels::kStored);
  };
  for (const char* kind :
       {".png", "_raw.tif", "_packbits.tif", "_tiff_lzw.tif", "_tiff_deflate.tif"}) {
    for (const auto& [name, want] : {std::pair{"palette", &indices}, {"bits", &bits}}) {
      const auto got = test::take(as_labels(corpus / (std::string(name) + kind)));
      EXPECT_EQ(got.values, *want) << name << kind;
    }
    EXPECT_EQ(as_labels(corpus / (std::string("grey") + kind))->values,
              read_image_file(corpus / (std::string("grey") + kind))->values);
    for (const char* name : {"colour", "alpha"})
      expect_refused(as_labels(corpus / (std::string(name) + kind)), "colours");
  }
  // The reused buffer has no effect: an image of as many bytes was decoded before.
  const fs::path white = folder_ / "white.png";
  ASSERT_TRUE(cv::imwrite(white.string(), cv::Mat(kHeight, (kWidth + 1) / 2, CV_8UC1, 255.0)));
  ASSERT_TRUE(as_labels(white));
  EXPECT_EQ(as_labels(corpus / "palette_interlaced.png")->values, indices);
  expect_refused(as_labels(corpus / "colour.bmp"), "colours");
  expect_refused(as_labels(corpus / "grey.jpg"), "JPEG");
  EXPECT_EQ(as_labels(corpus / "grey.bmp")->values, read_image_file(corpus / "grey.bmp")->values);
}

TEST_F(LabelImages, OfABmpAreTheIndicesOfItsPalette) {
  const fs::path corpus = fs::path(TROCAR_CORPUS) / "image", file = folder_ / "labels.bmp";
  const auto bmp = *read_file(corpus / "palette.bmp");
  const auto indices = read_image_file(corpus / "palette.png", Levels::kStored)->values;
  const auto changed = [&](std::size_t at, std::uint8_t to, std::size_t size) {
    auto bytes = bmp;
    bytes[at] = to;
    bytes.resize(size);
    EXPECT_TRUE(write_file_atomically(file, bytes));
    return read_image_file(file, Levels::kStored);
  };
  const auto same = test::take(changed(0, 'B', bmp.size()));
  EXPECT_EQ(same.values, indices);
  // A negative height (-14 after a change of all its bytes): the highest row comes first.
  auto turned = bmp;
  for (const auto& [at, to] : {std::pair{22U, 0xf2}, {23U, 0xff}, {24U, 0xff}, {25U, 0xff}})
    turned[at] = static_cast<std::uint8_t>(to);
  ASSERT_TRUE(write_file_atomically(file, turned));
  const auto upside_down = test::take(read_image_file(file, Levels::kStored));
  for (int y = 0; y < same.height; ++y)
    for (int x = 0; x < same.width; ++x)
      ASSERT_EQ(upside_down.at(x, y), same.at(x, same.height - 1 - y)) << x << ", " << y;
  expect_refused(changed(0, 'B', bmp.size() - 1), "broken BMP");
  expect_refused(changed(0, 'B', 50), "broken BMP");
  expect_refused(changed(30, 1, bmp.size()), "compressed");
  expect_refused(changed(13, 0x80, bmp.size()), "broken BMP");
}

}  // namespace
}  // namespace trocar::pipeline
