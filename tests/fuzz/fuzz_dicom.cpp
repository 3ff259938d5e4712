// SPDX-License-Identifier: GPL-3.0-or-later
// One DICOM file, single or multi-frame.
#include "tests/fuzz/harness.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  trocar::fuzz::read_all(
      trocar::pipeline::open_dicom({trocar::fuzz::as_file(data, size, ".dcm")}, {}));
  return 0;
}
