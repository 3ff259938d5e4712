// SPDX-License-Identifier: GPL-3.0-or-later
// Recognises CT images, whose values are HU, among DICOM images, and names the modality of others.
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
/// 2. kOther: there is a modality other than CT, or a value of ImageType contains MOSAIC or SCREEN
///    SAVE, or the file is a Secondary Capture without a rescale, or a CT whose RescaleType neither
///    begins with HU nor is US (unspecified).
/// 3. kCt: the modality is CT.
/// 4. kUnknown: there is no modality.
/// The modality comes from the attribute Modality. If this attribute is missing or empty, the
/// modality comes from the SOP class, if modality.cpp lists that class.
struct ImageContent {
  enum class Kind { kCt, kUnknown, kLocaliser, kOther };
  Kind kind = Kind::kUnknown;
  /// The modality, such as "CT"; empty if unknown. If the kind depends on more than the modality,
  /// the reason follows: a value of ImageType ("MR MOSAIC", "CT LOCALIZER"), SECONDARY CAPTURE or
  /// the RescaleType. The name has at most 34 characters: A to Z, 0 to 9, _, spaces, and ? in place
  /// of any other character.
  std::string name;

  /// Is the file a DICOM segmentation (SEG)?
  bool is_segmentation() const { return kind == Kind::kOther && name == "SEG"; }
};

/// The kind and the name of the images of a dataset.
ImageContent image_content(DcmItem& data);

/// The reason why images of kind kLocaliser or kOther are not meshed, and what to do. The text does
/// not name the file.
std::string why_not_ct(const ImageContent& content);

/// Decides whether localisers are images of the scan. The function looks at all files or, if
/// `wanted` is not empty, at those of the series with the UID `wanted`. If there are other DICOM
/// images beside the localisers, the localisers stay kLocaliser, and group_series() leaves them
/// out. If there are only localisers and `any_modality` is set, they become kImages, or kUnusable
/// if they have no frames. Errors: kRefused if there are only localisers and `any_modality` is not
/// set; the message names the first localiser.
Result<void> settle_localisers(std::vector<DicomFile>& files, const std::string& wanted,
                               bool any_modality);

/// Looks at those of `files` that are in `used`, the files of the opened slices. Returns
/// ImageContent::name of the first one whose content is neither kCt nor kUnknown; empty if there is
/// none. Warnings: not_hu if the result is not empty; otherwise no_modality if one is kUnknown.
std::string other_modality(const std::vector<DicomFile>& files,
                           const std::set<std::filesystem::path>& used,
                           std::vector<Warning>& warnings);

}  // namespace trocar::pipeline
