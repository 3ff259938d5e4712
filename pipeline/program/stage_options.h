// SPDX-License-Identifier: GPL-3.0-or-later
// Translates the options of the command line into the options of opening and meshing a scan.
#pragma once

#include <nlohmann/json.hpp>

#include "pipeline/program/arguments.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/scan/mesh_stack.h"

namespace trocar::pipeline {

/// The options of meshing. The function also reads the files of --names and --input-key. Errors:
/// kUsage if an option has a wrong value or excludes another option, with a message that names the
/// option; the errors of reading those files.
Result<StackOptions> stack_options(const Arguments& a);

/// The options of opening the scan. Errors: kUsage if an option has a wrong value; the message
/// names the option.
Result<OpenOptions> open_options(const Arguments& a);

/// The name of the axis: "transverse" (for kAxial), "coronal" or "sagittal".
const char* axis_name(SliceAxis axis);

/// The options of meshing and opening as the parameters that reports and assets store.
nlohmann::json parameters_json(const StackOptions& options, const OpenOptions& input);

}  // namespace trocar::pipeline
