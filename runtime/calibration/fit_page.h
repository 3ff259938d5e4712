// SPDX-License-Identifier: Apache-2.0
// Writes the result of fitting a tissue to a measured curve of force over depth (curve_fit.h), as
// lines for the terminal and as one HTML page. The page shows the curve with the fit, the
// residuals, and the table of parameters. It needs no other file and no network.
// Tests: tests/runtime/calibration/fitted_tissue_test.cpp
#pragma once

#include <string>

#include "runtime/calibration/curve_fit.h"

namespace trocar::runtime {

/// Returns the parameters with their 90 % intervals, one per line, and notes. A note says, for
/// example, of which quantities the curve determines only the product.
std::string fit_text(const CurveFit& fit);

/// Returns the page. `name`: the curve's file name. `tissue`: the fitted tissue as JSON
/// for a scene, the result of fitted_tissue() (fitted_tissue.h).
std::string fit_page(const CurveFit& fit, const std::string& name, const std::string& tissue);

}  // namespace trocar::runtime
