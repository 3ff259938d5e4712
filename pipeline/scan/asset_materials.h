// SPDX-License-Identifier: GPL-3.0-or-later
// The materials of an asset that is made from a label map: their names and their labels.
// Tests: tests/pipeline/scan/materials_test.cpp
#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "pipeline/scan/label_names.h"
#include "pipeline/segment/segmentation.h"

namespace trocar::pipeline {

/// The materials of an asset: MeshedMaterial::first_label -> index in Asset::materials.
using MaterialIndices = std::map<int, int>;

/// The name of the label, or of a joined material the names of its labels, as far as they fit into
/// kMaxNameBytes.
std::string material_name(const LabelNames& names, const Labels& wanted, int first_label);

/// Asset::materials, in the order of `indices`.
std::vector<AssetMaterial> asset_materials(const LabelNames& names, const Labels& wanted,
                                           const MaterialIndices& indices);

/// The segmentations that select the materials of the asset one by one.
std::vector<Segmentation> material_segmentations(const Segmentation& segmentation,
                                                 const MaterialIndices& indices);

/// The subset of `labels` whose material is not in the asset.
std::set<int> labels_without_material(const std::set<int>& labels, const Labels& wanted,
                                      const MaterialIndices& indices);

}  // namespace trocar::pipeline
