// SPDX-License-Identifier: Apache-2.0
// Makes the tissue of a scene from a fitted curve: an object for `tissue` of
// formats/session/scene.schema.json.
//
// tool_in_tissue.h computes forces from a tissue and a tool. This file inverts that computation for
// the tool with which the curve was measured. strength_MPa is the cutting force divided by the
// displaced area. The cutting force includes tearing and face friction, so the tissue has no
// separate values for these.
// friction_kPa is the friction per length divided by the circumference. modulus_MPa follows from
// the stiffness with Poisson's ratio 0.3, and stiffness_N_per_m is the stiffness itself.
// threshold_N is the cutting force. Such a curve does not show how stiff the walls of the hole are,
// so bed_N_per_mm3 is left out. The tissue is valid for tools of a similar shape and size.
// Tests: tests/runtime/calibration/fitted_tissue_test.cpp
#pragma once

#include <string>

#include "formats/base/result.h"
#include "formats/session/scene.h"
#include "runtime/calibration/curve_fit.h"

namespace trocar::runtime {

/// Reads the tool from a file that holds a scene, or only the object `tool` of a scene. Errors:
/// kRefused if the file cannot be read; those of parse_scene() and tool_shape().
Result<SceneTool> read_fit_tool(const std::filesystem::path& file);

/// Returns the tissue as JSON with a line feed at its end. The function checks the tissue with
/// parse_scene(). Errors: those of tool_shape(); kRefused if a value is outside the range that a
/// scene allows. The messages do not contain the file's name.
Result<std::string> fitted_tissue(const CurveFit& fit, const SceneTool& tool);

/// Returns the hard layer as the object `shell` of a scene's `body`, in one line of JSON.
/// Returns an empty text if the curve shows no hard layer, or if the layer is outside the range
/// that a scene allows.
std::string fitted_shell(const CurveFit& fit);

}  // namespace trocar::runtime
