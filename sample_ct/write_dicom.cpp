// SPDX-License-Identifier: Apache-2.0
// Modules and attributes: DICOM PS3.3, A.3 (CT image IOD) and C.8.2.1 (CT image).
#include "sample_ct/write_dicom.h"

#include <fcntl.h>
#include <unistd.h>

#include <bit>
#include <cerrno>
#include <exception>

#include "formats/base/files.h"
#include "formats/base/text.h"
#include "sample_ct/random.h"

// DCMTK comes last, because its configuration header defines names of its own.
#include <dcmtk/config/osconfig.h>
#include <dcmtk/dcmdata/dctk.h>

namespace trocar::sample {
namespace {

constexpr int kIntercept_hu = -1024;

/// A decimal string (DS): at most nine decimals, no trailing zeros, 16 bytes or less
/// for |value| < 100000.
std::string decimal(double value) {
  std::string s = text_line("%.9f", value);
  s.erase(s.find_last_not_of('0') + 1);
  if (s.back() == '.') s.pop_back();
  return s == "-0" ? "0" : s;
}

/// Sets attributes and keeps the first error.
class Attributes {
 public:
  explicit Attributes(DcmDataset& dataset) : dataset_(dataset) {}
  void text(const DcmTagKey& tag, const std::string& value) {
    keep(dataset_.putAndInsertString(tag, value.c_str()));
  }
  void number(const DcmTagKey& tag, int value) {
    keep(dataset_.putAndInsertUint16(tag, static_cast<Uint16>(value)));
  }
  void pixels(const std::vector<Uint16>& values) {
    keep(dataset_.putAndInsertUint16Array(DCM_PixelData, values.data(),
                                          static_cast<unsigned long>(values.size())));
  }
  const OFCondition& outcome() const { return outcome_; }

 private:
  void keep(const OFCondition& condition) {
    if (outcome_.good()) outcome_ = condition;
  }
  DcmDataset& dataset_;
  OFCondition outcome_ = EC_Normal;
};

void describe_series(const Scan& scan, Attributes& set) {
  const ScanGeometry& g = scan.geometry;
  // Patient, study, series, frame of reference, equipment.
  set.text(DCM_PatientName, "Phantom^Lumbar");
  set.text(DCM_PatientID, "PHANTOM-" + std::to_string(scan.seed));
  set.text(DCM_PatientBirthDate, "");
  set.text(DCM_PatientSex, "O");
  set.text(DCM_StudyInstanceUID, dicom_uid(scan, "study"));
  set.text(DCM_StudyDate, "20080101");
  set.text(DCM_StudyTime, "120000");
  set.text(DCM_ReferringPhysicianName, "");
  set.text(DCM_StudyID, "1");
  set.text(DCM_AccessionNumber, "");
  set.text(DCM_StudyDescription, "Lumbar spine");
  set.text(DCM_Modality, "CT");
  set.text(DCM_SeriesInstanceUID, dicom_uid(scan, "series"));
  set.text(DCM_SeriesNumber, "1");
  set.text(DCM_SeriesDate, "20080101");
  set.text(DCM_SeriesTime, "120000");
  set.text(DCM_SeriesDescription, "Analytic lumbar vertebra phantom");
  set.text(DCM_BodyPartExamined, "LSPINE");
  set.text(DCM_PatientPosition, "HFS");
  set.text(DCM_FrameOfReferenceUID, dicom_uid(scan, "frame"));
  set.text(DCM_PositionReferenceIndicator, "");
  set.text(DCM_Manufacturer, "Trocar");
  set.text(DCM_ManufacturerModelName, "trocar-sample-ct");
  set.text(DCM_SoftwareVersions, TROCAR_VERSION);
  // CT image and pixel description.
  set.text(DCM_ImageType, "ORIGINAL\\PRIMARY\\AXIAL");
  set.text(DCM_AcquisitionNumber, "1");
  set.text(DCM_AcquisitionDate, "20080101");
  set.text(DCM_AcquisitionTime, "120000");
  set.text(DCM_ContentDate, "20080101");
  set.text(DCM_ContentTime, "120000");
  set.text(DCM_KVP, "120");
  set.text(DCM_ImageOrientationPatient, "1\\0\\0\\0\\1\\0");
  set.text(DCM_PixelSpacing, decimal(g.pixel_mm) + "\\" + decimal(g.pixel_mm));
  set.text(DCM_SliceThickness, decimal(g.slice_thickness_mm));
  set.text(DCM_SpacingBetweenSlices, decimal(g.slice_step_mm));
  set.number(DCM_SamplesPerPixel, 1);
  set.text(DCM_PhotometricInterpretation, "MONOCHROME2");
  set.number(DCM_Rows, g.rows);
  set.number(DCM_Columns, g.columns);
  set.number(DCM_BitsAllocated, 16);
  set.number(DCM_BitsStored, 12);
  set.number(DCM_HighBit, 11);
  set.number(DCM_PixelRepresentation, 0);
  set.text(DCM_RescaleIntercept, std::to_string(kIntercept_hu));
  set.text(DCM_RescaleSlope, "1");
  set.text(DCM_RescaleType, "HU");
  set.text(DCM_WindowCenter, "400");
  set.text(DCM_WindowWidth, "1800");
}

void describe_slice(const Scan& scan, int k, Attributes& set) {
  const ScanGeometry& g = scan.geometry;
  const Vec3 first = pixel_centre_mm(g, 0, 0, k);
  set.text(DCM_SOPClassUID, UID_CTImageStorage);
  set.text(DCM_SOPInstanceUID, dicom_uid(scan, "image/" + std::to_string(k)));
  set.text(DCM_InstanceNumber, std::to_string(k + 1));
  set.text(DCM_ImagePositionPatient,
           decimal(first.x) + "\\" + decimal(first.y) + "\\" + decimal(first.z));
  set.text(DCM_SliceLocation, decimal(first.z));
  const std::size_t pixels = static_cast<std::size_t>(g.rows) * g.columns;
  std::vector<Uint16> stored(pixels);
  std::transform(scan.slice(k), scan.slice(k) + pixels, stored.begin(),
                 [](std::int16_t hu) { return static_cast<Uint16>(hu - kIntercept_hu); });
  set.pixels(stored);
}

bool sync_file(const std::filesystem::path& file) {
  FileDescriptor opened(::open(file.c_str(), O_RDONLY | O_CLOEXEC));
  return opened.get() >= 0 && ::fsync(opened.get()) == 0 && opened.close();
}

}  // namespace

std::string dicom_name(int k) {
  return text_line("CT_%03d.dcm", k + 1);
}

std::string dicom_uid(const Scan& scan, const std::string& purpose) {
  const ScanGeometry& g = scan.geometry;
  std::uint64_t high = hash_at(scan.seed, g.columns, g.rows, g.slices);
  high = mix64(high ^ std::bit_cast<std::uint64_t>(scan.noise_hu));
  for (const char c : std::string(TROCAR_VERSION "/") + purpose)
    high = mix64(high ^ static_cast<unsigned char>(c));
  std::uint64_t low = mix64(high);
  // RFC 9562's custom UUID: version 8, variant 2.
  high = (high & ~0xf000ULL) | 0x8000ULL;
  low = (low & ~(3ULL << 62)) | (2ULL << 62);
  __extension__ using Uint128 = unsigned __int128;
  std::string digits;
  for (Uint128 value = (static_cast<Uint128>(high) << 64) | low; value != 0; value /= 10)
    digits.insert(digits.begin(), static_cast<char>('0' + static_cast<int>(value % 10)));
  return "2.25." + digits;
}

Result<void> write_dicom(const Scan& scan, const std::filesystem::path& folder) {
  for (int k = 0; k < scan.geometry.slices; ++k) {
    const std::filesystem::path file = folder / dicom_name(k);
    try {
      DcmFileFormat format;
      Attributes attributes(*format.getDataset());
      describe_series(scan, attributes);
      describe_slice(scan, k, attributes);
      OFCondition outcome = attributes.outcome();
      errno = 0;
      if (outcome.good()) outcome = format.saveFile(file.c_str(), EXS_LittleEndianExplicit);
      const int reason = errno;  // DCMTK's own message for a full disk is about suspended streams
      if (outcome.bad()) {
        return unwritable(file.string() + ": " +
                          (reason != 0 ? system_message(reason) : outcome.text()));
      }
    } catch (const std::exception& e) {
      return unwritable(file.string() + ": " + e.what());
    }
    if (!sync_file(file)) return unwritable(file.string() + ": could not be synced to disk");
  }
  return {};
}

std::string dicom_library_version() {
  return "DCMTK " OFFIS_DCMTK_VERSION_STRING;
}

}  // namespace trocar::sample
