// SPDX-License-Identifier: Apache-2.0
#include "runtime/contact/tissue_choice.h"

#include <algorithm>

namespace trocar::runtime {
namespace {

bool has_label(const TissueChoice& choice, const NamedTissue& tissue) {
  return std::any_of(tissue.labels.begin(), tissue.labels.end(), [&](int wanted) {
    return std::find(choice.asset_labels.begin(), choice.asset_labels.end(), wanted) !=
           choice.asset_labels.end();
  });
}

bool has_hu(const TissueChoice& choice, const NamedTissue& tissue) {
  return tissue.hu && choice.mean_hu && *choice.mean_hu >= (*tissue.hu)[0] &&
         *choice.mean_hu <= (*tissue.hu)[1];
}

}  // namespace

TissueChoice choose_tissue(const Scene& scene, const SceneSlice& wanted, const Asset& asset,
                           const AssetSlice& slice) {
  TissueChoice choice;
  choice.tissue = scene.tissue;
  choice.asset_labels = labels_of(asset);
  choice.mean_hu = mean_hu_of(slice);
  for (const NamedTissue& tissue : scene.tissues) {
    const bool named = wanted.tissue && tissue.name == *wanted.tissue;
    if (!named && (wanted.tissue || !(has_label(choice, tissue) || has_hu(choice, tissue)))) {
      continue;
    }
    choice.tissue = tissue.tissue;
    choice.name = tissue.name;
    choice.reason = named                       ? TissueReason::kNamed
                    : has_label(choice, tissue) ? TissueReason::kLabel
                                                : TissueReason::kMeanHu;
    break;
  }
  return choice;
}

}  // namespace trocar::runtime
