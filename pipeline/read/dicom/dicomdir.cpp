// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/dicom/dicomdir.h"

#include <algorithm>
#include <string>

#include "pipeline/read/dicom/dicom_headers.h"
#include "pipeline/read/dicom/dicom_parse.h"

namespace trocar::pipeline {

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
