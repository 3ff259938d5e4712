// SPDX-License-Identifier: Apache-2.0
// The sample scan's files, read by other code than wrote them: the libraries' readers.
#include <gtest/gtest.h>
#include <nifti2_io.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <set>

#include "formats/base/files.h"
#include "sample_ct/program.h"
#include "sample_ct/sample_folder.h"
#include "sample_ct/write_dicom.h"
#include "sample_ct/write_nifti.h"
#include "tests/support/temporary_folder.h"

// DCMTK last: its configuration header defines names of its own.
#include <dcmtk/config/osconfig.h>
#include <dcmtk/dcmdata/dctk.h>

namespace trocar::sample {
namespace {

namespace fs = std::filesystem;

/// A scan with different numbers of rows and columns, and HU at both ends of the range.
Scan small_scan(std::uint64_t seed) {
  ScanGeometry geometry = *sample_geometry(96, 5);
  geometry.columns = 80;
  geometry.first_pixel_mm.z = -13.5;
  PhantomOptions phantom;
  phantom.seed = seed;
  Scan scan = render_scan(phantom, geometry, 12);
  scan.hu[0] = kMinHu;
  scan.hu[1] = kMaxHu;
  return scan;
}

std::vector<std::uint8_t> bytes_of(const fs::path& file) {
  const Result<std::vector<std::uint8_t>> bytes = read_file(file);
  EXPECT_TRUE(bytes) << (bytes ? "" : bytes.error().message);
  return bytes ? *bytes : std::vector<std::uint8_t>{};
}

/// Every file below the folder with its bytes.
std::map<std::string, std::vector<std::uint8_t>> contents(const fs::path& folder) {
  std::map<std::string, std::vector<std::uint8_t>> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    if (entry.is_regular_file())
      files[entry.path().lexically_relative(folder).string()] = bytes_of(entry.path());
  return files;
}

class Writers : public testing::Test {
 protected:
  test::TemporaryFolder temporary_;
  fs::path folder_ = temporary_.path();
};

TEST_F(Writers, PngIsTheWindowedScanInThreeEqualChannels) {
  const Scan scan = small_scan(3);
  const GreyWindow window;
  const Result<void> written = write_png(scan, window, folder_);
  ASSERT_TRUE(written) << written.error().message;
  for (int k = 0; k < 5; ++k) {
    const cv::Mat image = cv::imread((folder_ / png_name(k)).string(), cv::IMREAD_UNCHANGED);
    ASSERT_EQ(image.type(), CV_8UC3);
    ASSERT_EQ(image.rows, 96);
    ASSERT_EQ(image.cols, 80);
    for (int j = 0; j < 96; ++j)
      for (int i = 0; i < 80; ++i) {
        const double hu = scan.slice(k)[j * 80 + i];
        const int grey = static_cast<int>(std::lround(std::clamp((hu + 250) / 5.0, 0.0, 255.0)));
        ASSERT_EQ(image.at<cv::Vec3b>(j, i), cv::Vec3b::all(static_cast<uchar>(grey)))
            << k << " " << j << " " << i;
      }
  }
  EXPECT_EQ(png_name(0), "slice_001.png");
  EXPECT_FALSE(write_png(scan, {.low_hu = 10, .high_hu = 10}, folder_));
}

TEST_F(Writers, DicomHoldsTheScanWithItsGeometry) {
  const Scan scan = small_scan(4);
  const Result<void> written = write_dicom(scan, folder_);
  ASSERT_TRUE(written) << written.error().message;
  std::set<std::string> instances, series, frames;
  for (int k = 0; k < 5; ++k) {
    const fs::path file = folder_ / dicom_name(k);
    DcmFileFormat format;
    ASSERT_TRUE(format.loadFile(OFFilename(file.c_str())).good());
    DcmDataset& data = *format.getDataset();
    const auto text = [&](const DcmTagKey& tag) {
      OFString value;
      EXPECT_TRUE(data.findAndGetOFStringArray(tag, value).good()) << tag.toString().c_str();
      return std::string(value.data(), value.size());
    };
    const auto number = [&](const DcmTagKey& tag, unsigned long at) {
      Float64 value = NAN;
      EXPECT_TRUE(data.findAndGetFloat64(tag, value, at).good()) << tag.toString().c_str();
      return value;
    };
    EXPECT_EQ(data.getOriginalXfer(), EXS_LittleEndianExplicit);
    EXPECT_EQ(text(DCM_SOPClassUID), UID_CTImageStorage);
    EXPECT_EQ(text(DCM_Modality), "CT");
    EXPECT_EQ(text(DCM_PatientName), "Phantom^Lumbar");
    EXPECT_EQ(text(DCM_InstanceNumber), std::to_string(k + 1));
    EXPECT_EQ(text(DCM_ImageOrientationPatient), "1\\0\\0\\0\\1\\0");
    const Vec3 first = pixel_centre_mm(scan.geometry, 0, 0, k);
    EXPECT_EQ(number(DCM_ImagePositionPatient, 0), first.x);
    EXPECT_EQ(number(DCM_ImagePositionPatient, 1), first.y);
    EXPECT_EQ(number(DCM_ImagePositionPatient, 2), first.z);
    EXPECT_EQ(number(DCM_PixelSpacing, 0), scan.geometry.pixel_mm);
    EXPECT_EQ(number(DCM_PixelSpacing, 1), scan.geometry.pixel_mm);
    EXPECT_EQ(number(DCM_SliceThickness, 0), 1.0);
    EXPECT_EQ(number(DCM_SpacingBetweenSlices, 0), 1.0);
    EXPECT_EQ(number(DCM_RescaleSlope, 0), 1.0);
    EXPECT_EQ(number(DCM_RescaleIntercept, 0), -1024.0);
    Uint16 rows = 0, columns = 0;
    EXPECT_TRUE(data.findAndGetUint16(DCM_Rows, rows).good());
    EXPECT_TRUE(data.findAndGetUint16(DCM_Columns, columns).good());
    EXPECT_EQ(rows, 96);
    EXPECT_EQ(columns, 80);
    const Uint16* pixels = nullptr;
    unsigned long count = 0;
    ASSERT_TRUE(data.findAndGetUint16Array(DCM_PixelData, pixels, &count).good());
    ASSERT_EQ(count, 96u * 80u);
    for (unsigned long p = 0; p < count; ++p)
      ASSERT_EQ(pixels[p] - 1024, scan.slice(k)[p]);

    for (const DcmTagKey& tag : {DCM_SOPInstanceUID, DCM_SeriesInstanceUID, DCM_StudyInstanceUID,
                                 DCM_FrameOfReferenceUID}) {
      const std::string uid = text(tag);
      EXPECT_LE(uid.size(), 64u);
      EXPECT_EQ(uid.rfind("2.25.", 0), 0u) << uid;
      EXPECT_EQ(uid.find_first_not_of("0123456789."), std::string::npos);
      EXPECT_NE(uid[5], '0');
    }
    instances.insert(text(DCM_SOPInstanceUID));
    series.insert(text(DCM_SeriesInstanceUID));
    frames.insert(text(DCM_FrameOfReferenceUID));
  }
  EXPECT_EQ(instances.size(), 5u);
  EXPECT_EQ(series.size(), 1u);
  EXPECT_EQ(frames.size(), 1u);
}

TEST_F(Writers, DicomUidsFollowTheScansParameters) {
  Scan scan;
  const std::string uid = dicom_uid(scan, "series");
  EXPECT_EQ(uid, dicom_uid(scan, "series"));
  EXPECT_NE(uid, dicom_uid(scan, "study"));
  Scan other = scan;
  other.seed = 2;
  EXPECT_NE(uid, dicom_uid(other, "series"));
  other = scan;
  other.noise_hu = 11;
  EXPECT_NE(uid, dicom_uid(other, "series"));
  other = scan;
  other.geometry.slices = 34;
  EXPECT_NE(uid, dicom_uid(other, "series"));
}

TEST_F(Writers, NiftiHoldsTheSameScanInTheSamePlace) {
  const Scan scan = small_scan(5);
  const fs::path file = folder_ / "sample.nii.gz";
  const Result<void> written = write_nifti(scan, file);
  ASSERT_TRUE(written) << written.error().message;
  const std::unique_ptr<nifti_image, void (*)(nifti_image*)> image(
      nifti_image_read(file.c_str(), 1), nifti_image_free);
  ASSERT_NE(image, nullptr);
  EXPECT_EQ(image->ndim, 3);
  ASSERT_EQ(image->nx, 80);
  ASSERT_EQ(image->ny, 96);
  ASSERT_EQ(image->nz, 5);
  EXPECT_EQ(image->datatype, NIFTI_TYPE_INT16);
  EXPECT_EQ(image->xyz_units, NIFTI_UNITS_MM);
  EXPECT_EQ(image->scl_slope, 1.0f);
  EXPECT_EQ(image->scl_inter, 0.0f);
  EXPECT_GT(image->sform_code, 0);
  EXPECT_GT(image->qform_code, 0);
  EXPECT_EQ(std::memcmp(image->data, scan.hu.data(), scan.hu.size() * 2), 0);
  for (const nifti_dmat44& to_ras : {image->sto_xyz, image->qto_xyz})
    for (const auto& [i, j, k] : {std::array{0, 0, 0}, {79, 0, 0}, {0, 95, 0}, {12, 34, 4}}) {
      const Vec3 lps = pixel_centre_mm(scan.geometry, i, j, k);
      const std::array<double, 3> ras{-lps.x, -lps.y, lps.z};
      for (int row = 0; row < 3; ++row) {
        const Vec3 m{to_ras.m[row][0], to_ras.m[row][1], to_ras.m[row][2]};
        EXPECT_NEAR(m.x * i + m.y * j + m.z * k + to_ras.m[row][3], ras[row], 1e-4);
      }
    }
}

TEST_F(Writers, FolderHasTheSameBytesInEveryRunAndReplacesAnEarlierOne) {
  const Scan scan = small_scan(6);
  const GreyWindow window;
  ASSERT_TRUE(write_sample_folder(scan, window, folder_ / "deep" / "a"));
  ASSERT_TRUE(write_sample_folder(scan, window, folder_ / "b"));
  const auto first = contents(folder_ / "deep" / "a");
  EXPECT_EQ(first.size(), 5u + 5u + 2u);
  EXPECT_EQ(first, contents(folder_ / "b"));
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_ / "b"), {}),
            4);  // no hidden folder is left

  ScanGeometry shorter = scan.geometry;
  shorter.slices = 2;
  Scan other{shorter, 9, 12, std::vector<std::int16_t>(std::size_t{2} * 96 * 80, 40)};
  ASSERT_TRUE(write_sample_folder(other, window, folder_ / "b"));
  const auto second = contents(folder_ / "b");
  EXPECT_EQ(second.size(), 2u + 2u + 2u);
  EXPECT_NE(second.at("sample.nii.gz"), first.at("sample.nii.gz"));
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_ / "b"), {}), 4);

  const std::vector<std::uint8_t>& text = second.at("sample.json");
  const nlohmann::json json = nlohmann::json::parse(text.begin(), text.end());
  EXPECT_EQ(json.at("seed"), 9);
  EXPECT_EQ(json.at("slices"), 2);
  EXPECT_EQ(json.at("spacing_mm").at(2), 1.0);
  EXPECT_EQ(json.at("png_window_HU").at(0), -250.0);
}

TEST_F(Writers, OnFailureOtherFilesAndEarlierRunsAreUnchanged) {
  const Scan scan = small_scan(7);
  ASSERT_TRUE(write_sample_folder(scan, {}, folder_));
  std::ofstream(folder_ / "dicom" / "notes.txt") << "mine";
  const auto before = contents(folder_);
  const Result<void> refused = write_sample_folder(small_scan(8), {}, folder_);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ExitCode::kUnwritable);
  EXPECT_NE(refused.error().message.find("notes.txt"), std::string::npos);
  EXPECT_EQ(contents(folder_), before);

  const Result<void> blocked = write_sample_folder(scan, {}, folder_ / "sample.json" / "x");
  ASSERT_FALSE(blocked);
  EXPECT_EQ(blocked.error().code, ExitCode::kUnwritable);
  EXPECT_EQ(contents(folder_), before);
}

// --- The program -----------------------------------------------------------

struct Outcome {
  int code;
  std::string out, err;
};
Outcome run(std::vector<const char*> arguments) {
  arguments.insert(arguments.begin(), "trocar-sample-ct");
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  const int code = run_sample_ct(static_cast<int>(arguments.size()), arguments.data());
  return {code, testing::internal::GetCapturedStdout(), testing::internal::GetCapturedStderr()};
}

TEST_F(Writers, ProgramWritesTheScanOfItsOptions) {
  const std::string out = (folder_ / "out").string();
  const Outcome done =
      run({out.c_str(), "--seed", "3", "--slices", "4", "--size", "64", "--noise-hu", "5"});
  EXPECT_EQ(done.code, 0) << done.err;
  EXPECT_EQ(done.err, "");
  EXPECT_NE(done.out.find("4 slices of 64 x 64"), std::string::npos) << done.out;
  PhantomOptions phantom;
  phantom.seed = 3;
  ASSERT_TRUE(write_sample_folder(render_scan(phantom, *sample_geometry(64, 4), 5), {},
                                  folder_ / "expected"));
  EXPECT_EQ(contents(folder_ / "out"), contents(folder_ / "expected"));
  const Outcome quiet = run({out.c_str(), "--slices", "1", "--size", "32", "--quiet"});
  EXPECT_EQ(quiet.code, 0);
  EXPECT_EQ(quiet.out + quiet.err, "");
}

TEST_F(Writers, ProgramHasHelpAndVersion) {  // wrong uses: tests/e2e/wrong_uses.json
  EXPECT_NE(run({"--help"}).out.find("--noise-hu"), std::string::npos);
  EXPECT_NE(run({"--version"}).out.find("DCMTK"), std::string::npos);
}

}  // namespace
}  // namespace trocar::sample
