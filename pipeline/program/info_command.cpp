// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/info_command.h"

#include <cstdio>
#include <system_error>

#include "formats/base/command_line.h"
#include "formats/base/json_text.h"
#include "formats/base/terminal_text.h"
#include "pipeline/program/asset_description.h"
#include "pipeline/program/messages.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// The description as a table.
void print_description(const fs::path& file, const json& out) {
  const bool several = out["materials"].size() > 1;
  print(
      stdout,
      "%s\n  written by %s\n  lattice step 2^-%d mm, %zu triangles, %zu bytes\n  parameters %s\n"
      "  u (along a row) and v (along a column) count from the centre of the first pixel\n\n "
      " slice%s      z mm    rings  vertices  triangles   area mm2  box u mm, v mm                 "
      "     centroid u, v mm  mean HU\n",
      file, out["generator"].get<std::string>(), out["lattice_bits"].get<int>(),
      out["triangles"].get<std::size_t>(), out["bytes"].get<std::size_t>(),
      json_text(out["parameters"]), several ? " material" : "");
  for (const json& s : out["slices"]) {
    std::printf("  %5d", s["index"].get<int>());
    if (several) std::printf(" %8d", s["material"].get<int>());
    std::printf(" %9.3f %8zu %9zu %10zu %10.2f", s["z_mm"].get<double>(),
                s["rings"].get<std::size_t>(), s["vertices"].get<std::size_t>(),
                s["triangles"].get<std::size_t>(), s["area_mm2"].get<double>());
    if (s["centroid_mm"].is_null()) {
      std::printf("  no material\n");
      continue;
    }
    const auto box = s["box_mm"].get<std::array<std::array<double, 2>, 2>>();
    const auto middle = s["centroid_mm"].get<std::array<double, 2>>();
    std::printf("  %7.1f to %6.1f, %6.1f to %6.1f  %7.1f, %7.1f", box[0][0], box[1][0], box[0][1],
                box[1][1], middle[0], middle[1]);
    if (s["mean_hu"].is_null()) {
      std::printf("        -\n");
    } else {
      std::printf(" %8.0f\n", s["mean_hu"].get<double>());
    }
  }
  if (several) {
    std::printf("\n  material   area mm2\n");
    for (std::size_t m = 0; m < out["materials"].size(); ++m) {
      const json& material = out["materials"][m];
      print(stdout, "  %8zu %10.2f  %s\n", m, material["area_mm2"].get<double>(),
            json_text(material["name"]));
    }
  }
  for (const json& volume : out.value("hu_volumes", json::array())) {
    const bool is_context = volume["covers"] == "everything";
    print(stdout, "  HU of %s: %zu planes, a sample every %.2f mm, steps of %d HU%s\n",
          is_context ? "everything around" : "the material and a margin",
          volume["planes"].get<std::size_t>(), volume["pitch_mm"][0].get<double>(),
          volume["step_hu"].get<int>(), is_context ? "; a head's can show a face" : "");
  }
  for (const json& s : out["surfaces"]) {
    std::printf("  surface of material %d: %zu triangles, 99 %% of it within %.3f mm\n",
                s["material"].get<int>(), s["triangles"].get<std::size_t>(),
                s["distance_p99_mm"].get<double>());
  }
}

}  // namespace

void add_info_options(CLI::App& command, InfoArguments& a) {
  command.add_option("ASSET", a.asset, "the asset (.glb)")->required();
  command.add_flag("--json", a.as_json, "print JSON");
}

int run_info(const InfoArguments& a) {
  const auto asset = read_asset(a.asset);
  if (!asset) return fail(asset.error());
  std::error_code error;
  const json out = describe_asset(*asset, fs::file_size(a.asset, error));
  if (a.as_json) {
    print_lines(stdout, json_text(out, 1) + "\n");
  } else {
    print_description(a.asset, out);
  }
  return 0;
}

}  // namespace trocar::pipeline
