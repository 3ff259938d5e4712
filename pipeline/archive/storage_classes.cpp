// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/archive/storage_classes.h"

#include <dcmtk/config/osconfig.h>
#include <dcmtk/dcmdata/dcuid.h>

#include <algorithm>

namespace trocar::archive {

std::vector<const char*> storage_classes() {
  return {UID_CTImageStorage,
          UID_EnhancedCTImageStorage,
          UID_LegacyConvertedEnhancedCTImageStorage,
          UID_SegmentationStorage,
          UID_MRImageStorage,
          UID_EnhancedMRImageStorage,
          UID_LegacyConvertedEnhancedMRImageStorage,
          UID_XRay3DAngiographicImageStorage,
          UID_XRay3DCraniofacialImageStorage,
          UID_PositronEmissionTomographyImageStorage};
}

bool is_storage_class(std::string_view uid) {
  const auto classes = storage_classes();
  return std::find(classes.begin(), classes.end(), uid) != classes.end();
}

std::vector<const char*> transfer_syntaxes() {
  return {UID_LittleEndianExplicitTransferSyntax,
          UID_LittleEndianImplicitTransferSyntax,
          UID_BigEndianExplicitTransferSyntax,
          UID_JPEG2000LosslessOnlyTransferSyntax,
          UID_JPEGLSLosslessTransferSyntax,
          UID_JPEGProcess14SV1TransferSyntax,
          UID_JPEGProcess14TransferSyntax,
          UID_RLELosslessTransferSyntax,
          UID_DeflatedExplicitVRLittleEndianTransferSyntax,
          UID_JPEG2000TransferSyntax,
          UID_JPEGLSLossyTransferSyntax,
          UID_JPEGProcess2_4TransferSyntax,
          UID_JPEGProcess1TransferSyntax};
}

}  // namespace trocar::archive
