// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/dicom_headers.h"

#include <Eigen/Geometry>
#include <cmath>
#include <fstream>
#include <optional>

#include "formats/base/result.h"
#include "pipeline/read/dicom_parse.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {
namespace {

using GivenSpacing = std::optional<std::array<double, 3>>;

// Where an attribute of a frame may be found, in this order: the frame's own functional group, the
// shared one, the dataset itself (single-frame objects).
struct Places {
  DcmItem *per_frame, *shared, *dataset;

  DcmItem* find(const DcmTagKey& macro, const DcmTagKey& attribute) const {
    for (DcmItem* group : {per_frame, shared}) {
      DcmItem* item = nullptr;
      if (group != nullptr && group->findAndGetSequenceItem(macro, item).good() &&
          item != nullptr && item->tagExists(attribute)) {
        return item;
      }
    }
    return dataset;
  }
};

// A missing slope is 1, a missing intercept 0. One that is present must be a number: with 1 and 0
// instead, HU would be wrong by about a thousand. Returns what is wrong, or nothing.
std::optional<std::string> read_rescale(const Places& at, DicomFrame& h) {
  DcmItem* item = at.find(DCM_PixelValueTransformationSequence, DCM_RescaleSlope);
  const bool has_slope = item->tagExists(DCM_RescaleSlope);
  const bool has_intercept = item->tagExists(DCM_RescaleIntercept);
  h.has_rescale = has_slope && has_intercept;
  if (has_slope && !dicom_numbers(item, DCM_RescaleSlope, &h.slope, 1))
    return "its RescaleSlope is not a number";
  if (has_intercept && !dicom_numbers(item, DCM_RescaleIntercept, &h.intercept, 1))
    return "its RescaleIntercept is not a number";
  if (h.slope == 0) return "a rescale slope of zero";
  if (!(std::abs(h.slope) * 65536 + std::abs(h.intercept) < 1e9))
    return "its rescale is out of range";
  if (!has_slope && at.dataset->tagExists(DCM_ModalityLUTSequence)) {
    return "a modality look-up table instead of a rescale slope";
  }
  return {};
}

// Reads the pixel spacing; a frame without one gets the given spacing. Returns what is wrong, or
// nothing.
std::optional<std::string> read_spacing(const Places& at, const GivenSpacing& given,
                                        DicomFrame& h) {
  DcmItem* item = at.find(DCM_PixelMeasuresSequence, DCM_PixelSpacing);
  if (!item->tagExistsWithValue(DCM_PixelSpacing)) {
    if (!given) return "no pixel spacing (PixelSpacing): give --spacing X,Y,Z in mm";
    h.spacing_u_mm = (*given)[0];
    h.spacing_v_mm = (*given)[1];
    return {};
  }
  double spacing[2];
  if (!dicom_numbers(item, DCM_PixelSpacing, spacing, 2) || !(spacing[0] > 1e-6) ||
      !(spacing[1] > 1e-6) || !(spacing[0] < 1e6) || !(spacing[1] < 1e6))
    return "its pixel spacing (PixelSpacing) is not two lengths in mm";
  h.spacing_v_mm = spacing[0];  // between rows
  h.spacing_u_mm = spacing[1];  // between columns
  h.has_spacing = true;
  return {};
}

// Reads plane and rescale of one frame. Returns what is wrong, or nothing.
std::optional<std::string> read_geometry(const Places& at, const GivenSpacing& given,
                                         DicomFrame& h) {
  double position[3], orientation[6];
  if (!dicom_numbers(at.find(DCM_PlanePositionSequence, DCM_ImagePositionPatient),
                     DCM_ImagePositionPatient, position, 3)) {
    return "no image position (ImagePositionPatient)";
  }
  if (!dicom_numbers(at.find(DCM_PlaneOrientationSequence, DCM_ImageOrientationPatient),
                     DCM_ImageOrientationPatient, orientation, 6)) {
    return "no image orientation (ImageOrientationPatient)";
  }
  if (auto wrong = read_spacing(at, given, h)) return wrong;
  h.position = Eigen::Vector3d(position[0], position[1], position[2]);
  h.u = Eigen::Vector3d(orientation[0], orientation[1], orientation[2]);
  h.v = Eigen::Vector3d(orientation[3], orientation[4], orientation[5]);
  if (!(h.position.cwiseAbs().maxCoeff() < 1e7)) return "its image position is out of range";
  if (!(std::abs(h.u.norm() - 1) <= 1e-3) || !(std::abs(h.v.norm() - 1) <= 1e-3) ||
      !(std::abs(h.u.dot(h.v)) <= 1e-3)) {
    return "its orientation is not two unit vectors at right angles";
  }
  h.u.normalize();
  h.v = (h.v - h.u * h.u.dot(h.v)).normalized();
  return read_rescale(at, h);
}

// Reads size and sample format, the same for all frames of a file. Returns what is wrong, or
// nothing.
std::optional<std::string> read_format(DcmItem& data, DicomFrame& h) {
  h.rows = dicom_integer(&data, DCM_Rows, 0);
  h.columns = dicom_integer(&data, DCM_Columns, 0);
  if (const int samples = dicom_integer(&data, DCM_SamplesPerPixel, 1); samples != 1) {
    return std::to_string(samples) + " samples a pixel: colour, not CT";
  }
  // The two differ in how to display them only: HU come from the rescale.
  const std::string photometric = dicom_text(&data, DCM_PhotometricInterpretation);
  if (photometric != "MONOCHROME1" && photometric != "MONOCHROME2") {
    return "photometric interpretation '" + photometric + "'";
  }
  h.bits_allocated = dicom_integer(&data, DCM_BitsAllocated, 0);
  h.bits_stored = dicom_integer(&data, DCM_BitsStored, h.bits_allocated);
  h.high_bit = dicom_integer(&data, DCM_HighBit, h.bits_stored - 1);
  h.is_signed = dicom_integer(&data, DCM_PixelRepresentation, 0) == 1;
  if ((h.bits_allocated != 8 && h.bits_allocated != 16) || h.bits_stored < 1 ||
      h.high_bit < h.bits_stored - 1 || h.high_bit >= h.bits_allocated) {
    return std::to_string(h.bits_stored) + " bits up to bit " + std::to_string(h.high_bit) +
           " in " + std::to_string(h.bits_allocated) + "; 8 and 16 bits allocated are read";
  }
  if (h.rows < 2 || h.columns < 2 || h.rows > kMaxImageSide || h.columns > kMaxImageSide ||
      static_cast<long>(h.rows) * h.columns > kMaxSlicePixels) {
    return std::to_string(h.columns) + " x " + std::to_string(h.rows) + " pixels";
  }
  return {};
}

// Uncompressed pixels must be complete. (Truncated compressed pixels are found on decoding.)
std::optional<std::string> check_length(DcmFileFormat& format, const DicomFrame& h) {
  DcmPixelData* pixels = dicom_pixel_data(format);
  if (pixels == nullptr) return "its PixelData element is of another kind";
  const E_TransferSyntax syntax = format.getDataset()->getOriginalXfer();
  if (DcmXfer(syntax).isEncapsulated()) return {};
  const int bytes_each = h.bits_allocated / 8;
  const double want = static_cast<double>(h.rows) * h.columns * bytes_each * h.frames;
  const double have = pixels->getLength(syntax);
  if (have < want) {
    return "truncated: " + std::to_string(static_cast<long>(have)) +
           " bytes of pixels, its header declares " + std::to_string(static_cast<long>(want));
  }
  return {};
}

// Reads all frames of a file that has pixels. Returns what is wrong, or nothing.
std::optional<std::string> read_frames(DcmFileFormat& format, const GivenSpacing& given,
                                       DicomFile& out) {
  DcmDataset& data = *format.getDataset();
  DicomFrame common;
  common.file = out.file;
  common.sop_uid = dicom_text(&data, DCM_SOPInstanceUID);
  common.frame_of_reference = dicom_text(&data, DCM_FrameOfReferenceUID);
  if (auto wrong = read_format(data, common)) return wrong;
  Sint32 frames = 1;
  if (data.tagExists(DCM_NumberOfFrames) &&
      (data.findAndGetSint32(DCM_NumberOfFrames, frames).bad() || frames < 1)) {
    return "its number of frames is not a positive number";
  }
  common.frames = frames;
  DcmSequenceOfItems* groups = nullptr;
  data.findAndGetSequence(DCM_PerFrameFunctionalGroupsSequence, groups);
  if (groups == nullptr ? frames != 1 : groups->card() != static_cast<unsigned long>(frames)) {
    return std::to_string(frames) + " frames, but per-frame functional groups for " +
           std::to_string(groups == nullptr ? 0 : groups->card());
  }
  if (auto wrong = check_length(format, common)) return wrong;

  Places at{nullptr, nullptr, &data};
  data.findAndGetSequenceItem(DCM_SharedFunctionalGroupsSequence, at.shared);
  DcmObject* item = nullptr;
  for (int i = 0; i < frames; ++i) {
    if (groups != nullptr) {
      item = groups->nextInContainer(item);
      at.per_frame = dynamic_cast<DcmItem*>(item);
    }
    DicomFrame frame = common;
    frame.frame = i;
    if (auto wrong = read_geometry(at, given, frame))
      return frames == 1 ? *wrong : "frame " + std::to_string(i + 1) + ": " + *wrong;
    out.frames.push_back(std::move(frame));
  }
  return {};
}

}  // namespace

std::string DicomFrame::name() const {
  return frames == 1 ? file.string() : file.string() + " frame " + std::to_string(frame + 1);
}

bool has_dicom_preamble(const std::filesystem::path& file) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) return false;  // opening a pipe would block
  char head[132] = {};
  std::ifstream in(file, std::ios::binary);
  return in.read(head, sizeof head) && std::string_view(head + 128, 4) == "DICM";
}

DicomFile read_dicom_headers(const std::filesystem::path& file, const GivenSpacing& spacing_mm,
                             bool any_modality) {
  set_up_dcmtk();
  DicomFile out;
  out.file = file;
  DcmFileFormat format;
  const OFCondition loaded = load_dicom(file, format);
  DcmDataset& data = *format.getDataset();
  out.series_uid = dicom_text(&data, DCM_SeriesInstanceUID);
  const auto unusable = [&out](const std::string& why) {
    out.kind = DicomFile::Kind::kUnusable;
    out.problem = out.file.string() + ": " + why;
    out.frames.clear();
  };
  if (loaded.bad()) {
    // Other files beside the slices (text, for example) are skipped; damaged DICOM files are not.
    if (has_dicom_preamble(file) || !out.series_uid.empty()) {
      unusable(std::string("damaged or truncated DICOM (") + loaded.text() + ")");
    }
    return out;
  }
  if (!data.tagExists(DCM_PixelData)) return out;
  out.content = image_content(data);
  const bool is_localiser = out.content.kind == ImageContent::Kind::kLocaliser;
  out.kind = is_localiser ? DicomFile::Kind::kLocaliser : DicomFile::Kind::kImages;
  out.is_colour = dicom_integer(&data, DCM_SamplesPerPixel, 1) != 1;
  if (!any_modality && (is_localiser || out.content.kind == ImageContent::Kind::kOther)) {
    unusable(why_not_ct(out.content));
  } else if (auto wrong = read_frames(format, spacing_mm, out)) {
    unusable(*wrong);
  }
  if (is_localiser) out.kind = DicomFile::Kind::kLocaliser;
  return out;
}

}  // namespace trocar::pipeline
