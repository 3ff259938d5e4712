// SPDX-License-Identifier: GPL-3.0-or-later
// A preview as one HTML page: the contact sheet (one picture with all slices shown), and the
// preview's numbers as tables. The page contains neither a time nor a folder, so the same input and
// options give the same bytes.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "pipeline/preview/preview_sheet.h"

namespace trocar::pipeline {

/// Makes the page. `kind` is a word for the kind of the input, the result of input_kind()
/// (preview_text.h). `png` is the sheet's picture as a PNG file. Programs can read the numbers as
/// JSON (`trocar.preview/1`) from the script element with the id "preview".
std::string preview_page(const Preview& preview, const Sheet& sheet, const SheetText& text,
                         const std::string& kind, std::span<const std::uint8_t> png);

}  // namespace trocar::pipeline
