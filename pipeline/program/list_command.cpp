// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/list_command.h"

#include <system_error>
#include <vector>

#include "formats/base/command_line.h"
#include "formats/base/file_io.h"
#include "formats/base/json_text.h"
#include "formats/base/terminal_text.h"
#include "pipeline/farm/collection.h"
#include "pipeline/open/scan_list.h"
#include "pipeline/program/messages.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// An initial collection of the scans that `list` found, as text. Adds warnings about images, because
// their parameters are missing, and about scans that cannot be used.
std::string collection_of(const json& list, const ListArguments& a,
                          std::vector<Warning>& warnings) {
  std::error_code error;
  // Where standard output is saved is not known, so its paths are absolute.
  const fs::path beside =
      a.output.empty() ? fs::path() : fs::absolute(a.output, error).parent_path();
  std::vector<std::string> left_out;
  const json collection = farm::first_collection(list, a.folder, beside, &left_out);
  for (const std::string& path : left_out)
    warnings.push_back({"not_in_collection", path,
                        "its path has control characters or is not UTF-8, which a collection "
                        "cannot state; rename it"});
  for (const json& scan : list["scans"]) {
    if (scan["usable"] == false && !scan.value("localiser", false))
      warnings.push_back({"not_in_collection", scan["path"].get<std::string>(),
                          "cannot be used: " + scan["problem"].get<std::string>()});
    if (scan["kind"] == "images" && scan["usable"] == true)
      warnings.push_back({"needs_parameters", scan["path"].get<std::string>(),
                          "images need the parameters spacing, and equalize or threshold"});
  }
  return json_text(collection, 1) + "\n";
}

}  // namespace

void add_list_options(CLI::App& command, ListArguments& a) {
  command.add_option("FOLDER", a.folder, "folder to search for scans, with its subfolders")
      ->required();
  CLI::Option* const as_json = command.add_flag("--json", a.as_json, "print JSON");
  CLI::Option* const manifest =
      command
          .add_flag("--manifest", a.as_collection,
                    "print the scans as a collection, the JSON file that batch "
                    "reads, with absolute paths")
          ->excludes(as_json);
  command
      .add_option(
          "-o,--output", a.output,
          "with --manifest: write the collection to this file, with paths relative to its folder")
      ->type_name("FILE")
      ->needs(manifest);
}

int run_list(const ListArguments& a) {
  const OutputFile outputs[] = {{"-o", a.output}};
  if (auto ok = check_outputs(outputs, {}); !ok) return fail(ok.error());
  std::vector<Warning> warnings;
  const auto scans = list_scans(a.folder, warnings);
  if (!scans) return fail(scans.error());
  if (a.as_collection) {
    const std::string text = collection_of(*scans, a, warnings);
    if (a.output.empty()) {
      print_lines(stdout, text);
    } else if (auto ok = write_file_atomically(a.output, text); !ok) {
      return fail(ok.error());
    }
  } else {
    print_lines(stdout,
                a.as_json ? json_text(*scans, 1) + "\n" : scan_table(*scans, a.folder.string()));
  }
  for (const Warning& w : warnings)
    print_warning(w);
  if (auto ok = check_any_usable(*scans, a.folder.string()); !ok) return fail(ok.error());
  return 0;
}

}  // namespace trocar::pipeline
