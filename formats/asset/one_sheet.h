// SPDX-License-Identifier: Apache-2.0
// Joins the materials of each slice into one sheet. Materials are labels, for example of vertebrae,
// and a needle that crosses from one label to the next must not meet an edge there.
// Tests: tests/pipeline/scan/materials_test.cpp
#pragma once

#include <string>

#include "formats/asset/asset.h"

namespace trocar {

/// Joins the materials of each slice into one mesh with the outline of their union
/// (weld_regions.h). The HU of merged vertices are averaged. If a material has no HU at vertices,
/// the joined mesh has none. If the mean HU of every material is known, the mean HU of the joined
/// mesh is their mean weighted by area. The meshes of slices with one material are unchanged. If
/// any slice had several materials, the asset afterwards has only one material, to which all slices
/// belong. O(n log n). Errors: kRefused if a mesh is not valid (check_mesh_against_pslg()), or if
/// materials overlap (check_shared_borders()) or lie in different planes. The message has the file
/// and the slice.
Result<void> weld_materials(Asset& asset, const std::string& name);

/// Computes AssetSlice::hu, the HU at a slice's vertices, where it is empty. The values come from
/// Asset::hu, the volume of HU. Viewers can then colour the meshes. The value at a vertex is the
/// mean HU of the triangles around the vertex, weighted by area. (The HU at the vertex itself would
/// mix with those of the surroundings, because most vertices lie on the outline.) Call this
/// function before weld_materials().
void add_hu_at_vertices(Asset& asset);

}  // namespace trocar
