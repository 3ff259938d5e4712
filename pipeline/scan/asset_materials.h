// SPDX-License-Identifier: GPL-3.0-or-later
// The names and labels of the materials of an asset that is made from a label map.
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

/// The materials of an asset. Key: MeshedMaterial::first_label; value: index in Asset::materials.
using MaterialIndices = std::map<int, int>;

/// The name of the material that `first_label` identifies, which is the name of its label. For a
/// material of several joined labels, the name consists of as many of their names as fit into
/// kMaxNameBytes.
std::string material_name(const LabelNames& names, const Labels& wanted, int first_label);

/// Asset::materials, in the order of `indices`.
std::vector<AssetMaterial> asset_materials(const LabelNames& names, const Labels& wanted,
                                           const MaterialIndices& indices);

/// One segmentation for each material of the asset, which selects only this material.
std::vector<Segmentation> material_segmentations(const Segmentation& segmentation,
                                                 const MaterialIndices& indices);

/// Returns those of `labels` whose material is not in the asset.
std::set<int> labels_without_material(const std::set<int>& labels, const Labels& wanted,
                                      const MaterialIndices& indices);

}  // namespace trocar::pipeline
