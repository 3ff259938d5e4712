// SPDX-License-Identifier: GPL-3.0-or-later
// Translation of the command line's options to the options of the stages.
// Tests: tests/pipeline/program/parameters_test.cpp
#pragma once

#include <nlohmann/json.hpp>

#include "pipeline/program/arguments.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/scan/mesh_stack.h"

namespace trocar::pipeline {

/// The options of meshing. Errors: kUsage; the message names the option.
Result<StackOptions> stack_options(const Arguments& a);

/// The options of opening the scan. Errors: kUsage; the message names the option.
Result<OpenOptions> open_options(const Arguments& a);

/// "transverse", "coronal" or "sagittal".
const char* axis_name(SliceAxis axis);

/// The parameters in the form in which reports and assets store them.
nlohmann::json parameters_json(const StackOptions& options, const OpenOptions& input);

}  // namespace trocar::pipeline
