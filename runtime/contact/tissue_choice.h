// SPDX-License-Identifier: Apache-2.0
// The tissue of a slice, chosen among the scene's.
// Tests: tests/runtime/contact/place_slices_test.cpp
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/session/scene.h"

namespace trocar::runtime {

enum class TissueReason : std::uint8_t {
  kNamed,    ///< the scene's slice names it
  kLabel,    ///< the asset was made from one of its labels
  kMeanHu,   ///< the mean HU of the slice's material is in its range
  kDefault,  ///< none of the above: Scene::tissue
};

struct TissueChoice {
  Tissue tissue;
  TissueReason reason = TissueReason::kDefault;
  std::string name;               ///< NamedTissue::name; empty with kDefault
  std::vector<int> asset_labels;  ///< labels that the asset was made from
  std::optional<double> mean_hu;  ///< mean HU of the slice's material, if the asset has it
};

/// The tissue that the scene's slice names; else the first one for a label that the asset was made
/// from (parameters.labels) or for the mean HU of the slice's material (measures.mean_hu); else
/// Scene::tissue.
TissueChoice choose_tissue(const Scene& scene, const SceneSlice& wanted, const Asset& asset,
                           const AssetSlice& slice);

/// TissueChoice::tissue.
Tissue tissue_of(const Scene& scene, const SceneSlice& wanted, const Asset& asset,
                 const AssetSlice& slice);

}  // namespace trocar::runtime
