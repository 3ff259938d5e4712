// SPDX-License-Identifier: GPL-3.0-or-later
// The files of a preview: the sheet as PNG, or one HTML page with the sheet in it and its numbers
// as text. Both have no time and no folder in them: the same input and options give the same bytes.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/preview_sheet.h"

namespace trocar::pipeline {

/// What was given: "DICOM", "NIfTI" or "images".
std::string input_kind(const SliceStack& stack);

/// What is shown of what.
std::string sheet_title(const SliceStack& stack, const Preview& preview);

/// The options that the material depends on, in words.
std::string options_text(const BatchOptions& options, const OpenOptions& input, PixelUnit unit);

/// Errors (refused): not enough memory.
Result<std::vector<std::uint8_t>> png_of(const Picture& picture);

/// Whether the file is a PNG by png_of().
bool is_sheet(const std::filesystem::path& file);

/// The page, UTF-8. `png` is that of the sheet. Its numbers are there as JSON too, in the script
/// element with the id "preview".
std::string page_of(const Preview& preview, const Sheet& sheet, const SheetText& text,
                    const std::string& kind, std::span<const std::uint8_t> png);

}  // namespace trocar::pipeline
