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
  kStored,  ///< the stored numbers, 1 to 16 bits, or the indices of a palette; for labels
};

/// Reads PNG (by ISA-L or libspng), JPEG and BMP (libjpeg-turbo) and TIFF (libtiff). The format is
/// recognised by the first bytes. Images have 8 or 16 bits per channel and are grey or coloured.
/// The size is checked before anything is decoded. Errors: kRefused if the file cannot be read, a
/// TIFF has several pages, the decoder warns (because it has substituted missing pixels), or labels
/// are wanted but the image is coloured or a JPEG. The message names the file and the reason.
/// (OpenCV's imread is not used: it prints to stderr, accepts up to 2^30 pixels, and tries further
/// formats.)
Result<Image> read_image_file(const std::filesystem::path& file, Levels wanted = Levels::kTo255);

}  // namespace trocar::pipeline
