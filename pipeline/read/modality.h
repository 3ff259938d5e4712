// SPDX-License-Identifier: GPL-3.0-or-later
// Which DICOM images are CT, whose values are HU, and what the others are called.
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

/// What a file's images are:
/// 1. kLocaliser: a value of ImageType contains LOCALIZER, SURVIEW (as REF_SURVIEW does) or SCOUT.
/// 2. kOther: the modality is not CT, or a value of ImageType is MOSAIC or SCREEN SAVE, or the file
///    is a Secondary Capture without a rescale, or a CT with a RescaleType other than HU, HU_MOD
///    and US (unspecified).
/// 3. kCt: the modality is CT.
/// 4. kUnknown: there is no modality.
/// The modality is that of the attribute Modality; where this is missing or empty, that of the SOP
/// class, as far as it is one of those that scanners write.
struct ImageContent {
  enum class Kind { kCt, kUnknown, kLocaliser, kOther };
  Kind kind = Kind::kUnknown;
  /// The modality, then the value of ImageType that decided: "CT", "MR MOSAIC", "CT LOCALIZER".
  /// Empty if unknown. At most 33 characters: A to Z, 0 to 9, _, spaces, and ? for others.
  std::string name;

  /// A label map in DICOM (SEG).
  bool is_segmentation() const { return kind == Kind::kOther && name == "SEG"; }
};

ImageContent image_content(DcmItem& data);

/// Why a kLocaliser or kOther is not meshed and what to do, without the file's name.
std::string why_not_ct(const ImageContent& content);

/// Localisers are left out of a scan unless there is nothing else: no other image in `files`, or in
/// the series `wanted` if that is not empty. Then, with `any_modality` they become images like
/// others. Errors: (refused) without it, by the first one's name.
Result<void> settle_localisers(std::vector<DicomFile>& files, const std::string& wanted,
                               bool any_modality);

/// The name of what the files in `used` hold if it is not CT, else empty. Warnings: not_hu, if it
/// is not CT; no_modality, if a file does not say what it is.
std::string other_modality(const std::vector<DicomFile>& files,
                           const std::set<std::filesystem::path>& used,
                           std::vector<Warning>& warnings);

}  // namespace trocar::pipeline
