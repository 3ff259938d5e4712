// SPDX-License-Identifier: GPL-3.0-or-later
// What the labels of a label map are called, and the materials that they make.
#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/contour/segmentation.h"

namespace trocar::pipeline {

using LabelNames = std::map<int, std::string>;

/// Of the VerSe challenge (2019 and 2020) and segmenters that follow it: C1 to T12, L1 to L6,
/// sacrum, coccyx, T13.
const LabelNames& verse_names();

/// Of TotalSegmentator 2, task "total": 117 classes by its names.
const LabelNames& totalsegmentator_names();

/// "verse", "totalsegmentator", or a JSON file with an object {"22": "L3", ...} from labels (whole
/// numbers, not 0) to names (1 to 64 bytes of UTF-8 without control characters). Errors (refused):
/// file, key, reason.
Result<LabelNames> read_label_names(const std::string& table_or_file);

struct NamedMaterial {
  std::string name;
  Labels labels;
};

/// The wanted labels as materials in ascending order of their first label. Labels of one name are
/// one material; one without a name is called "label 42".
std::vector<NamedMaterial> named_materials(const std::set<int>& wanted, const LabelNames& names);

}  // namespace trocar::pipeline
