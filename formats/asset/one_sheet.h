// SPDX-License-Identifier: Apache-2.0
// An asset with one mesh per slice, whatever its materials: what a needle meets.
#pragma once

#include <string>

#include "formats/asset/asset.h"

namespace trocar {

/// Makes the materials of each slice one mesh, with the outline of all of them (weld_regions.h).
/// The HU of vertices that become one are averaged; they are left out unless every material has
/// them, and `mean_hu` is then the mean by area, if that of every material is known. Slices of one
/// material stay as they are, and so does an asset without any other. Refused, naming the file and
/// the slice: materials whose meshes are not valid (check_mesh_against_pslg()), that overlap
/// (check_shared_borders()) or lie in different planes.
/// O(n log n).
Result<void> weld_materials(Asset& asset, const std::string& name);

}  // namespace trocar
