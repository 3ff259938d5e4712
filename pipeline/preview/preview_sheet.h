// SPDX-License-Identifier: GPL-3.0-or-later
// The contact sheet of a preview as a picture: the slices with their outlines, and below them the
// histogram and the effect of other thresholds.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <opencv2/core.hpp>
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

// Text and colours of the preview's contact sheet.

// All colours are RGB.
inline const cv::Scalar kBackground(20, 22, 25), kText(228, 230, 233), kFaint(150, 155, 162),
    kLine(70, 74, 80), kOutlineColour(255, 165, 0), kThreshold(255, 165, 0), kBars(120, 140, 160),
    kMaterialBars(200, 140, 40), kWarning(255, 205, 90), kLabel(160, 225, 255);
inline constexpr int kWidth = 1600, kMargin = 24;                      // pixels
inline constexpr double kSmall = 0.46, kNormal = 0.54, kLarge = 0.85;  // font scales of OpenCV

enum class Align { kLeft, kCentre, kRight };

/// Width in pixels of an ASCII text. In all functions of this header, `size` is a font scale.
int text_width(const std::string& text, double size);

/// Draws a text whose baseline is y pixels below the upper edge. Depending on `align`, the left
/// end, the middle or the right end of the text is at x. Characters that are not printable ASCII
/// become question marks.
void draw_text(cv::Mat& on, const std::string& text, int x, int y, double size,
               const cv::Scalar& colour, Align align = Align::kLeft);

/// Draws lines of text below each other: the first one's baseline is at y, and baselines are
/// `height` pixels apart. Returns the y of a further line.
int draw_lines(cv::Mat& on, const std::vector<std::string>& lines, int x, int y, double size,
               const cv::Scalar& colour, int height);

/// Like draw_text(), but in light blue with a dark border, so that the text is legible on any
/// image.
void draw_label(cv::Mat& on, const std::string& text, int x, int y, double size, Align align);

/// The text broken into lines of at most `width` pixels. As in draw_text(), characters that are not
/// printable ASCII become question marks. A word that is too long for a line is broken too.
std::vector<std::string> wrapped(const std::string& text, double size, int width);

/// The largest number not above `value` that is 1, 2 or 5 times a power of ten. Such a number is a
/// good distance between the marks of an axis.
double nice_below(double value);

// The panel below the slices of the contact sheet. It shows the histogram and the effect of other
// thresholds or, for a label map, the number of voxels of each label.

/// Height of the panel, pixels.
int panel_height(const Preview& preview);

/// Draws the panel with its upper edge at y.
void draw_panel(cv::Mat& sheet, const Preview& preview, int y);

/// Colour of a label that is material, RGB; grey for other labels. There are seven colours (of
/// Okabe and Ito), which people with the usual kinds of colour blindness can distinguish. From the
/// eighth label on, colours are repeated.
std::array<std::uint8_t, 3> label_colour(const Preview& preview, int label);

// A preview as one HTML page: the contact sheet (one picture with all slices shown), and the
// preview's numbers as tables. The page contains neither a time nor a folder, so the same input and
// options give the same bytes.

/// Makes the page. `kind` is a word for the kind of the input, the result of input_kind()
/// (preview_text.h). `png` is the sheet's picture as a PNG file. Programs can read the numbers as
/// JSON (`trocar.preview/1`) from the script element with the id "preview".
std::string preview_page(const Preview& preview, const Sheet& sheet, const SheetText& text,
                         const std::string& kind, std::span<const std::uint8_t> png);

}  // namespace trocar::pipeline
