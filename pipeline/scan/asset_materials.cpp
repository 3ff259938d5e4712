// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/scan/asset_materials.h"

#include <algorithm>

namespace trocar::pipeline {
namespace {

// The set of joined labels that contains the label; null if the label is not joined.
const std::set<int>* joined_with(const Labels& wanted, int label) {
  const auto found =
      std::find_if(wanted.joined.begin(), wanted.joined.end(),
                   [label](const std::set<int>& one) { return one.contains(label); });
  return found == wanted.joined.end() ? nullptr : &*found;
}

}  // namespace

std::string material_name(const LabelNames& names, const Labels& wanted, int first_label) {
  const std::set<int>* const joined = joined_with(wanted, first_label);
  if (joined == nullptr) return names.name_of(first_label);
  std::string out;
  std::size_t left = joined->size();
  for (const int label : *joined) {
    constexpr std::size_t kForMore = 16;  // space for " + 65535 more"
    const std::string name = (out.empty() ? "" : " + ") + names.name_of(label);
    if (!out.empty() && out.size() + name.size() + (left > 1 ? kForMore : 0) > kMaxNameBytes)
      return out + " + " + std::to_string(left) + " more";
    out += name;
    --left;
  }
  return out;
}

std::vector<AssetMaterial> asset_materials(const LabelNames& names, const Labels& wanted,
                                           const MaterialIndices& indices) {
  std::vector<AssetMaterial> out;
  for (const auto& [first_label, index] : indices) {
    AssetMaterial& material = out.emplace_back();
    material.name = material_name(names, wanted, first_label);
    if (joined_with(wanted, first_label) == nullptr) material.label = first_label;
  }
  return out;
}

std::vector<Segmentation> material_segmentations(const Segmentation& segmentation,
                                                 const MaterialIndices& indices) {
  const auto* const wanted = std::get_if<Labels>(&segmentation);
  if (wanted == nullptr) return {segmentation};
  std::vector<Segmentation> out;
  for (const auto& [first_label, index] : indices) {
    const std::set<int>* const joined = joined_with(*wanted, first_label);
    out.emplace_back(Labels{joined == nullptr ? std::set{first_label} : *joined});
  }
  return out;
}

std::set<int> labels_without_material(const std::set<int>& labels, const Labels& wanted,
                                      const MaterialIndices& indices) {
  std::set<int> out;
  for (const int label : labels) {
    const std::set<int>* const joined = joined_with(wanted, label);
    if (!indices.contains(joined == nullptr ? label : *joined->begin())) out.insert(label);
  }
  return out;
}

}  // namespace trocar::pipeline
