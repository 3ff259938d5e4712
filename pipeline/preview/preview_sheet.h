// SPDX-License-Identifier: GPL-3.0-or-later
// The contact sheet of a preview as a picture: the slices with their outlines, and below them the
// histogram and the effect of other thresholds.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

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

}  // namespace trocar::pipeline
