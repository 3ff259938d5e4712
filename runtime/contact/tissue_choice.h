// SPDX-License-Identifier: Apache-2.0
// Which of a scene's tissues a slice is made of.
#pragma once

#include "formats/asset/asset.h"
#include "formats/session/scene.h"

namespace trocar::runtime {

/// The one that the scene's slice names; else the first that is for a label that the asset was
/// made from (parameters.labels) or for the mean HU of the slice's material (measures.mean_hu);
/// else Scene::tissue.
Tissue tissue_of(const Scene& scene, const SceneSlice& wanted, const Asset& asset,
                 const AssetSlice& slice);

}  // namespace trocar::runtime
