// SPDX-License-Identifier: GPL-3.0-or-later
// One NIfTI volume, plain or gzipped, along each axis.
#include "pipeline/read/nifti.h"
#include "tests/fuzz/harness.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const bool gz = size > 1 && data[0] == 0x1f && data[1] == 0x8b;
  trocar::pipeline::OpenOptions options;
  options.spacing_mm = {0.5, 0.25, 3};  // else a file without voxel sizes would be a usage error
  options.axis = static_cast<trocar::pipeline::SliceAxis>(size % 3);
  trocar::fuzz::read_all(trocar::pipeline::open_nifti(
      trocar::fuzz::as_file(data, size, gz ? ".nii.gz" : ".nii"), options));
  return 0;
}
