// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/dicom/dicom_headers.h"

#include <algorithm>
#include <fstream>
#include <initializer_list>
#include <string_view>

#include "formats/asset/deidentification.h"
#include "pipeline/read/dicom/dicom_lossy.h"
#include "pipeline/read/dicom/dicom_parse.h"
#include "pipeline/read/dicom/dicom_pixels.h"
#include "pipeline/read/number_ranges.h"

namespace trocar::pipeline {
namespace {

using Names = std::pair<std::string_view, std::string_view>;

constexpr std::string_view kStorage = "1.2.840.10008.5.1.4.1.1.";

// SOP classes below kStorage: plain, enhanced and converted.
constexpr auto kModalityOfClass = std::to_array<Names>(
    {{"2", "CT"},      {"2.1", "CT"},        {"2.2", "CT"},      {"4", "MR"},     {"4.1", "MR"},
     {"4.3", "MR"},    {"4.4", "MR"},        {"128", "PT"},      {"128.1", "PT"}, {"130", "PT"},
     {"20", "NM"},     {"66.4", "SEG"},      {"6.1", "US"},      {"3.1", "US"},   {"6.2", "US"},
     {"1", "CR"},      {"1.1", "DX"},        {"1.2", "MG"},      {"12.1", "XA"},  {"12.2", "RF"},
     {"13.1.1", "XA"}, {"481.1", "RTIMAGE"}, {"481.2", "RTDOSE"}});

constexpr auto kWords = std::to_array<Names>({{"MR", "magnetic resonance"},
                                              {"PT", "positron emission tomography"},
                                              {"NM", "nuclear medicine"},
                                              {"SEG", "segmentation"},
                                              {"US", "ultrasound"},
                                              {"CR", "radiograph"},
                                              {"DX", "radiograph"},
                                              {"MG", "mammography"},
                                              {"XA", "angiography"},
                                              {"RF", "fluoroscopy"},
                                              {"RTIMAGE", "radiotherapy image"},
                                              {"RTDOSE", "radiotherapy dose"},
                                              {"SC", "secondary capture"},
                                              {"OT", "other"}});

std::string_view look_up(std::span<const Names> table, std::string_view key) {
  const auto found =
      std::find_if(table.begin(), table.end(), [key](const Names& n) { return n.first == key; });
  return found == table.end() ? std::string_view() : found->second;
}

// A code string for messages and files. DICOM allows 16 characters, but a file may hold any bytes.
std::string code_string(std::string text) {
  constexpr std::size_t kMax = 16;
  text.erase(0, std::min(text.find_first_not_of(' '), text.size()));
  text.erase(text.find_last_not_of(' ') + 1);
  if (text.size() > kMax) text.resize(kMax);
  for (char& c : text) {
    const bool is_allowed =
        (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == ' ';
    if (!is_allowed) c = '?';
  }
  return text;
}

std::string modality_of(DcmItem& data) {
  std::string out = code_string(dicom_text(&data, DCM_Modality));
  if (!out.empty()) return out;
  const std::string sop_class = dicom_text(&data, DCM_SOPClassUID);
  if (!sop_class.starts_with(kStorage)) return {};
  return std::string(
      look_up(kModalityOfClass, std::string_view(sop_class).substr(kStorage.size())));
}

// The first value of ImageType that contains one of the words.
std::string image_type_with(DcmItem& data, std::initializer_list<std::string_view> words) {
  OFString value;
  for (unsigned long i = 0; data.findAndGetOFString(DCM_ImageType, value, i).good(); ++i) {
    const std::string_view text(value.c_str(), value.size());
    if (std::any_of(words.begin(), words.end(), [text](std::string_view word) {
          return text.find(word) != std::string_view::npos;
        }))
      return code_string(std::string(text));
  }
  return {};
}

// The unit of a CT's values after the rescale if it is not HU: optical density, electron density,
// effective atomic number and others. (The RescaleType US means unspecified.)
std::string other_rescale(DcmItem& data) {
  OFString type;
  if (data.findAndGetOFString(DCM_RescaleType, type, 0, true).bad()) return {};
  const std::string known = code_string(type.c_str());
  return known.starts_with("HU") || known == "US" ? std::string() : known;
}

using GivenSpacing = std::optional<std::array<double, 3>>;

// The items in which an attribute of a frame is searched, in this order: the frame's own functional
// group, the shared one, and the dataset itself (single-frame objects).
struct AttributeItems {
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

// An attribute of DicomFrame::volume_values. `macro` is its functional group in multi-frame files.
struct VolumeKey {
  const char* name;
  DcmTagKey macro, tag;
  enum { kOfVolume, kOfEither, kOfSlice } of = kOfEither;  // DicomVolumeKey
};
const VolumeKey kVolumeKeys[] = {
    {"TemporalPositionIdentifier", DCM_UndefinedTagKey, DCM_TemporalPositionIdentifier,
     VolumeKey::kOfVolume},
    {"TemporalPositionIndex", DCM_FrameContentSequence, DCM_TemporalPositionIndex,
     VolumeKey::kOfVolume},
    {"TemporalPositionTimeOffset", DCM_TemporalPositionSequence, DCM_TemporalPositionTimeOffset,
     VolumeKey::kOfVolume},
    {"NominalPercentageOfCardiacPhase", DCM_CardiacSynchronizationSequence,
     DCM_NominalPercentageOfCardiacPhase, VolumeKey::kOfVolume},
    {"NominalPercentageOfRespiratoryPhase", DCM_RespiratorySynchronizationSequence,
     DCM_NominalPercentageOfRespiratoryPhase, VolumeKey::kOfVolume},
    {"AcquisitionNumber", DCM_UndefinedTagKey, DCM_AcquisitionNumber},
    {"FrameAcquisitionNumber", DCM_FrameContentSequence, DCM_FrameAcquisitionNumber},
    {"StackID", DCM_FrameContentSequence, DCM_StackID},
    {"EchoNumbers", DCM_UndefinedTagKey, DCM_EchoNumbers},
    {"EchoTime", DCM_UndefinedTagKey, DCM_EchoTime},
    {"EffectiveEchoTime", DCM_MREchoSequence, DCM_EffectiveEchoTime},
    {"DiffusionBValue", DCM_MRDiffusionSequence, DCM_DiffusionBValue},
    {"KVP", DCM_UndefinedTagKey, DCM_KVP},
    {"ConvolutionKernel", DCM_CTReconstructionSequence, DCM_ConvolutionKernel},
    {"ImageType", DCM_UndefinedTagKey, DCM_ImageType},
    {"SliceThickness", DCM_PixelMeasuresSequence, DCM_SliceThickness},
    {"TriggerTime", DCM_UndefinedTagKey, DCM_TriggerTime, VolumeKey::kOfSlice},
    {"NominalCardiacTriggerDelayTime", DCM_CardiacSynchronizationSequence,
     DCM_NominalCardiacTriggerDelayTime, VolumeKey::kOfSlice},
    {"AcquisitionDateTime", DCM_UndefinedTagKey, DCM_AcquisitionDateTime, VolumeKey::kOfSlice},
    {"AcquisitionTime", DCM_UndefinedTagKey, DCM_AcquisitionTime, VolumeKey::kOfSlice},
    {"FrameAcquisitionDateTime", DCM_FrameContentSequence, DCM_FrameAcquisitionDateTime,
     VolumeKey::kOfSlice},
    {"ContentTime", DCM_UndefinedTagKey, DCM_ContentTime, VolumeKey::kOfSlice},
    {"SeriesTime", DCM_UndefinedTagKey, DCM_SeriesTime, VolumeKey::kOfSlice},
    {"InstanceNumber", DCM_UndefinedTagKey, DCM_InstanceNumber, VolumeKey::kOfSlice}};

// All values of an element as text.
std::string all_values(DcmItem& item, const DcmTagKey& tag) {
  OFString value;
  if (item.findAndGetOFStringArray(tag, value).bad()) return {};
  return without_control(value.c_str());
}

// Reads DicomFrame::volume_values of a file from its shared groups and its dataset.
std::vector<std::string> volume_values(const AttributeItems& at) {
  std::vector<std::string> out;
  for (const VolumeKey& key : kVolumeKeys)
    out.push_back(all_values(*at.find(key.macro, key.tag), key.tag));
  return out;
}

// Replaces values by those of the frame's own functional groups.
void add_own_values(DcmItem& groups, std::vector<std::string>& values) {
  for (std::size_t i = 0; i < values.size(); ++i) {
    DcmItem* item = nullptr;
    if (kVolumeKeys[i].macro == DCM_UndefinedTagKey ||
        groups.findAndGetSequenceItem(kVolumeKeys[i].macro, item).bad() || item == nullptr)
      continue;
    if (std::string own = all_values(*item, kVolumeKeys[i].tag); !own.empty())
      values[i] = std::move(own);
  }
}

// Reads slope and intercept. A missing slope is 1, and a missing intercept is 0. A value that is
// present must be a number: if it were replaced by 1 or 0, HU would be wrong by about a thousand.
// Returns the problem, or std::nullopt.
std::optional<std::string> read_rescale(const AttributeItems& at, DicomFrame& h) {
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
  if (!has_slope && at.dataset->tagExists(DCM_ModalityLUTSequence))
    return "a modality look-up table instead of a rescale slope";
  return {};
}

// Reads the pixel spacing. A frame that states none gets the given spacing. Returns the problem, or
// std::nullopt.
std::optional<std::string> read_spacing(const AttributeItems& at, const GivenSpacing& given,
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

// Reads plane and rescale of one frame. Returns the problem, or std::nullopt.
std::optional<std::string> read_geometry(const AttributeItems& at, const GivenSpacing& given,
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

// Reads size and sample format, which are the same for all frames of a file. With `is_binary`, one
// bit per pixel is allowed, too. Returns the problem, or std::nullopt.
std::optional<std::string> read_format(DcmItem& data, bool is_binary, DicomFrame& h) {
  h.rows = dicom_integer(&data, DCM_Rows, 0);
  h.columns = dicom_integer(&data, DCM_Columns, 0);
  if (const int samples = dicom_integer(&data, DCM_SamplesPerPixel, 1); samples != 1)
    return std::to_string(samples) + " samples a pixel: colour, not CT";
  // The two differ only in how they are displayed. HU come from the rescale.
  const std::string photometric = dicom_text(&data, DCM_PhotometricInterpretation);
  if (photometric != "MONOCHROME1" && photometric != "MONOCHROME2")
    return "photometric interpretation '" + photometric + "'";
  h.bits_allocated = dicom_integer(&data, DCM_BitsAllocated, 0);
  h.bits_stored = dicom_integer(&data, DCM_BitsStored, h.bits_allocated);
  h.high_bit = dicom_integer(&data, DCM_HighBit, h.bits_stored - 1);
  h.is_signed = dicom_integer(&data, DCM_PixelRepresentation, 0) == 1;
  const bool is_bit = is_binary && h.bits_allocated == 1;
  if (is_bit) {  // some writers say that the high bit is 1
    h.bits_stored = 1;
    h.high_bit = 0;
  }
  if ((!is_bit && h.bits_allocated != 8 && h.bits_allocated != 16) || h.bits_stored < 1 ||
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

// The reason why there is no PixelData in a file that states the size of an image.
std::string no_pixels(DcmItem& data) {
  for (const auto& [tag, name] : {std::pair(DCM_FloatPixelData, "FloatPixelData"),
                                  std::pair(DCM_DoubleFloatPixelData, "DoubleFloatPixelData")}) {
    if (data.tagExists(tag)) {
      return std::string("its pixels are floating-point numbers (") + name +
             "), which are not read; 8- and 16-bit integers are (PixelData)";
    }
  }
  return "no pixels (PixelData); the file may be cut off";
}

// The UID of a transfer syntax that DCMTK does not know; otherwise empty.
std::string unknown_syntax(DcmFileFormat& format) {
  const std::string uid = dicom_text(format.getMetaInfo(), DCM_TransferSyntaxUID);
  return uid.empty() || DcmXfer(uid.c_str()).getXfer() != EXS_Unknown ? std::string() : uid;
}

// Uncompressed pixels must be complete. (Truncated compressed pixels are found on decoding.)
std::optional<std::string> check_length(DcmFileFormat& format, const DicomFrame& h) {
  DcmPixelData* pixels = dicom_pixel_data(format);
  if (pixels == nullptr) return "its PixelData element is of another kind";
  const E_TransferSyntax syntax = format.getDataset()->getOriginalXfer();
  if (dicom_encapsulated(syntax)) {
    if (h.bits_allocated == 1) return "compressed pixels of one bit, which are not read";
    return {};
  }
  // Frames with one bit per pixel follow each other without padding.
  const double bits = static_cast<double>(h.rows) * h.columns * h.bits_allocated * h.frames;
  const double want = std::ceil(bits / 8);
  const double have = pixels->getLength(syntax);
  if (const std::string uid = unknown_syntax(format); have < want && !uid.empty())
    return "no decoder for its transfer syntax (" + uid.substr(0, 64) + ")";
  if (have < want) {
    return "truncated: " + std::to_string(static_cast<long>(have)) +
           " bytes of pixels, its header declares " + std::to_string(static_cast<long>(want));
  }
  // Some faulty programs pad each frame. Then only the first frame would be at the position where
  // it is read.
  if (h.bits_allocated == 1 && have > want + 1) {
    return std::to_string(static_cast<long>(have)) + " bytes of pixels, more than the " +
           std::to_string(static_cast<long>(want)) +
           " of its frames; they must follow each other without padding";
  }
  return {};
}

// Reads a stored value. Its representation in the file (US or SS) may differ from that of the
// pixels. std::nullopt if there is none, or if the stored bits cannot hold it.
std::optional<int> stored_value(DcmItem& data, const DcmTagKey& tag, const DicomFrame& h) {
  Uint16 bits = 0;
  if (Sint16 number = 0; data.findAndGetUint16(tag, bits).bad()) {
    if (data.findAndGetSint16(tag, number).bad()) return {};
    bits = static_cast<Uint16>(number);
  }
  const int mask = (1 << h.bits_stored) - 1, sign = 1 << (h.bits_stored - 1);
  const int value = bits & mask, above = bits & ~mask;
  const bool is_negative = h.is_signed && (value & sign) != 0;
  // The bits above the stored ones are zero, or repeat the sign of a negative value.
  if (above != 0 && !(is_negative && above == (0xffff & ~mask))) return {};
  return is_negative ? value - mask - 1 : value;
}

void read_padding(DcmItem& data, DicomFrame& h) {
  const auto value = stored_value(data, DCM_PixelPaddingValue, h);
  if (!value) return;
  const int limit = stored_value(data, DCM_PixelPaddingRangeLimit, h).value_or(*value);
  h.padding = {std::min(*value, limit), std::max(*value, limit)};
}

SeriesInfo read_series(DcmDataset& data) {
  SeriesInfo out;
  out.uid = dicom_text(&data, DCM_SeriesInstanceUID);
  out.study_uid = dicom_text(&data, DCM_StudyInstanceUID);
  out.study_date = dicom_text(&data, DCM_StudyDate);
  if (Sint32 number = 0; data.findAndGetSint32(DCM_SeriesNumber, number).good())
    out.number = number;
  out.description = dicom_utf8(data, DCM_SeriesDescription);
  out.modality = dicom_utf8(data, DCM_Modality);
  OFString image_type;
  data.findAndGetOFStringArray(DCM_ImageType, image_type);
  out.image_type = without_control(image_type.c_str());
  AttributeItems at{nullptr, nullptr, &data};
  data.findAndGetSequenceItem(DCM_PerFrameFunctionalGroupsSequence, at.per_frame);
  data.findAndGetSequenceItem(DCM_SharedFunctionalGroupsSequence, at.shared);
  out.kernel = dicom_text(at.find(DCM_CTReconstructionSequence, DCM_ConvolutionKernel),
                          DCM_ConvolutionKernel);
  return out;
}

// The segment's label or, if it has none, the description of its type.
std::string segment_name(DcmDataset& data, DcmItem& segment) {
  std::string label = dicom_utf8(data, DCM_SegmentLabel, &segment);
  if (!label.empty()) return label;
  DcmItem* type = nullptr;
  segment.findAndGetSequenceItem(DCM_SegmentedPropertyTypeCodeSequence, type);
  return type == nullptr ? "" : dicom_utf8(data, DCM_CodeMeaning, type);
}

// Reads the description of the segments of a segmentation. Returns the problem, or std::nullopt.
std::optional<std::string> read_segments(DcmDataset& data, DicomSegments& out) {
  const std::string type = dicom_text(&data, DCM_SegmentationType);
  if (type == "FRACTIONAL") {
    out.max_fraction = dicom_integer(&data, DCM_MaximumFractionalValue, 0);
    if (out.max_fraction == 0) return "a FRACTIONAL segmentation without MaximumFractionalValue";
  } else if (type != "BINARY") {
    return "its SegmentationType is '" + type.substr(0, 16) + "'; BINARY and FRACTIONAL are read";
  }
  DcmSequenceOfItems* segments = nullptr;
  data.findAndGetSequence(DCM_SegmentSequence, segments);
  if (segments == nullptr || segments->card() == 0) return "no segments (SegmentSequence)";
  for (DcmObject* object = nullptr; (object = segments->nextInContainer(object)) != nullptr;) {
    auto* segment = dynamic_cast<DcmItem*>(object);
    const int number = dicom_integer(segment, DCM_SegmentNumber, 0);
    if (segment == nullptr || number == 0)
      return "a segment without a number (SegmentNumber) from 1 on";
    if (!out.names.emplace(number, segment_name(data, *segment)).second)
      return "segment " + std::to_string(number) + " is there twice";
  }
  return {};
}

// Reads to which segment the frame belongs. Returns the problem, or std::nullopt.
std::optional<std::string> read_segment_of(const AttributeItems& at, const DicomSegments& segments,
                                           DicomFrame& h) {
  h.slope = 1;
  h.intercept = 0;
  h.segment = dicom_integer(at.find(DCM_SegmentIdentificationSequence, DCM_ReferencedSegmentNumber),
                            DCM_ReferencedSegmentNumber, 0);
  if (h.segment == 0) return "it names no segment (ReferencedSegmentNumber)";
  if (!segments.names.contains(h.segment))
    return "its segment " + std::to_string(h.segment) + " is not in the SegmentSequence";
  return {};
}

// How the frames follow each other in a file that states one position for all of them.
struct FrameOffsets {
  std::vector<double> along_mm;  // from the first frame, along the normal
  std::string placement;         // DicomFile::placement
  bool has_given_step = false;
};

// The frames follow each other in time or in another dimension without a place in space.
bool is_no_stack(DcmItem& data) {
  DcmElement* pointers = nullptr;
  if (data.findAndGetElement(DCM_FrameIncrementPointer, pointers).bad()) return false;
  DcmTagKey tag;
  for (unsigned long i = 0; pointers->getTagVal(tag, i).good(); ++i) {
    if (tag == DCM_FrameTime || tag == DCM_FrameTimeVector) return true;
    if (tag.getGroup() == DCM_SliceVector.getGroup() && tag != DCM_SliceVector) return true;
  }
  return false;
}

// Reads the offsets of the frames. Returns the problem, or std::nullopt.
std::optional<std::string> read_offsets(const AttributeItems& at, const GivenSpacing& given,
                                        int frames, FrameOffsets& out) {
  constexpr int kMaxFrames = 1 << 16;
  const std::string counted = std::to_string(frames) + " frames without functional groups";
  if (frames > kMaxFrames) return counted + "; at most " + std::to_string(kMaxFrames) + " are read";
  if (is_no_stack(*at.dataset))
    return counted + ", which do not follow each other in space (FrameIncrementPointer)";
  if (double position[3];
      !dicom_numbers(at.find(DCM_PlanePositionSequence, DCM_ImagePositionPatient),
                     DCM_ImagePositionPatient, position, 3))
    return counted + " and no image position (ImagePositionPatient)";
  const auto count = static_cast<std::size_t>(frames);
  out.along_mm.resize(count);
  out.placement = std::to_string(frames) + " frames without positions of their own are placed ";
  double step_mm = 0;
  std::string how;
  if (dicom_numbers(at.dataset, DCM_SliceLocationVector, out.along_mm.data(),
                    static_cast<unsigned>(frames))) {
    const double first = out.along_mm[0];
    for (double& along : out.along_mm)
      along -= first;
    out.placement += "at the distances of SliceLocationVector";
  } else {
    for (const DcmTagKey& tag : {DCM_SpacingBetweenSlices, DCM_SliceThickness}) {
      if (step_mm != 0) break;
      how = tag == DCM_SliceThickness ? "SliceThickness, as no distance is stated"
                                      : "SpacingBetweenSlices";
      if (!dicom_numbers(at.find(DCM_PixelMeasuresSequence, tag), tag, &step_mm, 1)) step_mm = 0;
    }
    if (step_mm == 0 && given) {
      step_mm = (*given)[2];
      how = "--spacing";
      out.has_given_step = true;
    }
    if (step_mm == 0)
      return counted + " and no distance between them (SpacingBetweenSlices): give --spacing X,Y,Z";
    for (std::size_t i = 0; i < count; ++i)
      out.along_mm[i] = static_cast<double>(i) * step_mm;
    out.placement += text_of(step_mm, 4) + " mm apart (" + how + ")";
  }
  if (!std::all_of(out.along_mm.begin(), out.along_mm.end(),
                   [](double along) { return std::abs(along) < 1e6; }))
    return "its frames are spread too far";
  out.placement +=
      ", from ImagePositionPatient on along the normal of the image; the direction is assumed: if "
      "it is the opposite one, the shape is mirrored";
  return {};
}

// Reads all frames of a file that has pixels. Returns the problem, or std::nullopt.
std::optional<std::string> read_frames(DcmFileFormat& format, const GivenSpacing& given,
                                       DicomExtent extent, DicomFile& out) {
  DcmDataset& data = *format.getDataset();
  DicomFrame common;
  common.file = out.file;
  common.sop_uid = dicom_text(&data, DCM_SOPInstanceUID);
  common.frame_of_reference = dicom_text(&data, DCM_FrameOfReferenceUID);
  const bool is_segmentation = out.kind == DicomFile::Kind::kSegmentation;
  if (is_segmentation) {
    if (auto wrong = read_segments(data, out.segments)) return wrong;
  }
  const bool is_binary = is_segmentation && out.segments.max_fraction == 0;
  if (auto wrong = read_format(data, is_binary, common)) return wrong;
  if (!is_segmentation && out.content.kind != ImageContent::Kind::kOther)
    read_padding(data, common);
  if (double tilt_deg = 0; dicom_numbers(&data, DCM_GantryDetectorTilt, &tilt_deg, 1))
    common.stated_tilt_deg = tilt_deg;
  if (is_binary && common.bits_allocated != 1)
    return "a BINARY segmentation of " + std::to_string(common.bits_allocated) + " bits a pixel";
  Sint32 frames = 1;
  if (data.tagExists(DCM_NumberOfFrames) &&
      (data.findAndGetSint32(DCM_NumberOfFrames, frames).bad() || frames < 1)) {
    return "its number of frames is not a positive number";
  }
  common.frames = frames;
  DcmSequenceOfItems* groups = nullptr;
  data.findAndGetSequence(DCM_PerFrameFunctionalGroupsSequence, groups);
  const bool has_one_position = groups == nullptr && frames != 1 && !is_segmentation;
  if (!has_one_position &&
      (groups == nullptr ? frames != 1 : groups->card() != static_cast<unsigned long>(frames))) {
    return std::to_string(frames) + " frames, but per-frame functional groups for " +
           std::to_string(groups == nullptr ? 0 : groups->card());
  }
  AttributeItems at{nullptr, nullptr, &data};
  data.findAndGetSequenceItem(DCM_SharedFunctionalGroupsSequence, at.shared);
  FrameOffsets offsets;
  if (has_one_position) {
    if (auto wrong = read_offsets(at, given, frames, offsets)) return wrong;
    out.placement = offsets.placement;
    out.has_given_step = offsets.has_given_step;
  }
  std::vector<FragmentRange> fragments;
  if (extent == DicomExtent::kWhole) {
    if (auto wrong = check_length(format, common)) return wrong;
    auto found = frame_fragments(format, frames);
    if (!found) return found.error().message;
    fragments = std::move(*found);
    out.lossy = lossy_compression(format, frames);
  }
  common.volume_values = volume_values(at);
  if (!dicom_numbers(at.find(DCM_PixelMeasuresSequence, DCM_SliceThickness), DCM_SliceThickness,
                     &common.thickness_mm, 1))
    common.thickness_mm = 0;
  if (is_segmentation &&
      !dicom_numbers(at.find(DCM_PixelMeasuresSequence, DCM_SpacingBetweenSlices),
                     DCM_SpacingBetweenSlices, &out.segments.step_mm, 1))
    out.segments.step_mm = 0;
  DcmObject* item = nullptr;
  for (int i = 0; i < frames; ++i) {
    if (groups != nullptr) {
      item = groups->nextInContainer(item);
      at.per_frame = dynamic_cast<DcmItem*>(item);
    }
    DicomFrame frame = common;
    frame.frame = i;
    if (!fragments.empty()) frame.fragments = fragments[static_cast<std::size_t>(i)];
    if (at.per_frame != nullptr) add_own_values(*at.per_frame, frame.volume_values);
    auto wrong = read_geometry(at, given, frame);
    if (!wrong && has_one_position)
      frame.position += frame.u.cross(frame.v) * offsets.along_mm[static_cast<std::size_t>(i)];
    if (!wrong && is_segmentation) wrong = read_segment_of(at, out.segments, frame);
    if (wrong) return frames == 1 ? *wrong : "frame " + std::to_string(i + 1) + ": " + *wrong;
    out.frames.push_back(std::move(frame));
  }
  return {};
}

// The kind and the name of the images of a dataset.
ImageContent image_content(DcmItem& data) {
  using Kind = ImageContent::Kind;
  ImageContent out{Kind::kUnknown, modality_of(data)};
  const auto is = [&out](Kind kind, const std::string& type) {
    return ImageContent{kind, out.name + (out.name.empty() ? "" : " ") + type};
  };
  if (const auto scout = image_type_with(data, {"LOCALIZER", "SURVIEW", "SCOUT"}); !scout.empty())
    return is(Kind::kLocaliser, scout);
  if (const auto mosaic = image_type_with(data, {"MOSAIC"}); !mosaic.empty())
    return is(Kind::kOther, mosaic);
  // Pictures of a screen state the modality of what they show.
  const std::string sop_class = dicom_text(&data, DCM_SOPClassUID);
  const bool is_capture = sop_class == std::string(kStorage) + "7" ||
                          sop_class.starts_with(std::string(kStorage) + "7.");
  if (!image_type_with(data, {"SCREEN SAVE", "SCREEN_SAVE"}).empty() ||
      (is_capture && !data.tagExists(DCM_RescaleIntercept)))
    return is(Kind::kOther, "SECONDARY CAPTURE");
  if (const std::string type = other_rescale(data); out.name == "CT" && !type.empty())
    return is(Kind::kOther, type);
  if (!out.name.empty()) out.kind = out.name == "CT" ? Kind::kCt : Kind::kOther;
  return out;
}

}  // namespace

std::string why_not_ct(const ImageContent& content) {
  constexpr const char* kAsItIs = ", or --any-modality to mesh it as it is";
  const std::string what = "its modality is " + content.name;
  if (content.kind == ImageContent::Kind::kLocaliser) {
    return "a localiser (" + content.name +
           "), a view for planning whose values are not HU; give the CT series" + kAsItIs;
  }
  if (content.name.find("MOSAIC") != std::string::npos) {
    return what + ", many slices side by side in one image, and its values are not HU; give a CT" +
           kAsItIs;
  }
  if (content.name.find("CAPTURE") != std::string::npos)
    return "a picture of a screen (" + content.name + "), not HU; give the CT series" + kAsItIs;
  if (content.name.starts_with("CT ")) {
    return "a CT whose values are not HU after the rescale (RescaleType " + content.name.substr(3) +
           "); give the series in HU" + kAsItIs;
  }
  const std::string_view words = look_up(kWords, content.name);
  const std::string named = what + (words.empty() ? "" : " (" + std::string(words) + ")");
  if (content.is_segmentation())
    return named + ", not HU; mesh its segments with --labels N, or --labels all";
  return named + ", so its values are not HU; give a CT" + kAsItIs;
}

Result<void> settle_localisers(std::vector<DicomFile>& files, const std::string& wanted,
                               bool any_modality) {
  using Kind = DicomFile::Kind;
  DicomFile* first = nullptr;
  for (DicomFile& file : files) {
    if (!wanted.empty() && file.series.uid != wanted) continue;
    if (file.kind != Kind::kLocaliser && file.kind != Kind::kNotImage) return {};
    if (file.kind == Kind::kLocaliser && first == nullptr) first = &file;
  }
  if (first == nullptr) return {};
  if (!any_modality) return refused(first->problem);
  for (DicomFile& file : files) {
    if (file.kind == Kind::kLocaliser && (wanted.empty() || file.series.uid == wanted))
      file.kind = file.frames.empty() ? Kind::kUnusable : Kind::kImages;
  }
  return {};
}

std::string other_modality(const std::vector<DicomFile>& files,
                           const std::set<std::filesystem::path>& used,
                           std::vector<Warning>& warnings) {
  const DicomFile *other = nullptr, *unknown = nullptr;
  for (const DicomFile& file : files) {
    if (used.count(file.file) == 0 || file.content.kind == ImageContent::Kind::kCt) continue;
    const bool is_unknown = file.content.kind == ImageContent::Kind::kUnknown;
    const DicomFile*& which = is_unknown ? unknown : other;
    if (which == nullptr) which = &file;
  }
  if (other != nullptr) {
    const auto sentence = [](const std::string& name) {
      return "values are not HU: these images are " + name + "; no mean HU is stored";
    };
    warnings.push_back({"not_hu", other->file.string(), sentence(other->content.name),
                        sentence(shared_modality(other->content.name))});
    return other->content.name;
  }
  if (unknown != nullptr) {
    warnings.push_back({"no_modality", unknown->file.string(),
                        "no modality is given; the values are taken as HU of a CT"});
  }
  return {};
}

std::vector<DicomVolumeKey> dicom_volume_keys() {
  std::vector<DicomVolumeKey> out;
  for (const VolumeKey& key : kVolumeKeys)
    out.push_back({key.name, key.of == VolumeKey::kOfVolume, key.of == VolumeKey::kOfSlice});
  return out;
}

std::string DicomFrame::name() const {
  return frames == 1 ? file.string() : file.string() + " frame " + std::to_string(frame + 1);
}

SlicePlane plane_of(const DicomFrame& h, const Eigen::Vector3d& position) {
  SlicePlane plane{h.spacing_u_mm, h.spacing_v_mm, Eigen::Affine3d::Identity(), 0};
  plane.T_lps_plane.linear() << h.u, h.v, h.u.cross(h.v);
  plane.T_lps_plane.translation() = position;
  plane.z_mm = h.u.cross(h.v).dot(position);
  return plane;
}

std::string without_control(std::string text) {
  for (char& c : text) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
  }
  return text;
}

bool has_dicom_preamble(const std::filesystem::path& file) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) return false;  // opening a pipe would block
  char head[132] = {};
  std::ifstream in(file, std::ios::binary);
  return in.read(head, sizeof head) && std::string_view(head + 128, 4) == "DICM";
}

bool may_be_dicom(const std::filesystem::path& file) {
  if (has_dicom_preamble(file)) return true;
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) return false;
  char tag[2] = {};
  std::ifstream in(file, std::ios::binary);
  if (!in.read(tag, sizeof tag)) return false;
  // Group 2 is file meta information. Group 8 is the identification of the image; it comes first if
  // there is no group 2.
  const char group = tag[0] != 0 ? tag[0] : tag[1], other = tag[0] != 0 ? tag[1] : tag[0];
  return other == 0 && (group == 2 || group == 8);
}

DicomFile read_dicom_headers(const std::filesystem::path& file, const GivenSpacing& spacing_mm,
                             bool any_modality, DicomExtent extent) {
  set_up_dcmtk();
  DicomFile out;
  out.file = file;
  DcmFileFormat format;
  const bool whole = extent == DicomExtent::kWhole;
  const OFCondition loaded = load_dicom(file, format, whole ? DCM_UndefinedTagKey : DCM_PixelData);
  DcmDataset& data = *format.getDataset();
  out.series = read_series(data);
  const auto unusable = [&out](const std::string& why) {
    out.kind = DicomFile::Kind::kUnusable;
    out.problem = out.file.string() + ": " + why;
    out.frames.clear();
  };
  if (loaded.bad()) {
    // Files that are not DICOM (text, for example) are skipped, but damaged DICOM files are not.
    if (!std::ifstream(file).good())
      unusable("cannot be read");
    else if (has_dicom_preamble(file) || !out.series.uid.empty())
      unusable(std::string("damaged or truncated DICOM (") + loaded.text() + ")");
    return out;
  }
  const bool has_pixels = data.tagExists(DCM_PixelData);
  if (!data.tagExists(DCM_Rows) && !has_pixels) return out;
  out.content = image_content(data);
  const bool is_localiser = out.content.kind == ImageContent::Kind::kLocaliser;
  const bool is_segmentation = out.content.is_segmentation();
  out.kind = is_localiser      ? DicomFile::Kind::kLocaliser
             : is_segmentation ? DicomFile::Kind::kSegmentation
                               : DicomFile::Kind::kImages;
  out.is_capture = dicom_integer(&data, DCM_SamplesPerPixel, 1) != 1 ||
                   (dicom_text(&data, DCM_SOPClassUID) == UID_SecondaryCaptureImageStorage &&
                    !data.tagExists(DCM_ImagePositionPatient));
  if (!any_modality && !is_segmentation &&
      (is_localiser || out.content.kind == ImageContent::Kind::kOther)) {
    unusable(why_not_ct(out.content));
  } else if (!has_pixels && (whole || data.tagExists(DCM_FloatPixelData) ||
                             data.tagExists(DCM_DoubleFloatPixelData))) {
    unusable(no_pixels(data));
  } else if (auto wrong = read_frames(format, spacing_mm, extent, out)) {
    unusable(*wrong);
  } else if (is_segmentation) {
    out.problem = file.string() + ": " + why_not_ct(out.content);
  }
  if (is_localiser) out.kind = DicomFile::Kind::kLocaliser;
  return out;
}

}  // namespace trocar::pipeline
