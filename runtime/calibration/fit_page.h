// SPDX-License-Identifier: Apache-2.0
// What a fit has found, as lines for the terminal and as one HTML page that needs no other file and no network: the
// curve with the fit, the residuals, and the table of parameters.
// Tests: tests/runtime/calibration/fitted_tissue_test.cpp
#pragma once

#include <string>

#include "runtime/calibration/curve_fit.h"

namespace trocar::runtime {

/// The parameters with their 90 % intervals, one a line, and what they do not tell apart.
std::string fit_text(const CurveFit& fit);

/// `name`: the curve's file name. `tissue`: the text of fitted_tissue().
std::string fit_page(const CurveFit& fit, const std::string& name, const std::string& tissue);

}  // namespace trocar::runtime
