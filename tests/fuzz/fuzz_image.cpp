// SPDX-License-Identifier: GPL-3.0-or-later
// One image file of any kind, as levels and as labels.
#include "pipeline/read/image_stack.h"
#include "tests/fuzz/harness.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  trocar::pipeline::OpenOptions options;
  options.spacing_mm = {1, 1, 1};
  const auto file = trocar::fuzz::as_file(data, size, ".png");
  for (const bool labels : {false, true}) {
    options.as_labels = labels;
    trocar::fuzz::read_all(trocar::pipeline::open_images({file}, options));
  }
  return 0;
}
