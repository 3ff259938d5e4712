// SPDX-License-Identifier: GPL-3.0-or-later
// One image file as grey levels.
// Tests: tests/pipeline/read/readers_test.cpp
#pragma once

#include <filesystem>

#include "formats/base/result.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

enum class Levels {
  kTo255,   ///< 0..255; 16-bit levels are scaled and keep their fractions
  kStored,  ///< labels: the numbers stored, 1 to 16 bits, or a palette's indices
};

/// PNG (ISA-L, libspng), JPEG and BMP (libjpeg-turbo), TIFF (libtiff), recognised by their first
/// bytes; 8 or 16 bits a channel, grey or colour. The size is checked before anything is decoded.
/// Errors (refused) name the file and the reason: unreadable, a TIFF of several pages, a decoder's
/// warning (it substitutes missing pixels), and for labels colours or a JPEG. (OpenCV's imread is
/// not used: it prints to stderr, accepts up to 2^30 pixels, and tries further formats.)
Result<Image> read_image_file(const std::filesystem::path& file, Levels wanted = Levels::kTo255);

}  // namespace trocar::pipeline
