// SPDX-License-Identifier: Apache-2.0
// list_slices ASSET.glb prints one line for each slice of an asset. It shows how to read an asset.
#include <cstdio>

#include "formats/asset/asset.h"

int main(int count, char** arguments) {
  if (count != 2) {
    std::fprintf(stderr, "usage: list_slices ASSET.glb\n");
    return 2;
  }
  const trocar::Result<trocar::Asset> asset = trocar::read_asset(arguments[1]);
  if (!asset) {
    std::fprintf(stderr, "list_slices: %s\n", asset.error().message.c_str());
    return static_cast<int>(asset.error().code);
  }
  // Positions are lattice integers. A step is a power of two in mm, so products with it are exact.
  const double step_mm = asset->lattice.step_mm();
  std::printf("lattice step %.9g mm\n", step_mm);
  for (const trocar::AssetSlice& slice : asset->slices)
    std::printf("slice %d: z %g mm, %zu vertices, %zu triangles\n", slice.index, slice.z_mm,
                slice.mesh.vertices.size(), slice.mesh.triangles.size());
  return 0;
}
