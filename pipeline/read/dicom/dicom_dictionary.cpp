// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/dicom/dicom_dictionary.h"

#include <dcmtk/config/osconfig.h>
#include <dcmtk/dcmdata/dctk.h>

#include <cstdlib>
#include <memory>

namespace trocar::pipeline {
namespace {

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

}  // namespace trocar::pipeline
