// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/verify_command.h"

#include <cstdio>
#include <iostream>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>

#include "formats/asset/asset.h"
#include "formats/asset/deidentification.h"
#include "formats/base/file_io.h"
#include "formats/base/json_text.h"
#include "pipeline/program/messages.h"
#include "pipeline/verify/cgal_verification.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// Verifies an asset and returns the number of its slices.
Result<std::size_t> verify(const fs::path& file, const VerifyArguments& a) {
  const auto bytes = read_file(file, std::numeric_limits<std::uint32_t>::max());
  if (!bytes) return bytes.error();
  const auto asset = decode_asset(*bytes, file.string());
  if (!asset) return asset.error();
  if (auto ok = verify_asset(*asset, file.string()); !ok) return ok.error();
  if (a.deidentified) {
    if (auto ok = check_deidentified_asset(*bytes, file.string()); !ok) return ok.error();
  }
  if (a.with_cgal) {
    if (auto ok = confirm_by_cgal(*asset, file.string()); !ok) return ok.error();
  }
  return slice_count(*asset);
}

}  // namespace

void add_verify_options(CLI::App& app, VerifyArguments& a) {
  app.add_option("ASSET", a.assets, "one or more assets (.glb)")->required();
  app.add_flag(
      "--private", a.deidentified,
      "also refuse an asset if a text in it may identify the patient, or if it has HU around\n"
      "the material (--context), which can show a face");
  app.add_flag("--independent", a.with_cgal,
               "also compare each slice with the triangulation of the library CGAL");
  app.add_flag("--json", a.as_json, "print JSON");
}

int run_verify(const VerifyArguments& a) {
  int code = 0;
  json out = json::array();
  for (const fs::path& file : a.assets) {
    const auto slices = verify(file, a);
    out.push_back({{"file", file.string()}, {"valid", static_cast<bool>(slices)}});
    if (a.with_cgal) out.back()["independent"] = static_cast<bool>(slices);
    if (a.deidentified) out.back()["private"] = static_cast<bool>(slices);
    if (!slices) {
      out.back()["reason"] = slices.error().message;
      const int failed = fail(slices.error());
      if (code == 0) code = failed;
    } else if (!a.as_json) {
      std::printf("%s: valid, %zu slices%s%s\n", file.c_str(), *slices,
                  a.deidentified ? ", private" : "", a.with_cgal ? ", confirmed by CGAL" : "");
    }
  }
  if (a.as_json) std::cout << json_text(out.size() == 1 ? out[0] : out, 1) << '\n';
  return code;
}

}  // namespace trocar::pipeline
