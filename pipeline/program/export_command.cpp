// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/export_command.h"

#include <cstdio>
#include <string>

#include "formats/base/command_line.h"
#include "formats/base/program.h"
#include "formats/base/terminal_text.h"
#include "pipeline/program/asset_export.h"
#include "pipeline/program/messages.h"

namespace trocar::pipeline {

void add_export_options(CLI::App& command, ExportArguments& a) {
  command.add_option("ASSET", a.asset, "the asset (.glb)")->required();
  command.add_option("-o,--output", a.folder, "folder to write to")
      ->type_name("FOLDER")
      ->required();
  command.add_flag("--surface", a.surface,
                   "write the asset's closed surface instead, as .stl, .ply and .obj");
}

int run_export(const ExportArguments& a) {
  const std::filesystem::path &file = a.asset, &folder = a.folder;
  const auto asset = read_asset(file);
  if (!asset) return fail(asset.error());
  // Only a valid asset is exported, because other programs may not detect errors.
  if (const auto proved = verify_asset(*asset, file.string()); !proved) return fail(proved.error());
  stop_on_signals();
  if (a.surface) {
    const auto done = export_surfaces(*asset, folder, &stop_requested);
    if (done) return 0;
    const bool is_file = done.error().code == ExitCode::kRefused;
    return fail({done.error().code, (is_file ? file.string() + ": " : "") + done.error().message});
  }
  const auto others = export_asset(*asset, folder, &stop_requested);
  if (!others) return fail(others.error());
  if (!others->empty()) {
    print(
        stderr, "%s: warning: %s: still holds %s%s of another export\n", kProgram, folder.string(),
        others->front(),
        others->size() == 1 ? "" : (" and " + std::to_string(others->size() - 1) + " more files"));
  }
  return 0;
}

}  // namespace trocar::pipeline
