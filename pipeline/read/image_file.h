// SPDX-License-Identifier: GPL-3.0-or-later
// One image file as grey levels.
#pragma once

#include <filesystem>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

enum class Levels {
  kTo255,   ///< 0..255; 16-bit ones keep their fractions
  kStored,  ///< labels: the numbers stored, 1 to 16 bits, or a palette's indices
};

/// PNG (libspng), JPEG and BMP (libjpeg-turbo), TIFF (libtiff), told by their first bytes; 8 or 16
/// bits a channel, grey or colour; a TIFF of several pages is refused. The size
/// is checked before anything is decoded, and what a decoder only warns of (pixels that it made up)
/// is an error. Colours hold no labels, nor does a JPEG. Errors (refused) name the file and the
/// reason.
/// (OpenCV's imread, with the same libraries behind it, prints what it meets to stderr, knows no
/// limit of size short of 2^30 pixels, and tries further formats that nobody asked for.)
Result<Image> read_image_file(const std::filesystem::path& file, Levels wanted = Levels::kTo255);

}  // namespace trocar::pipeline
