// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/trocar_mesh.h"

#include <oneapi/tbb/version.h>
#include <cstdio>
#include <map>
#include <new>
#include <opencv2/core/version.hpp>
#include <string>
#include <vector>

#include "formats/base/command_line.h"
#include "pipeline/program/commands.h"
#include "pipeline/read/dicom/dicom_parse.h"
#include "pipeline/read/parallel_for.h"

namespace trocar::pipeline {
namespace {

std::string version() {
  return "trocar-mesh " TROCAR_VERSION " (OpenCV " CV_VERSION ", oneTBB " TBB_VERSION_STRING ", " +
         command_line_library() + ")";
}

struct MeshCommandLine {
  CLI::App app{
      "Makes an asset, a 3D file (.glb), from a CT scan. The asset has one flat triangle mesh for\n"
      "each slice and material, such as bone. INPUT is a folder with a DICOM study, a NIfTI or\n"
      "NRRD file (.nii, .nii.gz, .nrrd, .nhdr), a folder of images, or a list of images.",
      kProgram};
  Arguments mesh, preview;
  std::map<const CLI::App*, Command> commands;

  MeshCommandLine() {
    app.get_formatter()->column_width(34);
    add_help(app, version());
    add_mesh_options(app, mesh);
    commands[nullptr] = [this] {
      const std::string input = mesh.inputs.empty() ? "" : mesh.inputs[0].string();
      if (const auto ok = check_command(app, input); !ok) return fail(ok.error());
      return mesh.explain ? explain(mesh.preset) : run_mesh(mesh);
    };
    const auto add = [this](const char* name, const char* help, const auto& declare) {
      CLI::App* const command = app.add_subcommand(name, help);
      commands[command] = declare(*command);
    };
    add("list", "list the scans in a folder", add_list);
    add("preview", "draw the slices that a run with the same options would mesh; make no asset",
        [this](CLI::App& command) -> Command {
          add_preview_options(command, preview);
          return
              [this] { return preview.explain ? explain(preview.preset) : run_preview(preview); };
        });
    add("verify", "check that the meshes in an asset are valid", add_verify);
    add("info", "show what is in an asset", add_info);
    add("export", "write the slices of an asset as .poly, .obj and .svg, or its surface",
        add_export);
    add("batch", "make the assets of the stale (new or changed) scans of a collection", add_batch);
    add("review",
        "show all assets in a store (the folder that batch writes), or compare two stores",
        add_review);
    // A command takes the footer that is set when it is added. This one is for the program alone.
    app.footer(
        "trocar-mesh COMMAND --help describes a command and its options.\n"
        "Exit codes: 0 done; 2 wrong usage; 3 input refused (batch: also if a scan failed);\n"
        "4 output not written, or interrupted; 1 an internal error.");
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
  const std::vector<std::string> words(argv, argv + argc);
  if (const auto done = parse_or_end(program.app, with_preset_options(words))) return *done;
  program.mesh.of_preset = program.preview.of_preset = added_by_preset(words);
  // Lack of memory is caused by the input and is not a bug.
  try {
    return program.commands.at(given_command(program.app))();
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
