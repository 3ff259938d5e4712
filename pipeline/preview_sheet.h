// SPDX-License-Identifier: GPL-3.0-or-later
// The contact sheet of a preview as a picture: the slices with their outlines, and below them the
// histogram and what another threshold would change.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "pipeline/preview.h"

namespace trocar::pipeline {

struct Picture {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgb;  ///< row-major
};

/// What is written above the slices. Nothing in it, nor in the rest of a sheet, is from the input's
/// names or texts: they may say whose scan it is.
struct SheetText {
  std::string title;
  std::string options;  ///< those that the material depends on
};

struct Tile {
  int x = 0, y = 0, width = 0, height = 0;  ///< pixels of the picture
};

struct Sheet {
  Picture picture;
  std::vector<Tile> tiles;  ///< of the preview's slices
  /// The part of each slice that its tile shows: all material of all slices, and a margin. The
  /// tile's edges are the outer edges of these pixels.
  Crop view;
  double window_low = 0, window_high = 0;  ///< values that are black and white; not of labels
};

/// One scale for all slices. Text that is not ASCII is drawn as question marks.
Sheet draw_sheet(const Preview& preview, const SheetText& text);

/// The colour of a wanted label, RGB; grey for others. They can be told apart with the usual kinds
/// of colour blindness (Okabe and Ito), until after seven they repeat.
std::array<std::uint8_t, 3> label_colour(const Preview& preview, int label);

/// Sizes of the scan and of what is shown, for the sheet and the page.
std::string size_text(const Preview& preview, const Crop& view);

/// The preview's warnings without the names of files, each once. Sentences that hold names or texts
/// of the input are left to the terminal.
std::vector<Warning> shown_warnings(const Preview& preview);

/// What the areas and outlines of Preview::changes are.
std::string changes_text(const Preview& preview);

/// A number with up to `digits` significant digits.
std::string number_text(double value, int digits = 4);

}  // namespace trocar::pipeline
