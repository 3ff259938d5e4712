// SPDX-License-Identifier: GPL-3.0-or-later
// Images as labels: the stored numbers and the indices of palettes, not grey levels.
#include "pipeline/read/image_file.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <utility>
#include <vector>

#include "formats/base/files.h"
#include "pipeline/open/open_stack.h"
#include "pipeline/read/slice_stack.h"
#include "tests/support/take.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;

class LabelImages : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = fs::temp_directory_path() / ("trocar_label_images_" + std::to_string(::getpid()));
    fs::create_directories(folder_);
  }
  static void TearDownTestSuite() { fs::remove_all(folder_); }

  template <class T>
  static void expect_error(const Result<T>& result, ExitCode code, const std::string& text) {
    ASSERT_FALSE(result);
    EXPECT_EQ(result.error().code, code) << result.error().message;
    EXPECT_NE(result.error().message.find(text), std::string::npos) << result.error().message;
    EXPECT_EQ(result.error().message.find('\n'), std::string::npos);
  }

  static fs::path folder_;
};
fs::path LabelImages::folder_;

TEST_F(LabelImages, Of16BitsAreReadUnscaled) {
  cv::Mat labels(2, 3, CV_16UC1);
  for (int i = 0; i < 6; ++i)
    labels.at<std::uint16_t>(i / 3, i % 3) =
        std::array<std::uint16_t, 6>{0, 1, 22, 257, 4000, 65535}[static_cast<std::size_t>(i)];
  for (const char* name : {"labels.png", "labels.tif"}) {
    const fs::path file = folder_ / name;
    ASSERT_TRUE(cv::imwrite(file.string(), labels));
    OpenOptions options;
    options.spacing_mm = {1, 1, 1};
    options.as_labels = true;
    EXPECT_EQ((*open_stack({file}, options))->read(0)->values,
              (std::vector<float>{0, 1, 22, 257, 4000, 65535}))
        << name;
    options.as_labels = false;
    EXPECT_FLOAT_EQ((*open_stack({file}, options))->read(0)->values[3], 1.0F) << name;
  }
}

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
      expect_error(as_labels(corpus / (std::string(name) + kind)), ExitCode::kRefused, "colours");
  }
  // The reused buffer has no effect: an image of as many bytes was decoded before.
  const fs::path white = folder_ / "white.png";
  ASSERT_TRUE(cv::imwrite(white.string(), cv::Mat(kHeight, (kWidth + 1) / 2, CV_8UC1, 255.0)));
  ASSERT_TRUE(as_labels(white));
  EXPECT_EQ(as_labels(corpus / "palette_interlaced.png")->values, indices);
  expect_error(as_labels(corpus / "colour.bmp"), ExitCode::kRefused, "colours");
  expect_error(as_labels(corpus / "grey.jpg"), ExitCode::kRefused, "JPEG");
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
  expect_error(changed(0, 'B', bmp.size() - 1), ExitCode::kRefused, "broken BMP");
  expect_error(changed(0, 'B', 50), ExitCode::kRefused, "broken BMP");
  expect_error(changed(30, 1, bmp.size()), ExitCode::kRefused, "compressed");
  expect_error(changed(13, 0x80, bmp.size()), ExitCode::kRefused, "broken BMP");
}

}  // namespace
}  // namespace trocar::pipeline
