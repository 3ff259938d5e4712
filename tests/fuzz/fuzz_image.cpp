// SPDX-License-Identifier: GPL-3.0-or-later
// One image file of any kind.
#include "tests/fuzz/harness.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  trocar::pipeline::OpenOptions options;
  options.spacing_mm = {1, 1, 1};
  trocar::fuzz::read_all(
      trocar::pipeline::open_images({trocar::fuzz::as_file(data, size, ".png")}, options));
  return 0;
}
