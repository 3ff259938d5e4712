// SPDX-License-Identifier: GPL-3.0-or-later
// The commands of trocar-mesh, and what they share: how they open a scan, and print errors.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/base/result.h"
#include "pipeline/batch/batch_run.h"
#include "pipeline/batch/collection.h"
#include "pipeline/open/open_stack.h"
#include "pipeline/program/arguments.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {

/// What a command does after parsing; returns the exit code.
using Command = std::function<int()>;

// Each function declares the options of a command; what it returns owns their values.
Command add_list(CLI::App& command);
Command add_info(CLI::App& command);
Command add_verify(CLI::App& command);
Command add_export(CLI::App& command);
Command add_batch(CLI::App& command);
Command add_review(CLI::App& command);

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

/// Meshes the scan that was opened with these options. Errors: those of mesh_stack().
Result<StackResult> mesh_scan(Arguments& a, const LabelsWithCt& scan);

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

// `trocar-mesh preview`: writes a picture (.png) or a page (.html) of what trocar-mesh would mesh
// with the same options.

/// Writes the picture or page and returns the exit code.
int run_preview(Arguments a);

// A surface in a file of its own.

/// Is `ending` one that surface_text() accepts: ".stl", ".ply" or ".obj"?
bool is_surface_ending(std::string_view ending);

/// The contents of a file with the surface: binary .stl, binary .ply or .obj, as `ending` says.
/// Coordinates are in mm in the patient's LPS frame. Triangles are counter-clockwise seen from
/// outside. The .ply and the .obj also have a normal for each vertex. Errors: kRefused if the
/// surface is not manifold.
Result<std::string> surface_text(const TriangleSurface& surface, const std::string& ending);

// `trocar-mesh batch`: the scans that it opens and meshes. The parameters of a scan in a collection
// are options of trocar-mesh, which the parser of the command line reads.

class FarmScans : public farm::ScanProgram {
 public:
  /// `digest`: SHA-256 of the executable that meshes.
  explicit FarmScans(std::string digest = "") : digest_(std::move(digest)) {}
  const std::string& digest() const override { return digest_; }
  /// Errors: kUsage if `given` names an option that trocar-mesh does not have, or one that a
  /// collection must not give; otherwise the errors of the same options on the command line.
  Result<farm::Parameters> parameters(const nlohmann::json& given) const override;
  /// False if all inputs, the CT of --hu and the mask, if given, are NIfTI files, because the paths
  /// alone then determine the files of the scan.
  bool opens_first(const std::vector<std::filesystem::path>& inputs,
                   const farm::Parameters& parameters) const override;
  Result<std::unique_ptr<farm::OpenedScan>> open(const nlohmann::json& given,
                                                 const std::vector<std::filesystem::path>& inputs,
                                                 const std::string& series,
                                                 int threads) const override;

 private:
  std::string digest_;
};

/// The names of the options that a collection may give as parameters, without the leading --.
std::vector<std::string> collection_options();

}  // namespace trocar::pipeline
