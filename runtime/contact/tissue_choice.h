// SPDX-License-Identifier: Apache-2.0
// Chooses the tissue of a slice from the tissues of the scene.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/session/scene.h"

namespace trocar::runtime {

enum class TissueReason : std::uint8_t {
  kNamed,    ///< the scene's slice names the tissue
  kLabel,    ///< the asset was made from one of the tissue's labels
  kMeanHu,   ///< the mean HU of the slice's material is in the tissue's range
  kDefault,  ///< none of the above: Scene::tissue
};

struct TissueChoice {
  Tissue tissue;
  TissueReason reason = TissueReason::kDefault;
  std::string name;               ///< NamedTissue::name; empty with kDefault
  std::vector<int> asset_labels;  ///< labels that the asset was made from
  std::optional<double> mean_hu;  ///< mean HU of the slice's material, if the asset has it
};

/// Returns the tissue that the scene's slice `wanted` names. If `wanted` names none, returns the
/// first of Scene::tissues that fits. A tissue fits if one of its labels is among the labels from
/// which the asset was made (parameters.labels), or if its HU range contains the mean HU of the
/// slice's material (measures.mean_hu). If no tissue fits, returns Scene::tissue.
TissueChoice choose_tissue(const Scene& scene, const SceneSlice& wanted, const Asset& asset,
                           const AssetSlice& slice);

}  // namespace trocar::runtime
