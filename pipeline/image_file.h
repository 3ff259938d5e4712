// SPDX-License-Identifier: GPL-3.0-or-later
// One image file as grey levels.
#pragma once

#include <filesystem>

#include "formats/result.h"
#include "pipeline/slice_stack.h"

namespace trocar::pipeline {

/// PNG (libspng), JPEG (libjpeg-turbo), TIFF and BMP (OpenCV), told by their first bytes; 8 or 16
/// bits a channel, grey or colour. Values are 0..255; 16-bit ones keep their fractions. The size
/// is checked before anything is decoded. Errors (refused) name the file and the reason.
Result<Image> read_image_file(const std::filesystem::path& file);

}  // namespace trocar::pipeline
