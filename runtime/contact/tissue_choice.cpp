// SPDX-License-Identifier: Apache-2.0
#include "runtime/contact/tissue_choice.h"

#include <algorithm>

namespace trocar::runtime {
namespace {

bool has_label(const Asset& asset, const NamedTissue& tissue) {
  if (tissue.labels.empty()) return false;
  const std::vector<int> labels = labels_of(asset);
  return std::any_of(tissue.labels.begin(), tissue.labels.end(), [&](int wanted) {
    return std::find(labels.begin(), labels.end(), wanted) != labels.end();
  });
}

bool has_hu(const AssetSlice& slice, const NamedTissue& tissue) {
  if (!tissue.hu) return false;
  const std::optional<double> mean_hu = mean_hu_of(slice);
  return mean_hu && *mean_hu >= (*tissue.hu)[0] && *mean_hu <= (*tissue.hu)[1];
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
