// SPDX-License-Identifier: GPL-3.0-or-later
// One DICOM file, single or multi-frame, or a segmentation.
#include "pipeline/read/dicom/dicom_stack.h"
#include "tests/fuzz/harness.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  trocar::pipeline::OpenOptions options;
  options.as_labels = true;  // makes no difference but to segmentations
  trocar::fuzz::read_all(
      trocar::pipeline::open_dicom({trocar::fuzz::as_file(data, size, ".dcm")}, options));
  return 0;
}
