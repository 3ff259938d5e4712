// SPDX-License-Identifier: GPL-3.0-or-later
// Text and colours of the preview's contact sheet.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace trocar::pipeline {

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

}  // namespace trocar::pipeline
