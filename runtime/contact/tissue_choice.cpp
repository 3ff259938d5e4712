// SPDX-License-Identifier: Apache-2.0
#include "runtime/contact/tissue_choice.h"

#include <algorithm>

namespace trocar::runtime {
namespace {

bool has_label(const Asset& asset, const NamedTissue& tissue) {
  const auto labels = asset.parameters.find("labels");
  if (labels == asset.parameters.end() || !labels->is_array()) return false;
  return std::any_of(labels->begin(), labels->end(), [&](const nlohmann::json& label) {
    return std::any_of(tissue.labels.begin(), tissue.labels.end(),
                       [&](int wanted) { return label == wanted; });
  });
}

bool has_hu(const AssetSlice& slice, const NamedTissue& tissue) {
  const auto mean_hu = slice.measures.find("mean_hu");
  return tissue.hu && mean_hu != slice.measures.end() && mean_hu->is_number() &&
         *mean_hu >= (*tissue.hu)[0] && *mean_hu <= (*tissue.hu)[1];
}

}  // namespace

Tissue tissue_of(const Scene& scene, const SceneSlice& wanted, const Asset& asset,
                 const AssetSlice& slice) {
  const auto found =
      std::find_if(scene.tissues.begin(), scene.tissues.end(), [&](const NamedTissue& tissue) {
        return wanted.tissue ? tissue.name == *wanted.tissue
                             : has_label(asset, tissue) || has_hu(slice, tissue);
      });
  return found == scene.tissues.end() ? scene.tissue : found->tissue;
}

}  // namespace trocar::runtime
