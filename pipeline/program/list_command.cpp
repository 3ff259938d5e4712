// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/list_command.h"

#include <system_error>
#include <vector>

#include "formats/base/json_text.h"
#include "formats/base/terminal_text.h"
#include "pipeline/farm/collection.h"
#include "pipeline/open/scan_list.h"
#include "pipeline/program/messages.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// An initial collection of the scans that `list` found in `folder`, as text. Adds warnings about
// images, because their parameters are missing, and about scans that cannot be used.
std::string collection_of(const json& list, const fs::path& folder,
                          std::vector<Warning>& warnings) {
  std::error_code error;
  const json collection = farm::first_collection(list, folder, fs::current_path(error));
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

void add_list_options(const Command& command, ListArguments& a) {
  command.option("FOLDER", a.folder, "folder to search for scans, with its subfolders").required();
  const Option as_json = command.flag("--json", a.as_json, "print JSON");
  command
      .flag("--manifest", a.as_collection,
            "print the scans as a collection, the JSON file that batch reads; paths are relative\n"
            "to the current folder, so save it there")
      .excludes(as_json);
}

int run_list(const ListArguments& a) {
  std::vector<Warning> warnings;
  const auto scans = list_scans(a.folder, warnings);
  if (!scans) return fail(scans.error());
  if (a.as_collection) {
    print_lines(stdout, collection_of(*scans, a.folder, warnings));
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
