// SPDX-License-Identifier: Apache-2.0
// Joins the materials of each slice into one sheet. Materials are labels, for example of vertebrae,
// and a needle that crosses from one label to the next must not feel the border between them.
#pragma once

#include <string>

#include "formats/asset/asset.h"

namespace trocar {

/// Joins the materials of each slice into one mesh with the outline of their union
/// (weld_regions.h). The HU of merged vertices are averaged. If one of the materials has no HU at
/// vertices, the joined mesh has none. If the mean HU of each material is known, the joined mesh
/// gets the mean of these values, weighted by area. The mesh of a slice with one material is
/// unchanged. If any slice had several materials, the asset afterwards has one material, to which
/// all slices belong; otherwise nothing is changed. O(n log n). Errors: kRefused if a mesh is not
/// valid (check_mesh_against_pslg()), or if materials overlap (check_shared_borders()) or lie in
/// different planes. The message has the file and the slice, and the asset is unchanged.
Result<void> weld_materials(Asset& asset, const std::string& name);

/// Computes HU at the vertices, with which viewers can colour the meshes. Fills AssetSlice::hu of
/// each slice where it is empty and where Asset::hu has a plane of the slice. The HU of a triangle
/// are the mean of Asset::hu at four points inside the triangle. The value at a vertex is the mean
/// of the triangles around the vertex, weighted by area; it is 0 if none of these triangles has a
/// HU. (The HU at the vertex itself are not used: most vertices lie on the outline, where the HU
/// are partly those of the surroundings.) Call this function before weld_materials().
void add_hu_at_vertices(Asset& asset);

}  // namespace trocar
