// SPDX-License-Identifier: GPL-3.0-or-later
// The panel below the slices of the contact sheet. It shows the histogram and the effect of other
// thresholds or, for a label map, the number of voxels of each label.
#pragma once

#include <array>
#include <cstdint>
#include <opencv2/core.hpp>

#include "pipeline/preview/preview.h"

namespace trocar::pipeline {

/// Height of the panel, pixels.
int panel_height(const Preview& preview);

/// Draws the panel with its upper edge at y.
void draw_panel(cv::Mat& sheet, const Preview& preview, int y);

/// Colour of a label that is material, RGB; grey for other labels. There are seven colours (of
/// Okabe and Ito), which people with the usual kinds of colour blindness can distinguish. From the
/// eighth label on, colours are repeated.
std::array<std::uint8_t, 3> label_colour(const Preview& preview, int label);

}  // namespace trocar::pipeline
