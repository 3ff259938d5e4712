// SPDX-License-Identifier: Apache-2.0
// Joins the materials of each slice into one sheet, because a needle meets all materials in
// the same way.
// Tests: tests/pipeline/scan/materials_test.cpp
#pragma once

#include <string>

#include "formats/asset/asset.h"

namespace trocar {

/// Joins the materials of each slice into one mesh with the outline of their union
/// (weld_regions.h). The HU of merged vertices are averaged. If a material has no HU, the mesh has
/// none. If `mean_hu` is known for every material, the result is the mean weighted by area. Slices
/// of one material are unchanged. O(n log n). Errors: (refused) with the file and the slice: a mesh
/// is not valid (check_mesh_against_pslg()), or materials overlap (check_shared_borders()) or lie
/// in different planes.
Result<void> weld_materials(Asset& asset, const std::string& name);

/// Sets AssetSlice::hu, where it is empty, from Asset::hu, to colour the meshes. The value at a
/// vertex is the mean over the triangles around it. (Most vertices lie on the outline, where the HU
/// themselves are those of the border.) Call this before weld_materials().
void add_hu_at_vertices(Asset& asset);

}  // namespace trocar
