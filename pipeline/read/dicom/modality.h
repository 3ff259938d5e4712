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

/// The kind of a file's images. It is the first of the following kinds whose condition holds:
/// 1. kLocaliser: a value of ImageType contains LOCALIZER, SURVIEW (as REF_SURVIEW does) or SCOUT.
/// 2. kOther: the modality is not CT, or a value of ImageType contains MOSAIC or SCREEN SAVE, or
///    the file is a Secondary Capture without a rescale, or a CT whose RescaleType neither begins
///    with HU nor is US (unspecified).
/// 3. kCt: the modality is CT.
/// 4. kUnknown: there is no modality.
/// The modality comes from the attribute Modality. If this attribute is missing or empty, the
/// modality comes from the SOP class, provided that scanners write this class.
struct ImageContent {
  enum class Kind { kCt, kUnknown, kLocaliser, kOther };
  Kind kind = Kind::kUnknown;
  /// The modality, such as "CT". If something else decided the kind, it follows the modality: a
  /// value of ImageType ("MR MOSAIC", "CT LOCALIZER"), SECONDARY CAPTURE or the RescaleType. Empty
  /// if unknown. At most 34 characters: A to Z, 0 to 9, _ and spaces; ? replaces any other
  /// character.
  std::string name;

  /// Is it a DICOM segmentation (SEG)?
  bool is_segmentation() const { return kind == Kind::kOther && name == "SEG"; }
};

ImageContent image_content(DcmItem& data);

/// The reason why a kLocaliser or kOther is not meshed, with advice and without the file's name.
std::string why_not_ct(const ImageContent& content);

/// Decides what happens to localisers. If `files` (or, if `wanted` is not empty, the series
/// `wanted`) has other images, localisers are left out of the scan. If there are only localisers,
/// `any_modality` turns them into ordinary images. Errors: kRefused if there are only localisers
/// and `any_modality` is not set; the message names the first localiser.
Result<void> settle_localisers(std::vector<DicomFile>& files, const std::string& wanted,
                               bool any_modality);

/// The modality of the files in `used` if it is not CT, otherwise empty. Warnings: not_hu if the
/// modality is not CT; no_modality if a file does not state one.
std::string other_modality(const std::vector<DicomFile>& files,
                           const std::set<std::filesystem::path>& used,
                           std::vector<Warning>& warnings);

}  // namespace trocar::pipeline
