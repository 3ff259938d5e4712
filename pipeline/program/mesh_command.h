// SPDX-License-Identifier: GPL-3.0-or-later
// Opens a scan with the options of the command line, for meshing, a preview or a batch, and
// describes its series in reports.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "pipeline/open/open_stack.h"
#include "pipeline/program/arguments.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// Opens the scan. If --hu is given, the scan is a label map, and the CT of --hu is opened too;
/// both must have the same voxel grid. Errors: those of open_stack() and open_labels_with_ct().
Result<LabelsWithCt> open_scan(const Arguments& a);

/// All files that a run reads: those of the scan, those of the CT of --hu, and the files of
/// --names, --input-key and --mask. The caller must not write an output over one of them.
std::vector<std::filesystem::path> files_read(const Arguments& a, const LabelsWithCt& scan);

/// Adds the warning completeness_unknown to the stack if --completeness-unknown is given.
/// Checks whether the threshold suits a scan whose values are not HU. The default threshold and the
/// thresholds of presets are meant for HU only. With --labels or --equalize nothing is checked,
/// because these options replace the threshold.
///  - Image files: a missing threshold is an error (kUsage), and so is a preset. A threshold
///    outside 0..255 selects all pixels or none; the function then adds the warning
///    threshold_out_of_range to the stack.
///  - DICOM other than CT: if there is a preset or no threshold, the function adds the warning
///    default_threshold to the stack.
Result<void> check_input(const Arguments& a, SliceStack& stack);

/// The series of a report (its member input.series): number, kernel and modality. Whatever may
/// identify the patient is left out: the series' UID and description, a kernel that could be a name
/// or a date, and a modality that DICOM does not define. The last two become empty texts.
nlohmann::json series_for_report(const SeriesInfo& series);

// `trocar-mesh INPUT -o ASSET.glb`: meshes one scan.

/// Meshes the scan, writes the output and returns the exit code. If the name `a.output` ends in
/// .glb, the output is the asset; if it ends in .stl, .ply or .obj, the output is only the
/// surface. With --report, a report is written too, and with --dump-stages the intermediate
/// results of one slice.
int run_mesh(Arguments a);

// Prints errors and warnings of trocar-mesh, and finds the endings of file names.

inline constexpr const char* kProgram = "trocar-mesh";

/// Prints the error's message to standard error and returns the error's exit code.
int fail(const Error& error);

/// Prints a warning to standard error.
void print_warning(const Warning& warning);

/// The extension of a file name in lower case, with its dot; empty if there is none.
std::string ending_of(const std::filesystem::path& file);

}  // namespace trocar::pipeline
