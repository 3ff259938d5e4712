// SPDX-License-Identifier: GPL-3.0-or-later
// The names and labels of the materials of an asset that is made from a label map.
#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "pipeline/scan/label_names.h"
#include "pipeline/segment/segmentation.h"

namespace trocar::pipeline {

/// The materials of an asset. Key: MeshedMaterial::first_label; value: index in Asset::materials.
using MaterialIndices = std::map<int, int>;

/// Returns the name of the material with this first label. A material of one label has that label's
/// name. A material of several labels (Labels::joined) has their names, with " + " between them. If
/// not all names fit into kMaxNameBytes, the text ends with the number of the missing ones, as in
/// "L1 + L2 + 3 more".
std::string material_name(const LabelNames& names, const Labels& wanted, int first_label);

/// Makes Asset::materials: one entry for each entry of `indices`, in the same order.
std::vector<AssetMaterial> asset_materials(const LabelNames& names, const Labels& wanted,
                                           const MaterialIndices& indices);

/// Returns one segmentation for each entry of `indices`, in the same order. Each segmentation
/// selects only the pixels of its material. If `segmentation` is not Labels, returns `segmentation`
/// alone.
std::vector<Segmentation> material_segmentations(const Segmentation& segmentation,
                                                 const MaterialIndices& indices);

/// Returns the `labels` that belong to a material that is missing from `indices`.
std::set<int> labels_without_material(const std::set<int>& labels, const Labels& wanted,
                                      const MaterialIndices& indices);

}  // namespace trocar::pipeline
