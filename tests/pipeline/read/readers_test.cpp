// SPDX-License-Identifier: GPL-3.0-or-later
// The three readers: they give the voxels that the sample's writers wrote, and refuse broken input.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "formats/base/files.h"
#include "pipeline/open/open_stack.h"
#include "pipeline/open/scan_folder.h"
#include "pipeline/read/image_file.h"
#include "pipeline/read/slice_stack.h"
#include "sample_ct/sample_folder.h"
#include "tests/support/take.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;

// A small scan of varied values, so that misplaced pixels are detected.
sample::Scan make_scan() {
  sample::Scan scan;
  scan.geometry = *sample::sample_geometry(32, 4);
  scan.geometry.rows = 24;  // not square
  for (int i = 0; i < 32 * 24 * 4; ++i)
    scan.hu.push_back(static_cast<std::int16_t>((i * 7919) % 3000 - 1000));
  return scan;
}

OpenOptions with_spacing(const std::array<double, 3>& spacing_mm) {
  OpenOptions out;
  out.spacing_mm = spacing_mm;
  return out;
}
OpenOptions along(SliceAxis axis) {
  OpenOptions out;
  out.axis = axis;
  return out;
}

class Readers : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = fs::temp_directory_path() / ("trocar_readers_" + std::to_string(::getpid()));
    fs::create_directories(folder_);
    ASSERT_TRUE(sample::write_sample_folder(make_scan(), {-1000, 3000 - 1000}, folder_ / "scan"));
  }
  static void TearDownTestSuite() { fs::remove_all(folder_); }

  template <class T>
  static void expect_error(const Result<T>& result, ExitCode code, const std::string& text) {
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

TEST_F(Readers, ImagesGiveGreyLevelsAndNeedASpacing) {
  expect_error(open_stack({folder_ / "scan" / "png"}, {}), ExitCode::kUsage, "--spacing");
  const OpenOptions options = with_spacing({0.5, 0.25, 2.0});
  const auto stack = test::take(open_stack({folder_ / "scan" / "png"}, options));
  EXPECT_EQ(stack->pixel_unit(), PixelUnit::kGrey);
  EXPECT_EQ(stack->plane(3).z_mm, 6.0);
  const sample::Scan scan = make_scan();
  const auto image = test::take(stack->read(2));
  for (int i = 0; i < 32 * 24; ++i) {
    const double grey = std::clamp((scan.slice(2)[i] + 1000.0) / 3000.0 * 255.0, 0.0, 255.0);
    ASSERT_NEAR(image.values[static_cast<std::size_t>(i)], grey, 0.51) << i;
  }
}

TEST_F(Readers, ImagesComeInNaturalOrder) {
  const std::vector<std::uint8_t> png = *read_file(folder_ / "scan" / "png" / "slice_001.png");
  for (const char* name : {"s10.png", "s9.png", "s1.png", "s100.png"}) {
    write(std::string("natural/") + name, {png.begin(), png.end()});
  }
  write("natural/README.txt", "not an image");
  OpenOptions options = with_spacing({1, 1, 1});
  const auto stack = test::take(open_stack({folder_ / "natural"}, options));
  std::string order;
  for (int i = 0; i < stack->size(); ++i)
    order += fs::path(stack->name(i)).stem().string() + " ";
  EXPECT_EQ(order, "s1 s9 s10 s100 ");
}

TEST_F(Readers, BrokenInputIsRefusedByName) {
  OpenOptions options = with_spacing({1, 1, 1});
  expect_error(open_stack({folder_ / "nowhere"}, options), ExitCode::kRefused,
               "nowhere: no such file");
  fs::create_directories(folder_ / "empty");
  expect_error(open_stack({folder_ / "empty"}, options), ExitCode::kRefused, "an empty folder");
  expect_error(open_stack({write("bad.png", "no image")}, options), ExitCode::kRefused, "bad.png");
  expect_error(open_stack({write("bad.nii", "no volume")}, options), ExitCode::kRefused, "bad.nii");
  expect_error(open_stack({write("texts/a.txt", "no scan")}, options), ExitCode::kRefused,
               "a.txt: not a DICOM image");
  write("texts/b.txt", "no scan");
  expect_error(open_stack({folder_ / "texts"}, options), ExitCode::kRefused,
               "texts/: contains no DICOM images (a.txt is not one)");

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
  const auto mixed =
      test::take(open_stack({first, folder_ / "other" / "png" / "slice_002.png"}, options));
  const auto read = mixed->read(1);
  ASSERT_FALSE(read);
  EXPECT_NE(read.error().message.find("slice_00"), std::string::npos);
}

// A folder may contain other files: a text, an asset. A link that leads nowhere may be a slice.
TEST_F(Readers, OnlyTheSlicesOfAFolderAreTheInput) {
  const fs::path folder = folder_ / "beside";
  fs::copy(folder_ / "scan" / "dicom", folder);
  fs::create_symlink("nowhere", folder / "a_link");
  fs::create_symlink("nowhere", folder / "z_link");
  write("beside/out.glb", "glTF");
  expect_error(open_stack({folder}, {}), ExitCode::kRefused,
               "a_link: No such file or directory (a link that leads nowhere) (and 1 more file "
               "that cannot be read)");
  fs::remove(folder / "a_link");
  fs::remove(folder / "z_link");
  const auto stack = test::take(open_stack({folder}, {}));
  ASSERT_EQ(stack->size(), 4);
  std::string files;
  for (const fs::path& file : stack->files)
    files += file.filename().string() + " ";
  EXPECT_EQ(files, "CT_001.dcm CT_002.dcm CT_003.dcm CT_004.dcm ");
  // An image beside DICOM files is left out, with a warning.
  fs::copy(folder_ / "scan" / "png" / "slice_001.png", folder / "preview.png");
  const auto beside = test::take(open_stack({folder}, {}));
  EXPECT_EQ(beside->size(), 4);
  ASSERT_FALSE(beside->warnings.empty());
  EXPECT_EQ(beside->warnings[0].code, "other_input");
  EXPECT_NE(beside->warnings[0].sentence.find("preview.png"), std::string::npos);
}

// A wrong folder, a home for example, ends soon; a link to a folder above ends, too.
TEST_F(Readers, TheSearchOfAFolderIsBounded) {
  const fs::path folder = folder_ / "bounded";
  for (const char* file : {"a/b/c/d/5", "a/b/c/4", "a/b/3", "a/10", "a/9", ".hidden/x", "1"})
    write((fs::path("bounded") / file).string(), "text");
  fs::create_directory_symlink(folder, folder / "a" / "b" / "loop");
  fs::create_directory_symlink("b", folder / "a" / "a_link");
  const auto names = [&](const SearchLimits& limits, std::vector<Warning>& warnings) {
    const auto files = files_below(folder, warnings, limits);
    if (!files) return files.error().message;
    std::string out;
    for (const fs::path& file : *files)
      out += file.lexically_relative(folder).string() + " ";
    return out;
  };
  std::vector<Warning> warnings;
  EXPECT_EQ(names({}, warnings), "1 a/9 a/10 a/b/3 a/b/c/4 a/b/c/d/5 ");
  EXPECT_TRUE(warnings.empty());
  EXPECT_EQ(names({3, 100}, warnings), "1 a/9 a/10 a/b/3 a/b/c/4 ");
  ASSERT_EQ(warnings.size(), 1U);
  EXPECT_EQ(warnings[0].code, "folder_left_out");
  EXPECT_TRUE(warnings[0].where.ends_with("bounded/a/b/c/d")) << warnings[0].where;
  EXPECT_EQ(names({16, 13}, warnings), "1 a/9 a/10 a/b/3 a/b/c/4 a/b/c/d/5 ");
  EXPECT_NE(names({16, 12}, warnings).find("more than 12 files and folders"), std::string::npos);
  EXPECT_EQ(warnings.size(), 1U);
}

TEST_F(Readers, VolumesInOtherUnitsAreInMm) {
  auto bytes = *read_file(fs::path(TROCAR_CORPUS) / "nifti" / "one_i2.nii");
  constexpr std::size_t kUnits = 123;  // xyzt_units
  const auto with = [&](std::uint8_t code) {
    bytes[kUnits] = static_cast<std::uint8_t>((bytes[kUnits] & ~7U) | code);
    return open_stack({write("units.nii", {bytes.begin(), bytes.end()})}, {});
  };
  const auto in_mm = test::take(with(2));
  const SlicePlane& mm = in_mm->plane(in_mm->size() - 1);
  for (const auto& [code, scale] : {std::pair{0, 1.0}, {1, 1000.0}, {3, 0.001}}) {
    const auto stack = test::take(with(static_cast<std::uint8_t>(code)));
    const SlicePlane& got = stack->plane(stack->size() - 1);
    EXPECT_DOUBLE_EQ(got.spacing_u_mm, scale * mm.spacing_u_mm) << code;
    EXPECT_DOUBLE_EQ(got.spacing_v_mm, scale * mm.spacing_v_mm) << code;
    EXPECT_NEAR((got.T_lps_plane.translation() - scale * mm.T_lps_plane.translation()).norm(), 0,
                1e-9 * scale)
        << code;
  }
  expect_error(with(5), ExitCode::kRefused, "unit of length 5");
}

// A volume without voxel sizes needs --spacing: 1 mm is not assumed. X, Y and Z are the array's
// axes, in the file's orientation.
TEST_F(Readers, AVolumeWithoutVoxelSizesNeedsASpacing) {
  const auto whole = *read_file(fs::path(TROCAR_CORPUS) / "nifti" / "one_i2.nii");
  constexpr std::size_t kPixdim = 76, kQformCode = 252, kSformCode = 254;
  const auto with = [&](std::array<float, 3> sizes, std::int16_t qform,
                        const OpenOptions& options) {
    auto bytes = whole;
    std::memcpy(bytes.data() + kPixdim + sizeof(float), sizes.data(), sizeof sizes);
    std::memcpy(bytes.data() + kQformCode, &qform, sizeof qform);
    std::memset(bytes.data() + kSformCode, 0, sizeof(std::int16_t));
    return open_stack({write("sizes.nii", {bytes.begin(), bytes.end()})}, options);
  };
  const OpenOptions given = with_spacing({0.5, 0.25, 3.0});
  for (const std::int16_t qform : {std::int16_t{0}, std::int16_t{1}}) {
    const auto own = test::take(with({0.5F, 0.25F, 3.0F}, qform, {}));
    for (const std::array<float, 3> sizes :
         {std::array{0.0F, 0.0F, 0.0F}, {0.5F, 0.25F, 0.0F}, {NAN, 0.25F, 3.0F}}) {
      expect_error(with(sizes, qform, {}), ExitCode::kUsage, "sizes.nii: carries no voxel size");
      const auto stack = test::take(with(sizes, qform, given));
      for (int k = 0; k < own->size(); ++k) {
        EXPECT_NEAR(stack->plane(k).spacing_u_mm, own->plane(k).spacing_u_mm, 1e-9);
        EXPECT_NEAR(stack->plane(k).spacing_v_mm, own->plane(k).spacing_v_mm, 1e-9);
        EXPECT_TRUE(stack->plane(k).T_lps_plane.isApprox(own->plane(k).T_lps_plane, 1e-6));
      }
      EXPECT_EQ(stack->warnings.size(), own->warnings.size());
    }
  }
  expect_error(with({-0.5F, 0.25F, 3.0F}, 1, {}), ExitCode::kUsage, "carries no voxel size");
}

TEST_F(Readers, MissingImageNumbersGiveAWarning) {
  const std::vector<std::uint8_t> png = *read_file(folder_ / "scan" / "png" / "slice_001.png");
  const OpenOptions options = with_spacing({1, 1, 2.5});
  const auto warned = [&](const std::string& folder, const std::vector<std::string>& names) {
    std::vector<std::string> out;
    for (const std::string& name : names)
      write((fs::path(folder) / name).string(), {png.begin(), png.end()});
    const auto stack = open_stack({folder_ / folder}, options);
    if (!stack) return std::vector<std::string>{stack.error().message};
    for (const Warning& w : (*stack)->warnings)
      out.push_back(w.code + " " + w.where + " " + w.sentence);
    return out;
  };
  const auto gap = warned("gap", {"s8.png", "s9.png", "s10.png", "s12.png", "s13.png"});
  ASSERT_EQ(gap.size(), 1U);
  for (const char* part : {"missing_slice", "s10.png", "s12.png", "2.5 mm"})
    EXPECT_NE(gap[0].find(part), std::string::npos) << gap[0];
  EXPECT_EQ(warned("two_gaps", {"s1x2.png", "s2x2.png", "s4x2.png", "s5x2.png", "s7x2.png"}).size(),
            2U);
  EXPECT_TRUE(warned("row", {"s8.png", "s9.png", "s10.png", "s11.png"}).empty());
  EXPECT_TRUE(warned("tens", {"s0.png", "s10.png", "s20.png", "s30.png"}).empty());
  EXPECT_TRUE(warned("words", {"a.png", "b.png", "z.png"}).empty());
  EXPECT_TRUE(warned("rows", {"a1.png", "a2.png", "b7.png", "b8.png"}).empty());
}

TEST_F(Readers, SeriesIsForDicomInputOnly) {
  OpenOptions options = with_spacing({1, 1, 1});
  options.series = "1.2.3";
  for (const char* input : {"png", "sample.nii.gz"})
    expect_error(open_stack({folder_ / "scan" / input}, options), ExitCode::kUsage, "--series");
  expect_error(open_stack({folder_ / "scan" / "dicom"}, options), ExitCode::kUsage, "no series");
}

TEST_F(Readers, ATiffOfSeveralPagesIsRefused) {
  const std::vector<cv::Mat> pages(3, cv::Mat(8, 8, CV_8UC1, cv::Scalar(90)));
  const std::string file = (folder_ / "pages.tif").string();
  ASSERT_TRUE(cv::imwritemulti(file, pages));
  OpenOptions options = with_spacing({1, 1, 1});
  expect_error(open_stack({file}, options), ExitCode::kRefused, "several pages");
}

// Every kind of image in the corpus (written by Pillow), compared with OpenCV's decoders.
TEST_F(Readers, ImagesEqualWhatOpenCvReads) {
  int compared = 0;
  for (const fs::directory_entry& entry :
       fs::directory_iterator(fs::path(TROCAR_CORPUS) / "image")) {
    const fs::path& file = entry.path();
    if (file.filename().string().starts_with("found_")) continue;
    // OpenCV multiplies the levels of a TIFF by its transparency, those of the equal PNG it does not.
    const bool is_alpha_tiff = file.filename().string().starts_with("alpha_");
    cv::Mat want = cv::imread((is_alpha_tiff ? file.parent_path() / "alpha.png" : file).string(),
                              cv::IMREAD_UNCHANGED);
    const auto got = read_image_file(file);
    if (want.empty() || (want.channels() != 1 && want.channels() != 3 && want.channels() != 4) ||
        want.depth() > CV_16U)
      continue;
    ASSERT_TRUE(got || file.string().find("bits.bmp") != std::string::npos) << got.error().message;
    if (!got) continue;
    if (want.channels() > 1)
      cv::cvtColor(want, want, want.channels() == 4 ? cv::COLOR_BGRA2GRAY : cv::COLOR_BGR2GRAY);
    want.convertTo(want, CV_32F, want.depth() == CV_16U ? 1.0 / 257.0 : 1.0);
    ASSERT_EQ(got->width, want.cols) << file;
    ASSERT_EQ(got->height, want.rows) << file;
    double worst = 0;
    for (int y = 0; y < want.rows; ++y) {
      for (int x = 0; x < want.cols; ++x)
        worst =
            std::max(worst, std::abs(static_cast<double>(got->at(x, y)) - want.at<float>(y, x)));
    }
    EXPECT_EQ(worst, 0) << file;
    ++compared;
  }
  EXPECT_GT(compared, 25);
}

// Small files that declare huge sizes are refused before anything is allocated or decoded.
TEST_F(Readers, HugeDeclaredSizesAreRefused) {
  const fs::path corpus = fs::path(TROCAR_CORPUS) / "image";
  const auto patched = [&](const char* seed, std::size_t at, const std::string& bytes,
                           const char* name) {
    auto whole = *read_file(corpus / seed);
    std::copy(bytes.begin(), bytes.end(), whole.begin() + static_cast<std::ptrdiff_t>(at));
    return write(name, {whole.begin(), whole.end()});
  };
  OpenOptions options = with_spacing({1, 1, 1});
  expect_error(open_stack({patched("colour.bmp", 18,
                                   std::string("\xff\xff\x00\x00\xff\xff\x00\x00", 8), "huge.bmp")},
                          options),
               ExitCode::kRefused, "65535 x 65535");
  std::string jpeg;
  const auto seed = *read_file(corpus / "grey.jpg");
  jpeg.assign(seed.begin(), seed.end());
  const std::size_t frame = jpeg.find("\xff\xc0");
  ASSERT_NE(frame, std::string::npos);
  jpeg.replace(frame + 5, 4, std::string("\xff\x00\xff\x00", 4));
  expect_error(open_stack({write("huge.jpg", jpeg)}, options), ExitCode::kRefused, "65280 x 65280");
  // NIfTI: more voxels than the file, or than gzip could hold in it.
  const fs::path nifti = fs::path(TROCAR_CORPUS) / "nifti";
  auto volume = *read_file(nifti / "one_i2.nii");
  volume[42] = volume[44] = volume[46] = 0;
  volume[43] = volume[45] = volume[47] = 0x10;  // 4096 voxels a side
  expect_error(open_stack({write("huge.nii", {volume.begin(), volume.end()})}, options),
               ExitCode::kRefused, "truncated");
}

TEST_F(Readers, VolumesAreSlicedAlongTheChosenAxis) {
  const sample::Scan scan = make_scan();  // 32 x 24 x 4, axes along LPS
  for (const SliceAxis axis : {SliceAxis::kCoronal, SliceAxis::kSagittal}) {
    const OpenOptions options = along(axis);
    const auto stack = test::take(open_stack({folder_ / "scan" / "sample.nii.gz"}, options));
    const bool coronal = axis == SliceAxis::kCoronal;
    ASSERT_EQ(stack->size(), coronal ? 24 : 32);
    ASSERT_EQ(stack->width(), coronal ? 32 : 24);
    ASSERT_EQ(stack->height(), 4);
    for (int k = 0; k < stack->size(); ++k) {
      const auto image = test::take(stack->read(k));
      const SlicePlane& plane = stack->plane(k);
      EXPECT_NEAR(plane.T_lps_plane.linear().determinant(), 1, 1e-9);
      for (int v = 0; v < 4; ++v) {
        for (int u = 0; u < image.width; ++u) {
          // The position determines the voxel, and so the value.
          const Eigen::Vector3d at = plane.T_lps_plane * Eigen::Vector3d(u * plane.spacing_u_mm,
                                                                         v * plane.spacing_v_mm, 0);
          const int x = coronal ? u : 31 - k, y = coronal ? k : u, z = 3 - v;
          const sample::Vec3 want = sample::pixel_centre_mm(scan.geometry, x, y, z);
          ASSERT_NEAR((at - Eigen::Vector3d(want.x, want.y, want.z)).norm(), 0, 1e-4);
          ASSERT_EQ(image.at(u, v), scan.slice(z)[y * 32 + x]);
        }
      }
    }
  }
}

TEST_F(Readers, DicomVolumesAreSlicedAsTheEqualNifti) {
  for (const SliceAxis axis : {SliceAxis::kAxial, SliceAxis::kCoronal, SliceAxis::kSagittal}) {
    const OpenOptions options = along(axis);
    const auto dicom = open_stack({folder_ / "scan" / "dicom"}, options);
    const auto nifti = open_stack({folder_ / "scan" / "sample.nii.gz"}, options);
    ASSERT_TRUE(dicom) << dicom.error().message;
    ASSERT_TRUE(nifti) << nifti.error().message;
    ASSERT_EQ((*dicom)->size(), (*nifti)->size());
    EXPECT_EQ((*dicom)->files.size(), 4U);
    for (int k = 0; k < (*dicom)->size(); ++k) {
      EXPECT_EQ((*dicom)->read(k)->values, (*nifti)->read(k)->values) << k;
      const Eigen::Matrix4d difference =
          (*dicom)->plane(k).T_lps_plane.matrix() - (*nifti)->plane(k).T_lps_plane.matrix();
      EXPECT_LT(difference.cwiseAbs().maxCoeff(), 1e-4) << k;  // an sform is in floats
    }
  }
  const OpenOptions options = along(SliceAxis::kCoronal);
  expect_error(open_stack({folder_ / "scan" / "dicom" / "CT_001.dcm"}, options), ExitCode::kRefused,
               "one slice");
}

}  // namespace
}  // namespace trocar::pipeline
