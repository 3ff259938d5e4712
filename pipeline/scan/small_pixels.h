// SPDX-License-Identifier: GPL-3.0-or-later
// Defaults in mm that follow the pixel where it is small, as in micro-CT: they are meant for
// clinical CT, and would drop or move most of the structures of a finer scan.
#pragma once

#include "pipeline/read/slice_stack.h"
#include "pipeline/scan/mesh_stack.h"

namespace trocar::pipeline {

/// Defaults follow pixels whose narrower side is below this width.
inline constexpr double kSmallPixel_mm = 0.3;

/// Sets the options of DefaultOptions for a scan with small pixels; otherwise changes nothing. Of
/// different pixels the smallest counts.
///  - tolerance: at most 0.4 of the narrower side, so that no outline moves by half a pixel
///  - smallest region: at most 4 pixels
///  - lattice: at least 64 steps a pixel, as far as an asset can hold the slice and the lattice
///    goes
///  - close: at most 10 pixels for each 3 mm; smallest volume: with the third power of that
/// Both methods of the last line apply to values of a preset.
void follow_small_pixels(const SliceStack& stack, StackOptions& options);

}  // namespace trocar::pipeline
