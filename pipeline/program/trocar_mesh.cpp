// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/trocar_mesh.h"

#include <oneapi/tbb/version.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <new>
#include <opencv2/core/version.hpp>
#include <string>
#include <system_error>
#include <vector>

#include "formats/base/command_line.h"
#include "formats/base/nearest_name.h"
#include "pipeline/base/malloc_tuning.h"
#include "pipeline/program/archive/archive_options.h"
#include "pipeline/program/archive/archive_process.h"
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

constexpr const char* kVersion = "trocar-mesh " TROCAR_VERSION " (OpenCV " CV_VERSION
                                 ", oneTBB " TBB_VERSION_STRING ", CLI11 " CLI11_VERSION ")";

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
Result<void> check_command(const CLI::App& app, const Arguments& a) {
  if (a.inputs.empty() || a.inputs[0].has_parent_path()) return {};
  std::error_code ignored;
  if (fs::exists(a.inputs[0], ignored)) return {};
  std::vector<std::string> commands;
  for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; }))
    commands.push_back(command->get_name());
  const std::string meant = did_you_mean(a.inputs[0].string(), commands);
  if (meant.empty()) return {};
  return usage(a.inputs[0].string() + ": no such file, folder or command" + meant);
}

// Refuses options before a subcommand. They are options of meshing, and would be ignored.
Result<void> check_nothing_before(const CLI::App& app) {
  for (const CLI::Option* option : app.get_options()) {
    if (option->count() > 0) {
      return usage(option->get_name() + " cannot be combined with " +
                   app.get_subcommands().front()->get_name() + "; its own options follow it");
    }
  }
  return {};
}

// The command line of trocar-mesh: its options, and a subcommand with its own options.
struct CommandLine {
  CLI::App app{
      "Makes an asset from a CT scan: a 3D file (.glb) with one flat triangle mesh for each slice\n"
      "and material, such as bone. INPUT is a folder with a DICOM study, a NIfTI file (.nii or\n"
      ".nii.gz), a folder of images, or a list of images."};
  Arguments mesh, preview;
  ListArguments list;
  VerifyArguments verify;
  InfoArguments info;
  ExportArguments exported;
  BatchArguments batch;
  ReviewArguments review;
  ReceiveArguments receive;
  FetchArguments fetch;

  CommandLine() {
    app.name(kProgram);
    app.get_formatter()->column_width(kHelpColumn);
    add_help_and_version(app, kVersion);
    app.require_subcommand(0, 1);
    add_mesh_options(app, mesh);
    add_list_options(add("list", "list the scans in a folder"), list);
    add_preview_options(
        add("preview",
            "draw the slices that a run with the same options would mesh; make no asset"),
        preview);
    add_verify_options(add("verify", "check that the meshes in an asset are valid"), verify);
    add_info_options(add("info", "show what is in an asset"), info);
    add_export_options(
        add("export", "write the slices of an asset as .poly, .obj and .svg, or its surface"),
        exported);
    add_batch_options(
        add("batch", "make the assets of the stale (new or changed) scans of a collection"), batch);
    add_review_options(
        add("review", "show all assets in a store (the folder of batch), or compare two stores"),
        review);
    add_receive_options(add("receive", "receive studies that an archive (PACS) sends by DICOM"),
                        receive);
    add_fetch_options(add("fetch", "get a study from an archive (PACS) by DICOM"), fetch);
    add_help_for_diagnostics(app);
  }

  // `argv` are the arguments of main(), which a program of its own parses again.
  int run(char** argv) const {
    if (app.get_subcommands().empty()) {
      if (const auto ok = check_command(app, mesh); !ok) return fail(ok.error());
      return mesh.explain ? explain(mesh.preset) : run_mesh(mesh);
    }
    if (const auto ok = check_nothing_before(app); !ok) return fail(ok.error());
    const std::string command = app.get_subcommands().front()->get_name();
    if (command == "list") return run_list(list);
    if (command == "preview")
      return preview.explain ? explain(preview.preset) : run_preview(preview);
    if (command == "verify") return run_verify(verify);
    if (command == "info") return run_info(info);
    if (command == "export") return run_export(exported);
    if (command == "batch") return run_batch(batch);
    return command == "review" ? run_review(review) : become_trocar_archive(argv);
  }

 private:
  CLI::App& add(const char* name, const char* help) {
    CLI::App* command = app.add_subcommand(name, help);
    command->get_formatter()->column_width(kHelpColumn);
    return *command;
  }

  static constexpr std::size_t kHelpColumn = 34;  // first column of the descriptions

  static int explain(const std::string& preset) {
    const auto text = explain_presets(preset);
    if (!text) return fail(text.error());
    std::fputs(text->c_str(), stdout);
    return 0;
  }
};

int run(int argc, char** argv) {
  CommandLine line;
  const std::vector<std::string> words = with_preset_options(with_repeated(
      "--seed", is_position, with_repeated("--labels", is_labels, {argv, argv + argc})));
  std::vector<const char*> pointers;
  pointers.reserve(words.size());
  for (const std::string& word : words)
    pointers.push_back(word.c_str());
  if (const auto done =
          parse_command_line(line.app, static_cast<int>(pointers.size()), pointers.data()))
    return *done;
  // Lack of memory is caused by the input and is not a bug.
  try {
    return line.run(argv);
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
