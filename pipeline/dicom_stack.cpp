// SPDX-License-Identifier: GPL-3.0-or-later
// A folder of single-frame DICOM CT files as a stack, read with DCMTK: sorted by position along
// the slice normal, rescaled to HU slice by slice.
#include <dcmtk/config/osconfig.h>
#include <dcmtk/dcmdata/dcrledrg.h>
#include <dcmtk/dcmdata/dctk.h>
#include <dcmtk/dcmjpeg/djdecode.h>
#include <dcmtk/dcmjpls/djdecode.h>
#include <dcmtk/oflog/oflog.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>

#include "pipeline/slice_stack.h"

namespace trocar::pipeline {
namespace {

struct Header {
  std::filesystem::path file;
  std::string series_uid, sop_uid;
  Eigen::Vector3d position, u, v;
  double spacing_u_mm = 0, spacing_v_mm = 0, slope = 1, intercept = 0;
  int rows = 0, columns = 0, bits_stored = 16;
  bool is_signed = false, inverted = false, localiser = false;
};

void set_up_dcmtk() {
  static std::once_flag once;
  std::call_once(once, [] {
    OFLog::configure(OFLogger::OFF_LOG_LEVEL);
    DcmRLEDecoderRegistration::registerCodecs();
    DJDecoderRegistration::registerCodecs();
    DJLSDecoderRegistration::registerCodecs();
  });
}

std::string text(DcmItem& item, const DcmTagKey& tag) {
  OFString value;
  return item.findAndGetOFString(tag, value).good() ? std::string(value.c_str()) : std::string();
}

bool numbers(DcmItem& item, const DcmTagKey& tag, double* out, unsigned count) {
  for (unsigned i = 0; i < count; ++i) {
    if (item.findAndGetFloat64(tag, out[i], i).bad() || !std::isfinite(out[i])) return false;
  }
  return true;
}

int small_integer(DcmItem& item, const DcmTagKey& tag, int otherwise) {
  Uint16 value = 0;
  return item.findAndGetUint16(tag, value).good() ? value : otherwise;
}

// Nothing, if the file is not DICOM at all (a README beside the slices, a DICOMDIR).
Result<std::optional<Header>> read_header(const std::filesystem::path& file) {
  DcmFileFormat format;
  if (format.loadFile(file.c_str(), EXS_Unknown, EGL_noChange, 4096, ERM_autoDetect).bad()) {
    return std::optional<Header>();
  }
  DcmDataset& data = *format.getDataset();
  if (!data.tagExists(DCM_PixelData)) return std::optional<Header>();
  const std::string name = file.string();
  Header h;
  h.file = file;
  h.series_uid = text(data, DCM_SeriesInstanceUID);
  h.sop_uid = text(data, DCM_SOPInstanceUID);
  OFString image_type;
  data.findAndGetOFStringArray(DCM_ImageType, image_type);
  h.localiser = image_type.find("LOCALIZER") != OFString_npos;
  h.rows = small_integer(data, DCM_Rows, 0);
  h.columns = small_integer(data, DCM_Columns, 0);
  if (h.localiser) return std::optional(h);

  Sint32 frames = 1;
  if (data.findAndGetSint32(DCM_NumberOfFrames, frames).good() && frames != 1) {
    return refused(name + ": a multi-frame object of " + std::to_string(frames) +
                   " frames; single-frame files are read");
  }
  if (small_integer(data, DCM_SamplesPerPixel, 1) != 1) return refused(name + ": colour, not CT");
  const std::string photometric = text(data, DCM_PhotometricInterpretation);
  if (photometric != "MONOCHROME1" && photometric != "MONOCHROME2") {
    return refused(name + ": photometric interpretation '" + photometric + "'");
  }
  h.inverted = photometric == "MONOCHROME1";
  const int allocated = small_integer(data, DCM_BitsAllocated, 0);
  h.bits_stored = small_integer(data, DCM_BitsStored, allocated);
  h.is_signed = small_integer(data, DCM_PixelRepresentation, 0) == 1;
  if ((allocated != 8 && allocated != 16) || h.bits_stored < 1 || h.bits_stored > allocated) {
    return refused(name + ": " + std::to_string(h.bits_stored) + " bits in " +
                   std::to_string(allocated));
  }
  if (h.rows < 2 || h.columns < 2 || h.rows > kMaxImageSide || h.columns > kMaxImageSide) {
    return refused(name + ": " + std::to_string(h.columns) + " x " + std::to_string(h.rows) +
                   " pixels");
  }
  double position[3], orientation[6], spacing[2];
  if (!numbers(data, DCM_ImagePositionPatient, position, 3))
    return refused(name + ": no image position");
  if (!numbers(data, DCM_ImageOrientationPatient, orientation, 6))
    return refused(name + ": no image orientation");
  if (!numbers(data, DCM_PixelSpacing, spacing, 2) || !(spacing[0] > 1e-6) ||
      !(spacing[1] > 1e-6)) {
    return refused(name + ": no pixel spacing");
  }
  h.position = Eigen::Vector3d(position[0], position[1], position[2]);
  h.u = Eigen::Vector3d(orientation[0], orientation[1], orientation[2]);
  h.v = Eigen::Vector3d(orientation[3], orientation[4], orientation[5]);
  if (std::abs(h.u.norm() - 1) > 1e-3 || std::abs(h.v.norm() - 1) > 1e-3 ||
      std::abs(h.u.dot(h.v)) > 1e-3) {
    return refused(name + ": its orientation is not two unit vectors at right angles");
  }
  h.u.normalize();
  h.v = (h.v - h.u * h.u.dot(h.v)).normalized();
  h.spacing_v_mm = spacing[0];  // between rows
  h.spacing_u_mm = spacing[1];  // between columns
  if (!numbers(data, DCM_RescaleSlope, &h.slope, 1)) h.slope = 1;
  if (!numbers(data, DCM_RescaleIntercept, &h.intercept, 1)) h.intercept = 0;
  if (h.slope == 0) return refused(name + ": a rescale slope of zero");
  return std::optional(h);
}

class DicomStack final : public SliceStack {
 public:
  int size() const override { return static_cast<int>(headers_.size()); }
  int width() const override { return headers_[0].columns; }
  int height() const override { return headers_[0].rows; }
  Calibration calibration() const override { return Calibration::kHounsfield; }
  const SlicePlane& plane(int slice) const override { return planes_[slice]; }
  std::string name(int slice) const override { return headers_[slice].file.string(); }

  Result<Image> read(int slice) const override {
    const Header& h = headers_[slice];
    DcmFileFormat format;
    if (format.loadFile(h.file.c_str()).bad()) return refused(name(slice) + ": cannot be read");
    DcmDataset& data = *format.getDataset();
    if (data.chooseRepresentation(EXS_LittleEndianExplicit, nullptr).bad()) {
      return refused(name(slice) + ": transfer syntax " +
                     DcmXfer(data.getOriginalXfer()).getXferName() + " is not decoded");
    }
    Image out{h.columns, h.rows, {}};
    const std::size_t count = static_cast<std::size_t>(h.columns) * h.rows;
    out.values.resize(count);
    const int mask = (1 << h.bits_stored) - 1, sign = 1 << (h.bits_stored - 1);
    const auto convert = [&](const auto* stored) {
      for (std::size_t i = 0; i < count; ++i) {
        int value = stored[i] & mask;
        if (h.is_signed && (value & sign)) value -= mask + 1;
        if (h.inverted) value = (h.is_signed ? -1 : mask) - value;
        out.values[i] = static_cast<float>(value * h.slope + h.intercept);
      }
    };
    unsigned long available = 0;
    const Uint16* words = nullptr;
    const Uint8* bytes = nullptr;
    if (data.findAndGetUint16Array(DCM_PixelData, words, &available).good() && words != nullptr &&
        available >= count) {
      convert(words);
    } else if (data.findAndGetUint8Array(DCM_PixelData, bytes, &available).good() &&
               bytes != nullptr && available >= count && h.bits_stored <= 8) {
      convert(bytes);
    } else {
      return refused(name(slice) + ": fewer pixels than " + std::to_string(h.columns) + " x " +
                     std::to_string(h.rows));
    }
    return out;
  }

  std::vector<Header> headers_;
  std::vector<SlicePlane> planes_;
};

// One series: the asked one, or the largest, naming the others.
Result<std::vector<Header>> choose_series(std::map<std::string, std::vector<Header>> series,
                                          const std::string& wanted, const std::string& where,
                                          std::vector<Warning>& warnings) {
  if (series.empty()) return refused(where + ": no DICOM images in it");
  auto chosen = series.begin();
  if (!wanted.empty()) {
    chosen = series.find(wanted);
    if (chosen == series.end()) {
      std::string have;
      for (const auto& [uid, files] : series)
        have += " " + uid + " (" + std::to_string(files.size()) + ")";
      return usage("no series " + wanted + "; there are:" + have);
    }
  } else {
    for (auto it = series.begin(); it != series.end(); ++it) {
      if (it->second.size() > chosen->second.size()) chosen = it;
    }
    for (auto it = series.begin(); it != series.end(); ++it) {
      if (it == chosen) continue;
      warnings.push_back({"other_series", it->second[0].file.string(),
                          "series '" + it->first + "' of " + std::to_string(it->second.size()) +
                              " files was left out; choose it with --series"});
    }
  }
  return std::move(chosen->second);
}

// Same grid and orientation, sorted along the normal, no two in one place.
Result<void> sort_and_check(std::vector<Header>& headers, std::vector<Warning>& warnings) {
  const Header first = headers[0];
  const Eigen::Vector3d normal = first.u.cross(first.v);
  for (const Header& h : headers) {
    const std::string other = " differs from " + first.file.string();
    if (h.rows != first.rows || h.columns != first.columns)
      return refused(h.file.string() + ": its size" + other);
    if ((h.u - first.u).norm() > 1e-3 || (h.v - first.v).norm() > 1e-3)
      return refused(h.file.string() + ": its orientation" + other);
    if (std::abs(h.spacing_u_mm - first.spacing_u_mm) > 1e-4 ||
        std::abs(h.spacing_v_mm - first.spacing_v_mm) > 1e-4) {
      return refused(h.file.string() + ": its pixel spacing" + other);
    }
  }
  std::stable_sort(headers.begin(), headers.end(), [&normal](const Header& a, const Header& b) {
    return normal.dot(a.position) < normal.dot(b.position);
  });
  std::vector<double> gaps;
  for (std::size_t i = 1; i < headers.size(); ++i) {
    const double gap = normal.dot(headers[i].position - headers[i - 1].position);
    if (gap < 1e-3) {
      return refused(headers[i].file.string() + ": at the same position as " +
                     headers[i - 1].file.string());
    }
    gaps.push_back(gap);
  }
  if (gaps.size() > 1) {
    std::vector<double> sorted = gaps;
    std::nth_element(sorted.begin(),
                     sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2), sorted.end());
    const double median = sorted[sorted.size() / 2];
    for (std::size_t i = 0; i < gaps.size(); ++i) {
      if (std::abs(gaps[i] - median) > 0.01 * median) {
        warnings.push_back({gaps[i] > 1.5 * median ? "missing_slice" : "uneven_spacing",
                            headers[i].file.string() + ", " + headers[i + 1].file.string(),
                            "a gap of " + std::to_string(gaps[i]) + " mm among gaps of " +
                                std::to_string(median) + " mm; positions are kept as they are"});
      }
    }
  }
  return {};
}

}  // namespace

Result<std::unique_ptr<SliceStack>> open_dicom(const std::vector<std::filesystem::path>& files,
                                               const OpenOptions& options) {
  set_up_dcmtk();
  auto stack = std::make_unique<DicomStack>();
  std::map<std::string, std::vector<Header>> series;
  std::string where = files[0].parent_path().string();
  for (const std::filesystem::path& file : files) {
    auto header = read_header(file);
    if (!header) return header.error();
    if (!*header) {
      stack->warnings.push_back({"not_dicom", file.string(), "not a DICOM image; left out"});
    } else if ((*header)->localiser) {
      stack->warnings.push_back({"localiser", file.string(), "a localiser; left out"});
    } else {
      series[(*header)->series_uid].push_back(std::move(**header));
    }
  }
  auto chosen = choose_series(std::move(series), options.series_uid, where.empty() ? "." : where,
                              stack->warnings);
  if (!chosen) return chosen.error();
  stack->headers_ = std::move(*chosen);
  if (auto ok = sort_and_check(stack->headers_, stack->warnings); !ok) return ok.error();
  if (options.spacing_mm) {
    stack->warnings.push_back(
        {"spacing_ignored", where,
         "--spacing is for input without a pixel size; the files' own is used"});
  }
  for (const Header& h : stack->headers_) {
    SlicePlane plane{h.spacing_u_mm, h.spacing_v_mm, Eigen::Affine3d::Identity(), 0};
    const Eigen::Vector3d normal = h.u.cross(h.v);
    plane.T_lps_plane.linear() << h.u, h.v, normal;
    plane.T_lps_plane.translation() = h.position;
    plane.z_mm = normal.dot(h.position);
    stack->planes_.push_back(plane);
  }
  return std::unique_ptr<SliceStack>(std::move(stack));
}

}  // namespace trocar::pipeline
