// SPDX-License-Identifier: GPL-3.0-or-later
// The contact sheet of a preview as a picture: the slices with their outlines, and below them the
// histogram and the effect of other thresholds.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/preview/preview.h"

namespace trocar::pipeline {

struct Picture {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgb;  ///< three bytes for each pixel, row by row
};

/// The text above the slices. Nothing on a sheet comes from names or texts of the input, because
/// such texts may identify the patient.
struct SheetText {
  std::string title;
  std::string options;  ///< the options that determine the material, in words
};

struct Tile {
  int x = 0, y = 0, width = 0, height = 0;  ///< position and size in the picture, pixels
};

struct Sheet {
  Picture picture;
  std::vector<Tile> tiles;  ///< one tile for each slice of the preview
  /// The region that the tiles show, the same for all slices. It contains the material of all
  /// slices shown, and a margin. A tile shows all pixels of this region whole: the edges of the
  /// tile are the outer edges of the outermost pixels.
  Crop view;
  /// Pixels with values up to window_low are black, and pixels with values of at least window_high
  /// are white. A sheet of a label map does not use these two numbers.
  double window_low = 0, window_high = 0;
};

/// Draws the sheet with the same scale for all slices.
Sheet draw_sheet(const Preview& preview, const SheetText& text);

// PNG files of contact sheets and thumbnails. They contain no time, so that the same picture always
// gives the same file.

/// The picture as a PNG file. Errors: kRefused if there is not enough memory; kBug if the picture
/// cannot be encoded.
Result<std::vector<std::uint8_t>> png_of(const Picture& picture);

/// Was the file written by png_of()? Only such a file may be overwritten by a new preview.
bool is_sheet(const std::filesystem::path& file);

/// The PNG as a `data:` URL, for an HTML page.
std::string png_url(std::span<const std::uint8_t> png);

// A preview as one HTML page: the contact sheet (one picture with all slices shown), and the
// preview's numbers as tables. The page contains neither a time nor a folder, so the same input and
// options give the same bytes.

/// Makes the page. `kind` is a word for the kind of the input, the result of input_kind()
/// (preview.h). `png` is the sheet's picture as a PNG file. Programs can read the numbers as
/// JSON (`trocar.preview/1`) from the script element with the id "preview".
std::string preview_page(const Preview& preview, const Sheet& sheet, const SheetText& text,
                         const std::string& kind, std::span<const std::uint8_t> png);

}  // namespace trocar::pipeline
