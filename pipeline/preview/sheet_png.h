// SPDX-License-Identifier: GPL-3.0-or-later
// PNG files of contact sheets and thumbnails. They contain no time, so that the same picture always
// gives the same file.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/preview/preview_sheet.h"

namespace trocar::pipeline {

/// The picture as a PNG file. Errors: kRefused if there is not enough memory; kBug if the picture
/// cannot be encoded.
Result<std::vector<std::uint8_t>> png_of(const Picture& picture);

/// Was the file written by png_of()? Only such a file may be overwritten by a new preview.
bool is_sheet(const std::filesystem::path& file);

/// The PNG as a `data:` URL, for an HTML page.
std::string png_url(std::span<const std::uint8_t> png);

}  // namespace trocar::pipeline
