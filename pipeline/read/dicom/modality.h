// SPDX-License-Identifier: GPL-3.0-or-later
// Recognises CT images, whose values are HU, among DICOM images, and names the modality of others.
// Tests: tests/pipeline/read/dicom/modality_test.py
#pragma once

#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "formats/base/result.h"

class DcmItem;

namespace trocar::pipeline {

struct DicomFile;
struct Warning;

/// The kind of a file's images:
/// 1. kLocaliser: a value of ImageType contains LOCALIZER, SURVIEW (as REF_SURVIEW does) or SCOUT.
/// 2. kOther: the modality is not CT, or a value of ImageType is MOSAIC or SCREEN SAVE, or the file
///    is a Secondary Capture without a rescale, or a CT with a RescaleType other than HU, HU_MOD
///    and US (unspecified).
/// 3. kCt: the modality is CT.
/// 4. kUnknown: there is no modality.
/// The modality comes from the attribute Modality. If this is missing or empty, it comes from the
/// SOP class if this is one that scanners write.
struct ImageContent {
  enum class Kind { kCt, kUnknown, kLocaliser, kOther };
  Kind kind = Kind::kUnknown;
  /// The modality, then the value of ImageType that decided: "CT", "MR MOSAIC", "CT LOCALIZER".
  /// Empty if unknown. At most 33 characters: A to Z, 0 to 9, _, spaces, and ? for others.
  std::string name;

  /// Whether it is a DICOM segmentation (SEG).
  bool is_segmentation() const { return kind == Kind::kOther && name == "SEG"; }
};

ImageContent image_content(DcmItem& data);

/// The reason why a kLocaliser or kOther is not meshed, with advice and without the file's name.
std::string why_not_ct(const ImageContent& content);

/// Leaves localisers out of a scan unless there is no other image in `files`, or in the series
/// `wanted` if that is not empty. In that case `any_modality` turns them into images like others.
/// Errors: (refused) without `any_modality`, with the name of the first localiser.
Result<void> settle_localisers(std::vector<DicomFile>& files, const std::string& wanted,
                               bool any_modality);

/// The modality of the files in `used` if it is not CT, else empty. Warnings: not_hu if it is not
/// CT; no_modality if a file does not state one.
std::string other_modality(const std::vector<DicomFile>& files,
                           const std::set<std::filesystem::path>& used,
                           std::vector<Warning>& warnings);

}  // namespace trocar::pipeline
