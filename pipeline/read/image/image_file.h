// SPDX-License-Identifier: GPL-3.0-or-later
// Reads one image file as grey levels.
#pragma once

#include <filesystem>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

enum class Levels {
  kTo255,  ///< grey levels of 0..255; levels of 16 bits are divided by 257 without rounding
  /// The stored numbers of 1 to 16 bits; used for labels. If a PNG, TIFF or BMP has a palette (a
  /// table of colours), the stored numbers are the indices into the palette.
  kStored,
};

/// Reads a PNG, JPEG, BMP or TIFF; the first bytes tell the format. Images have up to 16 bits per
/// channel. Colours are converted to grey levels. The size is checked before anything is decoded.
///
/// Errors: kRefused if the file cannot be read, is damaged or has an unsupported format, if a TIFF
/// has several pages, or if labels are wanted (kStored) but the image is a JPEG or has colours. The
/// colours of a palette do not count if its indices are returned. The message names the file and
/// the reason.
///
/// OpenCV's imread() is not used, because it prints to stderr, accepts up to 2^30 pixels and tries
/// further formats.
Result<Image> read_image_file(const std::filesystem::path& file, Levels wanted = Levels::kTo255);

}  // namespace trocar::pipeline
