// SPDX-License-Identifier: GPL-3.0-or-later
// One asset: decoded, and what decodes is proved or refused, never trusted.
#include "formats/asset.h"
#include "tests/fuzz/harness.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto asset = trocar::decode_asset({data, size}, "input.glb");
  if (!asset) {
    trocar::fuzz::expect_refusal(asset.error());
  } else if (const auto ok = trocar::verify_asset(*asset, "input.glb"); !ok) {
    trocar::fuzz::expect_refusal(ok.error());
  }
  return 0;
}
