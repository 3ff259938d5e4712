// SPDX-License-Identifier: GPL-3.0-or-later
// One asset: decoded and verified, or refused. Reading single slices gives the same as reading the
// whole asset, or a refusal.
#include <cstdlib>
#include <cstring>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"
#include "tests/fuzz/harness.h"
#include "tests/support/glb_bytes.h"

namespace {

using trocar::AssetSlice;

// Planes of HU, which may hold NaN.
bool same(const trocar::HuPlane* a, const trocar::HuPlane* b) {
  if (a == nullptr || b == nullptr) return a == b;
  return a->origin_mm == b->origin_mm && a->pitch_mm == b->pitch_mm && a->columns == b->columns &&
         a->rows == b->rows && a->hu.size() == b->hu.size() &&
         (a->hu.empty() ||
          std::memcmp(a->hu.data(), b->hu.data(), a->hu.size() * sizeof(float)) == 0);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto asset = trocar::decode_asset({data, size}, "input.glb");
  if (!asset) {
    trocar::fuzz::expect_refusal(asset.error());
    // The checksums are corrected so that the bytes reach the decoders. The seeds' slices are
    // numbered from 0.
    std::vector<std::uint8_t> sealed(data, data + size);
    trocar::write_index_checksums(sealed);
    for (const int index : {0, 1, 2}) {
      const auto part = trocar::decode_asset_part(sealed, "input.glb", {index});
      if (!part) trocar::fuzz::expect_refusal(part.error());
    }
    return 0;
  }
  if (const auto ok = trocar::verify_asset(*asset, "input.glb"); !ok)
    trocar::fuzz::expect_refusal(ok.error());
  std::size_t at = 0, slices = 0;
  while (at < asset->slices.size()) {
    const int index = asset->slices[at].index;
    const auto part = trocar::decode_asset_part({data, size}, "input.glb", {index});
    if (!part || part->asset.slices.empty()) std::abort();
    if (!same(part->asset.hu.find(index), asset->hu.find(index))) std::abort();
    for (const AssetSlice& slice : part->asset.slices) {
      if (at == asset->slices.size() || !trocar::test::same_slice(slice, asset->slices[at++]))
        std::abort();
    }
    if (at < asset->slices.size() && asset->slices[at].index == index) std::abort();
    if (slices++; slices > part->asset_slices) std::abort();
  }
  return 0;
}
