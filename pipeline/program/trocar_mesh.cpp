// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/trocar_mesh.h"

#include <oneapi/tbb/version.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <map>
#include <new>
#include <opencv2/core/version.hpp>
#include <string>
#include <system_error>
#include <vector>

#include "formats/base/command_line.h"
#include "formats/base/nearest_name.h"
#include "formats/base/program.h"
#include "pipeline/base/malloc_tuning.h"
#include "pipeline/program/arguments.h"
#include "pipeline/program/batch_command.h"
#include "pipeline/program/export_command.h"
#include "pipeline/program/info_command.h"
#include "pipeline/program/list_command.h"
#include "pipeline/program/mesh_command.h"
#include "pipeline/program/messages.h"
#include "pipeline/program/presets.h"
#include "pipeline/program/preview_command.h"
#include "pipeline/program/review_command.h"
#include "pipeline/program/verify_command.h"
#include "pipeline/read/dicom/dicom_dictionary.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;

std::string version() {
  return "trocar-mesh " TROCAR_VERSION " (OpenCV " CV_VERSION ", oneTBB " TBB_VERSION_STRING ", " +
         command_line_library() + ")";
}

// Rewrites `--labels 41 42` as `--labels 41 --labels 42`: if is_value holds for words after an
// option's value, they are further values of the option and not inputs.
template <typename IsValue>
std::vector<std::string> with_repeated(const std::string& option, const IsValue& is_value,
                                       const std::vector<std::string>& words) {
  std::vector<std::string> out;
  bool after_value = false;
  for (std::size_t i = 0; i < words.size(); ++i) {
    const std::string& word = words[i];
    if (after_value && is_value(word)) {
      out.push_back(option);
    } else {
      after_value = word.starts_with(option + "=");
    }
    out.push_back(word);
    if (word == option && i + 1 < words.size()) {
      out.push_back(words[++i]);
      after_value = true;
    }
  }
  return out;
}

// Is the word a list of labels? It then begins with a digit and has only digits, commas, hyphens
// and plus signs.
bool is_labels(const std::string& word) {
  return !word.empty() && word.find_first_not_of("0123456789,-+") == std::string::npos &&
         word.front() >= '0' && word.front() <= '9';
}

bool is_position(const std::string& word) {
  return word.find_first_not_of("0123456789,.+-eE") == std::string::npos &&
         std::count(word.begin(), word.end(), ',') == 2;
}

// Detects a mistyped command, which CLI11 takes for an INPUT.
Result<void> check_command(const CommandLine& line, const Arguments& a) {
  if (a.inputs.empty() || a.inputs[0].has_parent_path()) return {};
  std::error_code ignored;
  if (fs::exists(a.inputs[0], ignored)) return {};
  const std::string meant = did_you_mean(a.inputs[0].string(), line.command_names());
  if (meant.empty()) return {};
  return usage(a.inputs[0].string() + ": no such file, folder or command" + meant);
}

// Refuses commands of former versions, unless an input has the name.
Result<void> check_former(const std::vector<std::string>& words) {
  static const std::map<std::string, std::string> replaced = {{"fetch", "get-study"},
                                                              {"receive", "orthanc-hook"}};
  const auto found = words.size() > 1 ? replaced.find(words[1]) : replaced.end();
  std::error_code ignored;
  if (found == replaced.end() || fs::exists(words[1], ignored)) return {};
  return usage(words[1] + ": the script " + found->second + " replaces this command (archive.md)");
}

// Refuses options before a subcommand. They are options of meshing, and would be ignored.
Result<void> check_nothing_before(const CommandLine& line) {
  for (const Option& option : line.options()) {
    if (option.is_given()) {
      return usage(option.name() + " cannot be combined with " + line.chosen_command() +
                   "; its own options follow it");
    }
  }
  return {};
}

// The command line of trocar-mesh: its options, and a subcommand with its own options.
struct MeshCommandLine {
  CommandLine line{
      kProgram,
      "Makes an asset, a 3D file (.glb), from a CT scan. The asset has one flat triangle mesh for\n"
      "each slice and material, such as bone. INPUT is a folder with a DICOM study, a NIfTI or\n"
      "NRRD file (.nii, .nii.gz, .nrrd, .nhdr), a folder of images, or a list of images.",
      version()};
  Arguments mesh, preview;
  ListArguments list;
  VerifyArguments verify;
  InfoArguments info;
  ExportArguments exported;
  BatchArguments batch;
  ReviewArguments review;

  MeshCommandLine() {
    line.set_help_column(34);
    add_mesh_options(line, mesh);
    add_list_options(line.add_command("list", "list the scans in a folder"), list);
    add_preview_options(
        line.add_command(
            "preview",
            "draw the slices that a run with the same options would mesh; make no asset"),
        preview);
    add_verify_options(line.add_command("verify", "check that the meshes in an asset are valid"),
                       verify);
    add_info_options(line.add_command("info", "show what is in an asset"), info);
    add_export_options(
        line.add_command("export",
                         "write the slices of an asset as .poly, .obj and .svg, or its surface"),
        exported);
    add_batch_options(
        line.add_command("batch",
                         "make the assets of the stale (new or changed) scans of a collection"),
        batch);
    add_review_options(
        line.add_command(
            "review",
            "show all assets in a store (the folder that batch writes), or compare two stores"),
        review);
    // A command takes the footer that is set when it is added. This one is for the program alone.
    line.set_footer(
        "trocar-mesh COMMAND --help describes a command and its options.\n"
        "Exit codes: 0 done; 2 wrong usage; 3 input refused (batch: also if a scan failed);\n"
        "4 output not written, or interrupted; 1 an internal error.");
  }

  int run() const {
    const std::string command = line.chosen_command();
    if (command.empty()) {
      if (const auto ok = check_command(line, mesh); !ok) return fail(ok.error());
      return mesh.explain ? explain(mesh.preset) : run_mesh(mesh);
    }
    if (const auto ok = check_nothing_before(line); !ok) return fail(ok.error());
    if (command == "list") return run_list(list);
    if (command == "preview")
      return preview.explain ? explain(preview.preset) : run_preview(preview);
    if (command == "verify") return run_verify(verify);
    if (command == "info") return run_info(info);
    if (command == "export") return run_export(exported);
    if (command == "batch") return run_batch(batch);
    return run_review(review);
  }

 private:
  static int explain(const std::string& preset) {
    const auto text = explain_presets(preset);
    if (!text) return fail(text.error());
    std::fputs(text->c_str(), stdout);
    return 0;
  }
};

int run(int argc, char** argv) {
  MeshCommandLine program;
  const std::vector<std::string> words = with_repeated(
      "--seed", is_position, with_repeated("--labels", is_labels, {argv, argv + argc}));
  if (const auto ok = check_former(words); !ok) return fail(ok.error());
  if (const auto done = program.line.parse_or_end(with_preset_options(words))) return *done;
  program.mesh.of_preset = program.preview.of_preset = added_by_preset(words);
  // Lack of memory is caused by the input and is not a bug.
  try {
    return program.run();
  } catch (const std::bad_alloc&) {
    return fail(refused_for_now("not enough memory for this input"));
  }
}

}  // namespace

int trocar_mesh(int argc, char** argv) {
  keep_freed_memory();
  leave_out_dicom_dictionary();
  return run_program(kProgram, [&] { return run(argc, argv); });
}

}  // namespace trocar::pipeline
