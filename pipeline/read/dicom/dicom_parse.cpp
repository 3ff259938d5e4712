// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/dicom/dicom_parse.h"

#include <dcmtk/dcmdata/dcistrmf.h>
#include <dcmtk/dcmdata/dcrledrg.h>
#include <dcmtk/dcmdata/dcspchrs.h>
#include <dcmtk/dcmjpeg/djdecode.h>
#include <dcmtk/dcmjpls/djdecode.h>
#include <dcmtk/oflog/oflog.h>
#include <algorithm>
#include <cstdlib>

namespace trocar::pipeline {
namespace {

// DCMTK parses nested sequences by recursion. The stream is our only code inside that recursion, so
// it checks the depth of the stack. Real files have about a dozen levels, which take a kilobyte
// each.
constexpr std::ptrdiff_t kMaxParserStack = 512 << 10;
// Values stay in the file, except those of a deflated file: these are held in memory and may be a
// thousand times as large as the file.
constexpr offile_off_t kMaxParsedBytes = offile_off_t{1} << 29;

class GuardedStream final : public DcmInputFileStream {
 public:
  explicit GuardedStream(const OFFilename& file)
      : DcmInputFileStream(file), base_(static_cast<char*>(__builtin_frame_address(0))) {}

  OFBool good() const override { return !is_over() && DcmInputFileStream::good(); }
  OFCondition status() const override {
    if (!is_over()) return DcmInputFileStream::status();
    return makeOFCondition(OFM_dcmdata, 0x7ff, OF_error, over_);
  }
  bool was_over() const { return over_ != nullptr; }
  OFBool eos() override { return is_over() || DcmInputFileStream::eos(); }
  offile_off_t avail() override { return is_over() ? 0 : DcmInputFileStream::avail(); }
  offile_off_t read(void* to, offile_off_t bytes) override {
    if (is_over()) return 0;
    const offile_off_t got = DcmInputFileStream::read(to, bytes);
    parsed_ += got;
    return got;
  }
  offile_off_t skip(offile_off_t bytes) override {
    return is_over() ? 0 : DcmInputFileStream::skip(bytes);
  }

 private:
  // Stays true once a limit is exceeded: the parser must not continue from a wrong position.
  bool is_over() const {
    if (std::abs(base_ - static_cast<char*>(__builtin_frame_address(0))) > kMaxParserStack)
      over_ = "sequences nested too deep";
    if (parsed_ > kMaxParsedBytes) over_ = "more than 512 MiB of values";
    return over_ != nullptr;
  }

  char* base_;
  offile_off_t parsed_ = 0;
  mutable const char* over_ = nullptr;
};

struct Known {
  DcmTagKey tag;
  DcmEVR vr;
};
const Known kKnown[] = {
    {DCM_AcquisitionDateTime, EVR_DT},
    {DCM_AcquisitionNumber, EVR_IS},
    {DCM_AcquisitionTime, EVR_TM},
    {DCM_BitsAllocated, EVR_US},
    {DCM_BitsStored, EVR_US},
    {DCM_CTReconstructionSequence, EVR_SQ},
    {DCM_CardiacSynchronizationSequence, EVR_SQ},
    {DCM_CodeMeaning, EVR_LO},
    {DCM_Columns, EVR_US},
    {DCM_ContentTime, EVR_TM},
    {DCM_ConvolutionKernel, EVR_SH},
    {DCM_DiffusionBValue, EVR_FD},
    {DCM_DirectoryRecordSequence, EVR_SQ},
    {DCM_DirectoryRecordType, EVR_CS},
    {DCM_DoubleFloatPixelData, EVR_OD},
    {DCM_EchoNumbers, EVR_IS},
    {DCM_EchoTime, EVR_DS},
    {DCM_EffectiveEchoTime, EVR_FD},
    {DCM_FloatPixelData, EVR_OF},
    {DCM_FrameAcquisitionDateTime, EVR_DT},
    {DCM_FrameAcquisitionNumber, EVR_US},
    {DCM_FrameContentSequence, EVR_SQ},
    {DCM_FrameIncrementPointer, EVR_AT},
    {DCM_FrameOfReferenceUID, EVR_UI},
    {DCM_FrameTime, EVR_DS},
    {DCM_FrameTimeVector, EVR_DS},
    {DCM_GantryDetectorTilt, EVR_DS},
    {DCM_HighBit, EVR_US},
    {DCM_ImageOrientationPatient, EVR_DS},
    {DCM_ImagePositionPatient, EVR_DS},
    {DCM_ImageType, EVR_CS},
    {DCM_InstanceNumber, EVR_IS},
    {DCM_KVP, EVR_DS},
    {DCM_LossyImageCompression, EVR_CS},
    {DCM_LossyImageCompressionMethod, EVR_CS},
    {DCM_LossyImageCompressionRatio, EVR_DS},
    {DCM_MRDiffusionSequence, EVR_SQ},
    {DCM_MREchoSequence, EVR_SQ},
    {DCM_MaximumFractionalValue, EVR_US},
    {DCM_Modality, EVR_CS},
    {DCM_ModalityLUTSequence, EVR_SQ},
    {DCM_NominalCardiacTriggerDelayTime, EVR_FD},
    {DCM_NominalPercentageOfCardiacPhase, EVR_FL},
    {DCM_NominalPercentageOfRespiratoryPhase, EVR_FL},
    {DCM_NumberOfFrames, EVR_IS},
    {DCM_PerFrameFunctionalGroupsSequence, EVR_SQ},
    {DCM_PhotometricInterpretation, EVR_CS},
    {DCM_PixelData, EVR_px},
    {DCM_PixelMeasuresSequence, EVR_SQ},
    {DCM_PixelPaddingRangeLimit, EVR_xs},
    {DCM_PixelPaddingValue, EVR_xs},
    {DCM_PixelRepresentation, EVR_US},
    {DCM_PixelSpacing, EVR_DS},
    {DCM_PixelValueTransformationSequence, EVR_SQ},
    {DCM_PlanarConfiguration, EVR_US},  // used by DCMTK's decoders
    {DCM_PlaneOrientationSequence, EVR_SQ},
    {DCM_PlanePositionSequence, EVR_SQ},
    {DCM_QueryRetrieveLevel, EVR_CS},
    {DCM_ReferencedFileID, EVR_CS},
    {DCM_ReferencedSegmentNumber, EVR_US},
    {DCM_RescaleIntercept, EVR_DS},
    {DCM_RescaleSlope, EVR_DS},
    {DCM_RescaleType, EVR_LO},
    {DCM_RespiratorySynchronizationSequence, EVR_SQ},
    {DCM_Rows, EVR_US},
    {DCM_SOPClassUID, EVR_UI},
    {DCM_SOPInstanceUID, EVR_UI},
    {DCM_SamplesPerPixel, EVR_US},
    {DCM_SegmentIdentificationSequence, EVR_SQ},
    {DCM_SegmentLabel, EVR_LO},
    {DCM_SegmentNumber, EVR_US},
    {DCM_SegmentSequence, EVR_SQ},
    {DCM_SegmentationType, EVR_CS},
    {DCM_SegmentedPropertyTypeCodeSequence, EVR_SQ},
    {DCM_SeriesDescription, EVR_LO},
    {DCM_SeriesInstanceUID, EVR_UI},
    {DCM_SeriesNumber, EVR_IS},
    {DCM_SeriesTime, EVR_TM},
    {DCM_SharedFunctionalGroupsSequence, EVR_SQ},
    {DCM_SliceLocationVector, EVR_DS},
    {DCM_SliceThickness, EVR_DS},
    {DCM_SliceVector, EVR_US},
    {DCM_SpacingBetweenSlices, EVR_DS},
    {DCM_SpecificCharacterSet, EVR_CS},
    {DCM_StackID, EVR_SH},
    {DCM_StudyDate, EVR_DA},
    {DCM_StudyInstanceUID, EVR_UI},
    {DCM_TemporalPositionIdentifier, EVR_IS},
    {DCM_TemporalPositionIndex, EVR_UL},
    {DCM_TemporalPositionSequence, EVR_SQ},
    {DCM_TemporalPositionTimeOffset, EVR_FD},
    {DCM_TransferSyntaxUID, EVR_UI},
    {DCM_TriggerTime, EVR_DS},
};

}  // namespace

void set_up_dcmtk() {
  static std::once_flag once;
  std::call_once(once, [] {
    OFLog::configure(OFLogger::OFF_LOG_LEVEL);
    add_known_dicom_elements();
    // Some systems store standard elements with an unknown representation (UN).
    dcmEnableUnknownVRConversion.set(OFTrue);
    DcmRLEDecoderRegistration::registerCodecs();
    DJDecoderRegistration::registerCodecs();
    DJLSDecoderRegistration::registerCodecs();
  });
}

// NOLINTBEGIN(clang-analyzer-unix.Malloc): of DCMTK's condition, which owns its text
OFCondition load_dicom(const std::filesystem::path& file, DcmFileFormat& format,
                       const DcmTagKey& end) {
  GuardedStream stream(OFFilename(file.c_str()));
  if (stream.status().bad()) return stream.status();
  format.transferInit();
  OFCondition done = format.readUntilTag(stream, EXS_Unknown, EGL_noChange, 4096, end);
  format.transferEnd();
  return stream.was_over() ? stream.status() : done;
}
// NOLINTEND(clang-analyzer-unix.Malloc)

std::string dicom_text(DcmItem* item, const DcmTagKey& tag) {
  OFString value;
  if (item == nullptr || item->findAndGetOFString(tag, value).bad()) return {};
  return without_control(value.c_str());
}

std::string dicom_utf8(DcmDataset& data, const DcmTagKey& tag, DcmItem* item) {
  OFString value, set, converted;
  DcmItem& holder = item != nullptr ? *item : data;
  if (holder.findAndGetOFString(tag, value).bad()) return {};
  data.findAndGetOFStringArray(DCM_SpecificCharacterSet, set);
  DcmSpecificCharacterSet charset;
  if (!set.empty() && charset.selectCharacterSet(set).good() &&
      charset.convertString(value, converted).good()) {
    value = converted;
  }
  std::string out = without_control(value.c_str());
  out.erase(0, out.find_first_not_of(' '));
  out.erase(out.find_last_not_of(' ') + 1);
  return out;
}

bool dicom_numbers(DcmItem* item, const DcmTagKey& tag, double* out, unsigned count) {
  if (item == nullptr) return false;
  for (unsigned i = 0; i < count; ++i) {
    if (item->findAndGetFloat64(tag, out[i], i).bad() || !std::isfinite(out[i])) return false;
  }
  return true;
}

int dicom_integer(DcmItem* item, const DcmTagKey& tag, int otherwise) {
  Uint16 value = 0;
  return item != nullptr && item->findAndGetUint16(tag, value).good() ? value : otherwise;
}

DcmPixelData* dicom_pixel_data(DcmFileFormat& format) {
  DcmElement* element = nullptr;
  if (format.getDataset()->findAndGetElement(DCM_PixelData, element).bad()) return nullptr;
  return dynamic_cast<DcmPixelData*>(element);
}

bool dicom_encapsulated(E_TransferSyntax syntax) {
#if PACKAGE_VERSION_NUMBER >= 369
  return DcmXfer(syntax).usesEncapsulatedFormat();
#else
  return DcmXfer(syntax).isEncapsulated();
#endif
}

DcmPixelSequence* fragments_of(DcmPixelData* pixels, E_TransferSyntax syntax) {
  DcmPixelSequence* out = nullptr;
  if (pixels == nullptr || !dicom_encapsulated(syntax) ||
      pixels->getEncapsulatedRepresentation(syntax, nullptr, out).bad())
    return nullptr;
  return out;
}

std::vector<DcmPixelItem*> fragments_in(DcmPixelSequence& sequence) {
  std::vector<DcmPixelItem*> out;
  DcmObject* item = sequence.nextInContainer(nullptr);  // the offset table
  while (item != nullptr && (item = sequence.nextInContainer(item)) != nullptr)
    out.push_back(dynamic_cast<DcmPixelItem*>(item));
  return out;
}

Uint32 dicom_frame_bytes(const DcmPixelData& pixels, DcmDataset& data, bool compressed) {
  Uint32 bytes = 0;
#if PACKAGE_VERSION_NUMBER >= 369
  const OFCondition found = pixels.getUncompressedFrameSize(&data, bytes, !compressed);
#else
  static_cast<void>(compressed);
  const OFCondition found = pixels.getUncompressedFrameSize(&data, bytes);
#endif
  return found.good() ? bytes : 0;
}

void leave_out_dicom_dictionary() {
  // There are no other threads yet. NOLINTNEXTLINE(concurrency-mt-unsafe)
  setenv("DCMDICTPATH", "/dev/null", 0);
}

void add_known_dicom_elements() {
  DcmDataDictionary& dictionary = dcmDataDict.wrlock();
  for (const Known& known : kKnown) {
    if (dictionary.findEntry(known.tag, nullptr) != nullptr) continue;
    auto entry =
        std::make_unique<DcmDictEntry>(known.tag.getGroup(), known.tag.getElement(),
                                       DcmVR(known.vr), "Known", 1, 1, nullptr, OFFalse, nullptr);
    dictionary.addEntry(entry.release());
  }
  dcmDataDict.wrunlock();
}

std::vector<std::filesystem::path> images_of_dicomdir(const std::filesystem::path& dicomdir) {
  set_up_dcmtk();
  std::vector<std::filesystem::path> out;
  DcmFileFormat format;
  DcmSequenceOfItems* records = nullptr;
  if (load_dicom(dicomdir, format).bad() ||
      format.getDataset()->findAndGetSequence(DCM_DirectoryRecordSequence, records).bad())
    return out;
  for (DcmObject* at = nullptr; (at = records->nextInContainer(at)) != nullptr;) {
    auto* const record = dynamic_cast<DcmItem*>(at);
    OFString parts;  // of the path, with backslashes between them
    if (record == nullptr || dicom_text(record, DCM_DirectoryRecordType) != "IMAGE" ||
        record->findAndGetOFStringArray(DCM_ReferencedFileID, parts).bad() || parts.empty())
      continue;
    std::string path = without_control(parts.c_str());
    std::replace(path.begin(), path.end(), '\\', '/');
    out.emplace_back(path);
  }
  return out;
}

}  // namespace trocar::pipeline
