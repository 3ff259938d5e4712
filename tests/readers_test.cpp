// SPDX-License-Identifier: GPL-3.0-or-later
// The three readers against what the sample's writers put in, and against broken input.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "formats/file_io.h"
#include "pipeline/slice_stack.h"
#include "sample_ct/sample_folder.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;

// A small scan of noise, so that every pixel tells where it came from.
sample::Scan make_scan() {
  sample::Scan scan;
  scan.geometry = *sample::sample_geometry(32, 4);
  scan.geometry.rows = 24;  // not square
  for (int i = 0; i < 32 * 24 * 4; ++i)
    scan.hu.push_back(static_cast<std::int16_t>((i * 7919) % 3000 - 1000));
  return scan;
}

class Readers : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = fs::temp_directory_path() / ("trocar_readers_" + std::to_string(::getpid()));
    fs::create_directories(folder_);
    ASSERT_TRUE(sample::write_sample_folder(make_scan(), {-1000, 3000 - 1000}, folder_ / "scan"));
  }
  static void TearDownTestSuite() { fs::remove_all(folder_); }

  static void expect_error(const Result<std::unique_ptr<SliceStack>>& result, ExitCode code,
                           const std::string& text) {
    ASSERT_FALSE(result);
    EXPECT_EQ(result.error().code, code) << result.error().message;
    EXPECT_NE(result.error().message.find(text), std::string::npos) << result.error().message;
    EXPECT_EQ(result.error().message.find('\n'), std::string::npos);
  }
  static fs::path write(const std::string& name, const std::string& text) {
    fs::create_directories((folder_ / name).parent_path());
    std::ofstream(folder_ / name, std::ios::binary) << text;
    return folder_ / name;
  }

  static fs::path folder_;
};
fs::path Readers::folder_;

TEST_F(Readers, DicomAndNiftiGiveEveryVoxelAndItsPlace) {
  const sample::Scan scan = make_scan();
  for (const fs::path& input : {folder_ / "scan" / "dicom", folder_ / "scan" / "sample.nii.gz"}) {
    const auto stack = open_stack({input}, {});
    ASSERT_TRUE(stack) << stack.error().message;
    EXPECT_TRUE((*stack)->warnings.empty());
    EXPECT_EQ((*stack)->calibration(), Calibration::kHounsfield);
    ASSERT_EQ((*stack)->size(), 4);
    ASSERT_EQ((*stack)->width(), 32);
    ASSERT_EQ((*stack)->height(), 24);
    for (int k = 0; k < 4; ++k) {
      const auto image = (*stack)->read(k);
      ASSERT_TRUE(image) << image.error().message;
      for (int y = 0; y < 24; ++y) {
        for (int x = 0; x < 32; ++x)
          ASSERT_EQ(image->at(x, y), scan.slice(k)[y * 32 + x]) << x << ' ' << y << ' ' << k;
      }
      const SlicePlane& plane = (*stack)->plane(k);
      const sample::Vec3 want = sample::pixel_centre_mm(scan.geometry, 31, 23, k);
      const Eigen::Vector3d got =
          plane.T_lps_plane * Eigen::Vector3d(31 * plane.spacing_u_mm, 23 * plane.spacing_v_mm, 0);
      EXPECT_NEAR((got - Eigen::Vector3d(want.x, want.y, want.z)).norm(), 0, 1e-4) << input;
      EXPECT_NEAR(plane.T_lps_plane.linear().determinant(), 1, 1e-6);
    }
  }
}

TEST_F(Readers, ImagesGiveGreyLevelsAndNeedASpacing) {
  expect_error(open_stack({folder_ / "scan" / "png"}, {}), ExitCode::kUsage, "--spacing");
  OpenOptions options;
  options.spacing_mm = {0.5, 0.25, 2.0};
  const auto stack = open_stack({folder_ / "scan" / "png"}, options);
  ASSERT_TRUE(stack) << stack.error().message;
  EXPECT_EQ((*stack)->calibration(), Calibration::kGrey);
  EXPECT_EQ((*stack)->plane(3).z_mm, 6.0);
  const sample::Scan scan = make_scan();
  const auto image = (*stack)->read(2);
  ASSERT_TRUE(image);
  for (int i = 0; i < 32 * 24; ++i) {
    const double grey = std::clamp((scan.slice(2)[i] + 1000.0) / 3000.0 * 255.0, 0.0, 255.0);
    ASSERT_NEAR(image->values[static_cast<std::size_t>(i)], grey, 0.51) << i;
  }
}

TEST_F(Readers, ImagesComeInNaturalOrder) {
  const std::vector<std::uint8_t> png = *read_file(folder_ / "scan" / "png" / "slice_001.png");
  for (const char* name : {"s10.png", "s9.png", "s1.png", "s100.png"}) {
    write(std::string("natural/") + name, {png.begin(), png.end()});
  }
  write("natural/README.txt", "not an image");
  OpenOptions options;
  options.spacing_mm = {1, 1, 1};
  const auto stack = open_stack({folder_ / "natural"}, options);
  ASSERT_TRUE(stack) << stack.error().message;
  std::string order;
  for (int i = 0; i < (*stack)->size(); ++i)
    order += fs::path((*stack)->name(i)).stem().string() + " ";
  EXPECT_EQ(order, "s1 s9 s10 s100 ");
}

TEST_F(Readers, BrokenInputIsRefusedByName) {
  OpenOptions options;
  options.spacing_mm = {1, 1, 1};
  expect_error(open_stack({folder_ / "nowhere"}, options), ExitCode::kRefused,
               "nowhere: no such file");
  fs::create_directories(folder_ / "empty");
  expect_error(open_stack({folder_ / "empty"}, options), ExitCode::kRefused, "an empty folder");
  expect_error(open_stack({write("bad.png", "no image")}, options), ExitCode::kRefused, "bad.png");
  expect_error(open_stack({write("bad.nii", "no volume")}, options), ExitCode::kRefused, "bad.nii");
  expect_error(open_stack({write("texts/a.txt", "no scan")}, options), ExitCode::kRefused,
               "no DICOM images");

  const std::vector<std::uint8_t> whole = *read_file(folder_ / "scan" / "sample.nii.gz");
  expect_error(
      open_stack({write("cut.nii.gz", {whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(
                                                                          whole.size() / 2)})},
                 options),
      ExitCode::kRefused, "cut.nii.gz");

  // Sizes that differ are found when the slice is read.
  const fs::path first = folder_ / "scan" / "png" / "slice_001.png";
  sample::Scan other = make_scan();
  other.geometry.rows = 16;
  ASSERT_TRUE(sample::write_sample_folder(other, {-1000, 2000}, folder_ / "other"));
  const auto mixed = open_stack({first, folder_ / "other" / "png" / "slice_002.png"}, options);
  ASSERT_TRUE(mixed);
  const auto read = (*mixed)->read(1);
  ASSERT_FALSE(read);
  EXPECT_NE(read.error().message.find("slice_00"), std::string::npos);
}

TEST_F(Readers, DicomSeriesAreSortedChosenAndChecked) {
  const fs::path dicom = folder_ / "scan" / "dicom";
  // Names in the wrong order change nothing.
  fs::create_directories(folder_ / "shuffled");
  int k = 0;
  for (const char* name : {"CT_003.dcm", "CT_001.dcm", "CT_004.dcm", "CT_002.dcm"})
    fs::copy_file(dicom / name, folder_ / "shuffled" / std::to_string(k++));
  const auto stack = open_stack({folder_ / "shuffled"}, {});
  ASSERT_TRUE(stack) << stack.error().message;
  EXPECT_LT((*stack)->plane(0).z_mm, (*stack)->plane(3).z_mm);
  EXPECT_EQ((*stack)->read(2)->values, (*open_stack({dicom}, {}))->read(2)->values);
  // A slice twice.
  fs::copy_file(dicom / "CT_003.dcm", folder_ / "shuffled" / "again");
  expect_error(open_stack({folder_ / "shuffled"}, {}), ExitCode::kRefused,
               "at the same position as");
  fs::remove(folder_ / "shuffled" / "again");
  // A missing slice is said, not filled.
  fs::remove(folder_ / "shuffled" / "3");
  const auto gap = open_stack({folder_ / "shuffled"}, {});
  ASSERT_TRUE(gap);
  EXPECT_EQ((*gap)->size(), 3);
  // Another, smaller series beside it: left out with a warning, or chosen, or asked for in vain.
  sample::Scan other = make_scan();
  other.seed = 2;
  other.geometry.slices = 2;
  ASSERT_TRUE(sample::write_sample_folder(other, {-1000, 2000}, folder_ / "second"));
  fs::copy_file(folder_ / "second" / "dicom" / "CT_001.dcm", folder_ / "shuffled" / "x1");
  fs::copy_file(folder_ / "second" / "dicom" / "CT_002.dcm", folder_ / "shuffled" / "x2");
  write("shuffled/note.txt", "left out");
  const auto both = open_stack({folder_ / "shuffled"}, {});
  ASSERT_TRUE(both) << both.error().message;
  EXPECT_EQ((*both)->size(), 3);
  std::string codes;
  for (const Warning& w : (*both)->warnings)
    codes += w.code + " ";
  EXPECT_NE(codes.find("other_series"), std::string::npos) << codes;
  EXPECT_NE(codes.find("not_dicom"), std::string::npos) << codes;
  OpenOptions options;
  options.series_uid = "1.2.3";
  expect_error(open_stack({folder_ / "shuffled"}, options), ExitCode::kUsage, "there are:");
}

}  // namespace
}  // namespace trocar::pipeline
