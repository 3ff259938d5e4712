// SPDX-License-Identifier: Apache-2.0
// The tissue of a slice, chosen among the scene's.
#pragma once

#include "formats/asset/asset.h"
#include "formats/session/scene.h"

namespace trocar::runtime {

/// The tissue that the scene's slice names; else the first one for a label that the asset was made
/// from (parameters.labels) or for the mean HU of the slice's material (measures.mean_hu); else
/// Scene::tissue.
Tissue tissue_of(const Scene& scene, const SceneSlice& wanted, const Asset& asset,
                 const AssetSlice& slice);

}  // namespace trocar::runtime
