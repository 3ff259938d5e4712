// SPDX-License-Identifier: Apache-2.0
#include "runtime/checking/tissue_assignment.h"

#include <algorithm>
#include <cmath>

#include "formats/base/text_line.h"

namespace trocar::runtime {
namespace {

constexpr std::size_t kMaxListed = 12;  // number of labels, tissues or runs of slices

std::string quoted(const std::string& name) {
  return '"' + name + '"';
}

/// Returns the first kMaxListed elements of a list, separated by ", ", followed by a text such as
/// "and 7 more".
template <typename List, typename Describe>
std::string listed(const List& list, Describe&& describe) {
  std::string text;
  std::size_t count = 0;
  for (const auto& each : list) {
    if (++count > kMaxListed) break;
    if (!text.empty()) text += ", ";
    text += describe(each);
  }
  if (list.size() > kMaxListed)
    text += " and " + std::to_string(list.size() - kMaxListed) + " more";
  return text;
}

std::string describe_labels(const std::vector<int>& labels) {
  return (labels.size() == 1 ? "label " : "labels ") +
         listed(labels, [](int label) { return std::to_string(label); });
}

/// Returns true if a slice can get this tissue by its labels or HU, without naming it.
bool is_chosen_by_slice(const NamedTissue& tissue) {
  return tissue.hu || !tissue.labels.empty();
}

std::string describe_condition(const NamedTissue& tissue) {
  return quoted(tissue.name) + ' ' +
         (tissue.hu ? text_line("%.6g to %.6g HU", (*tissue.hu)[0], (*tissue.hu)[1])
                    : describe_labels(tissue.labels));
}

/// Describes slices that no tissue fits, by labels and range of mean HU.
std::string describe_slices(const std::vector<const SliceTissue*>& slices) {
  double lowest = INFINITY, highest = -INFINITY;
  for (const SliceTissue* each : slices) {
    if (!each->choice.mean_hu) continue;
    lowest = std::min(lowest, *each->choice.mean_hu);
    highest = std::max(highest, *each->choice.mean_hu);
  }
  const std::vector<int>& labels = slices.front()->choice.asset_labels;
  std::string text = labels.empty() ? "" : describe_labels(labels) + ", ";
  if (!(lowest <= highest)) return text + "no mean HU in the asset";
  text += text_line("mean HU %.0f", lowest);
  return std::round(lowest) == std::round(highest) ? text : text + text_line(" to %.0f", highest);
}

}  // namespace

std::string name_slices(std::vector<int> slices) {
  std::sort(slices.begin(), slices.end());
  slices.erase(std::unique(slices.begin(), slices.end()), slices.end());
  std::vector<std::string> runs;
  for (std::size_t i = 0; i < slices.size();) {
    std::size_t end = i + 1;
    while (end < slices.size() && slices[end] == slices[end - 1] + 1)
      ++end;
    std::string run = std::to_string(slices[i]);
    if (end - i > 1) run += '-' + std::to_string(slices[end - 1]);
    runs.push_back(std::move(run));
    i = end;
  }
  return (slices.size() == 1 ? "slice " : "slices ") +
         listed(runs, [](const std::string& run) { return run; });
}

std::vector<SliceTissue> choose_tissues(const Scene& scene, const Asset& asset) {
  std::vector<SliceTissue> tissues;
  for (const SceneSlice& wanted : scene.slices) {
    const auto slice =
        std::find_if(asset.slices.begin(), asset.slices.end(),
                     [&](const AssetSlice& each) { return each.index == wanted.index; });
    if (slice == asset.slices.end()) continue;
    tissues.push_back({wanted.index, wanted.z_m, choose_tissue(scene, wanted, asset, *slice)});
  }
  std::sort(tissues.begin(), tissues.end(),
            [](const SliceTissue& a, const SliceTissue& b) { return a.z_m > b.z_m; });
  return tissues;
}

std::string describe_choice(const Scene& scene, const TissueChoice& choice) {
  switch (choice.reason) {
    case TissueReason::kNamed:
      return "tissue " + quoted(choice.name) + ": named by the slice";
    case TissueReason::kLabel:
      return "tissue " + quoted(choice.name) + ": the asset's " +
             describe_labels(choice.asset_labels);
    case TissueReason::kMeanHu:
      return "tissue " + quoted(choice.name) + text_line(": mean HU %.0f", *choice.mean_hu);
    case TissueReason::kDefault:
      break;
  }
  std::string whose = scene.tissue_is_given ? "the scene's \"tissue\"" : "the default tissue";
  if (std::none_of(scene.tissues.begin(), scene.tissues.end(), is_chosen_by_slice)) return whose;
  return whose + (choice.mean_hu ? text_line(": no other fits mean HU %.0f", *choice.mean_hu)
                                 : std::string(": no other fits"));
}

std::optional<std::string> warn_of_unfitting(const Scene& scene,
                                             const std::vector<SliceTissue>& tissues) {
  if (scene.tissue_is_given) return std::nullopt;
  std::vector<const NamedTissue*> conditions;
  for (const NamedTissue& tissue : scene.tissues) {
    if (is_chosen_by_slice(tissue)) conditions.push_back(&tissue);
  }
  if (conditions.empty()) return std::nullopt;
  std::vector<const SliceTissue*> unfitting;
  std::vector<int> slices;
  for (const SliceTissue& each : tissues) {
    if (each.choice.reason != TissueReason::kDefault) continue;
    unfitting.push_back(&each);
    slices.push_back(each.slice);
  }
  if (unfitting.empty()) return std::nullopt;
  return name_slices(slices) + ": none of the scene's tissues fits (" + describe_slices(unfitting) +
         "; the scene has " +
         listed(conditions, [](const NamedTissue* each) { return describe_condition(*each); }) +
         text_line("): the default of %.6g N/m and %.6g N is taken; ",
                   scene.tissue.stiffness_N_per_m, scene.tissue.threshold_N) +
         "change a tissue's labels or hu, name a tissue in the slice, or give the scene a "
         "\"tissue\"";
}

}  // namespace trocar::runtime
