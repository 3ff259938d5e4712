// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/verify_command.h"

#include <cstdio>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>

#include "formats/asset/asset.h"
#include "formats/asset/deidentification.h"
#include "formats/base/command_line.h"
#include "formats/base/file_io.h"
#include "formats/base/json_text.h"
#include "formats/base/terminal_text.h"
#include "pipeline/program/messages.h"
#include "pipeline/verify/cgal_verification.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// The results of the checks of an asset. The last two checks are made only if they are wanted and
// the asset is valid.
struct Checked {
  Result<void> valid, deidentified, confirmed;
  std::size_t slices = 0;

  // The first failure, or null.
  const Error* failure() const {
    for (const Result<void>* one : {&valid, &deidentified, &confirmed})
      if (!*one) return &one->error();
    return nullptr;
  }
};

Checked check(const fs::path& file, const VerifyArguments& a) {
  Checked out;
  const auto bytes = read_file(file, std::numeric_limits<std::uint32_t>::max());
  if (!bytes) return out.valid = bytes.error(), out;
  const auto asset = decode_asset(*bytes, file.string());
  if (!asset) return out.valid = asset.error(), out;
  out.valid = verify_asset(*asset, file.string());
  if (!out.valid) return out;
  if (a.deidentified) out.deidentified = check_deidentified_asset(*bytes, file.string());
  if (a.with_cgal) out.confirmed = confirm_by_cgal(*asset, file.string());
  out.slices = slice_count(*asset);
  return out;
}

}  // namespace

void add_verify_options(CLI::App& command, VerifyArguments& a) {
  command.add_option("ASSET", a.assets, "one or more assets (.glb)")->required();
  command.add_flag(
      "--private", a.deidentified,
      "also refuse an asset if a text in it may identify the patient, or if it has HU around\n"
      "the material (--context), which can show a face");
  command.add_flag("--independent", a.with_cgal,
                   "also compare each slice with the triangulation of the library CGAL");
  command.add_flag("--json", a.as_json, "print JSON");
}

int run_verify(const VerifyArguments& a) {
  int code = 0;
  json out = json::array();
  for (const fs::path& file : a.assets) {
    const Checked checked = check(file, a);
    const bool is_valid = static_cast<bool>(checked.valid);
    out.push_back({{"file", file.string()}, {"valid", is_valid}});
    if (a.with_cgal) out.back()["independent"] = is_valid && checked.confirmed;
    if (a.deidentified) out.back()["private"] = is_valid && checked.deidentified;
    if (const Error* const failure = checked.failure()) {
      out.back()["reason"] = failure->message;
      const int failed = fail(*failure);
      if (code == 0) code = failed;
    } else if (!a.as_json) {
      print(stdout, "%s: valid, %zu slices%s%s\n", file, checked.slices,
            a.deidentified ? ", private" : "", a.with_cgal ? ", confirmed by CGAL" : "");
    }
  }
  if (a.as_json) print_lines(stdout, json_text(out.size() == 1 ? out[0] : out, 1) + "\n");
  return code;
}

}  // namespace trocar::pipeline
