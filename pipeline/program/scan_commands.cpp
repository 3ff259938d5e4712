// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/commands.h"

#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/info.h>
#include <unistd.h>
#include <algorithm>
#include <cstdio>
#include <system_error>

#include "formats/base/command_line.h"
#include "formats/base/files.h"
#include "formats/base/json.h"
#include "formats/base/text.h"
#include "pipeline/bake/report.h"
#include "pipeline/batch/review.h"
#include "pipeline/open/scan_folder.h"
#include "pipeline/preview/preview.h"
#include "pipeline/preview/preview_sheet.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

struct ListArguments {
  std::filesystem::path folder;
  std::filesystem::path output;                 // file for the collection; empty: standard output
  bool as_json = false, as_collection = false;  // as_collection: print a collection (--manifest)
};

struct ReviewArguments {
  std::filesystem::path store, page, against;  // against: store to compare with, or empty
  bool as_json = false, quiet = false;
};

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

// Refuses to overwrite a picture that is not a sheet (with `-o *.png` the shell inserts the name of
// a slice as the output), and refuses to add a sheet to the scan's images.
Result<void> check_sheet(const Arguments& a, const std::vector<fs::path>& read) {
  const std::string given = "-o " + a.output.string() + ": ";
  const std::string ending = ending_of(a.output);
  if (ending != ".png" && ending != ".html")
    return usage(given + "a preview is a .png or .html; an asset is made without preview");
  const OutputFile outputs[] = {{"-o", a.output}};
  if (auto ok = trocar::check_outputs(outputs, read); !ok) return ok;
  std::error_code ignored;
  if (ending == ".png" && fs::exists(a.output, ignored) && !is_sheet(a.output))
    return usage(given + "would write over a picture that is no preview");
  if (ending != ".png" || read.empty() || ending_of(read[0]) != ".png") return {};
  const fs::path folder = a.output.has_parent_path() ? a.output.parent_path() : ".";
  const fs::path scan = read[0].has_parent_path() ? read[0].parent_path() : ".";
  if (fs::equivalent(folder, scan, ignored))
    return usage(given + "would become one of the scan's images; give another folder");
  return {};
}

void print_summary(const ReviewArguments& a, const json& numbers) {
  print(stdout,
        "%s: %zu scans: %zu assets, %zu failed, %zu damaged, %zu with warnings; %zu pages\n",
        a.page, numbers["scans"].get<std::size_t>(), numbers["done"].get<std::size_t>(),
        numbers["failed"].get<std::size_t>(), numbers["damaged"].get<std::size_t>(),
        numbers["warned"].get<std::size_t>(), numbers["pages"].size());
  if (!numbers.contains("differences")) return;
  const json& differences = numbers["differences"];
  print(stdout, "against %s: %zu the same, %zu differ\n", a.against,
        numbers["same"].get<std::size_t>(), differences.size());
  constexpr std::size_t kMax = 10;
  for (std::size_t k = 0; k < std::min(kMax, differences.size()); ++k) {
    const json& d = differences[k];
    print(stdout, "  %-9s %s", d["kind"].get<std::string>(), d["scan"].get<std::string>());
    if (d.contains("hausdorff_mm")) {
      std::printf(": %.3f mm, area %+.2f mm2, %+lld triangles, %+lld bytes",
                  d["hausdorff_mm"].get<double>(),
                  d["area_mm2"].get<double>() - d["area_mm2_before"].get<double>(),
                  d["triangles"].get<long long>() - d["triangles_before"].get<long long>(),
                  d["bytes"].get<long long>() - d["bytes_before"].get<long long>());
    }
    std::printf("\n");
  }
  if (differences.size() > kMax)
    std::printf("  and %zu more: see the page\n", differences.size() - kMax);
}

// Prints the scans and returns the exit code, which is 3 if none of them can be meshed.
int run_list(const ListArguments& a) {
  const OutputFile outputs[] = {{"-o", a.output}};
  if (auto ok = check_outputs(outputs, {}); !ok) return fail(ok.error());
  std::vector<Warning> warnings;
  const auto scans = list_scans(a.folder, warnings);
  if (!scans) return fail(scans.error());
  if (a.as_collection) {
    const std::string text = collection_of(*scans, a, warnings);
    if (a.output.empty())
      print_lines(stdout, text);
    else if (auto ok = write_file_atomically(a.output, text); !ok)
      return fail(ok.error());
  } else {
    print_lines(stdout,
                a.as_json ? json_text(*scans, 1) + "\n" : scan_table(*scans, a.folder.string()));
  }
  for (const Warning& w : warnings)
    print_warning(w);
  if (auto ok = check_any_usable(*scans, a.folder.string()); !ok) return fail(ok.error());
  return 0;
}

// Writes the pages and returns the exit code: 0, even if assets are damaged or differ from those
// in `against`; 2 for wrong options; 3 if a folder is not a store, or if `store` has no scans; 4
// if a page could not be written or a signal interrupted the review.
int run_review(const ReviewArguments& a) {
  if (a.page.extension() != ".html")
    return fail(usage("-o " + a.page.string() + ": a review is a .html"));
  const OutputFile outputs[] = {{"-o", a.page}};
  if (auto ok = check_outputs(outputs, {}); !ok) return fail(ok.error());
  stop_on_signals();
  ReviewOptions options{a.store, a.against, a.page, &stop_requested, {}};
  if (!a.quiet && ::isatty(STDERR_FILENO) != 0) {
    options.progress = [](std::size_t done, std::size_t total) {
      std::fprintf(stderr, "\r  %zu of %zu scans%s", done, total, done == total ? "\n" : "");
    };
  }
  const auto numbers = write_review(options);
  if (!numbers) return fail(numbers.error());
  if (a.as_json)
    print_lines(stdout, json_text(*numbers, 1) + "\n");
  else if (!a.quiet)
    print_summary(a, *numbers);
  return 0;
}

}  // namespace

Command add_list(CLI::App& command) {
  const auto made = std::make_shared<ListArguments>();
  ListArguments& a = *made;
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
  return [made] { return run_list(*made); };
}

int run_preview(Arguments a) {
  if (a.inputs.empty()) return fail(usage("no INPUT given; see trocar-mesh preview --help"));
  if (a.output.empty()) return fail(usage("no output given: -o SHEET.png or -o SHEET.html"));
  if (auto ok = check_sheet(a, a.inputs); !ok) return fail(ok.error());
  if (auto ok = complete(a); !ok) return fail(ok.error());
  stop_on_signals();
  a.stack.stop = &stop_requested;
  a.stack.axis = a.open.axis;
  const int threads =
      a.stack.threads > 0 ? a.stack.threads : oneapi::tbb::info::default_concurrency();
  const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism,
                                          static_cast<std::size_t>(threads));
  const auto scan = open_scan(a);
  if (!scan) return fail(scan.error());
  const std::unique_ptr<SliceStack>& stack = scan->labels;
  if (auto ok = check_sheet(a, files_read(a, *scan)); !ok) return fail(ok.error());
  if (auto ok = check_input(a, *stack); !ok) return fail(ok.error());
  follow_small_pixels(*stack, a.stack);
  const auto made = make_preview(*stack, a.stack, a.count);
  if (!made) return fail(made.error());
  const SheetText text{sheet_title(*stack, *made),
                       options_text(a.stack, a.open, stack->pixel_unit())};
  const Sheet sheet = draw_sheet(*made, text);
  const auto png = png_of(sheet.picture);
  if (!png) return fail(png.error());
  const auto ok = ending_of(a.output) == ".png"
                      ? write_file_atomically(a.output, *png)
                      : write_file_atomically(
                            a.output, preview_page(*made, sheet, text, input_kind(*stack), *png));
  if (!ok) return fail(ok.error());
  if (a.quiet) return 0;
  for (const Warning& w : made->warnings)
    print_warning(w);
  print(stdout, "%s: %zu of %d slices, %d x %d pixels\n", a.output, made->shown.size(),
        made->slices, sheet.picture.width, sheet.picture.height);
  return 0;
}

Command add_review(CLI::App& command) {
  const auto made = std::make_shared<ReviewArguments>();
  ReviewArguments& a = *made;
  command
      .add_option("STORE", a.store,
                  "the store, a folder in which trocar-mesh batch keeps its results")
      ->required();
  command
      .add_option("-o,--output", a.page,
                  "page to write (NAME.html); with more than 240 scans also NAME-2.html and so on")
      ->type_name("FILE")
      ->required();
  command
      .add_option(
          "--against", a.against,
          "an older store: show how the scans of STORE differ from those of the older store, in "
          "this\n"
          "order: damaged, failed, gone (only in the older store), changed, repaired and new scans")
      ->type_name("STORE");
  command.add_flag("--json", a.as_json, "print the summary as JSON");
  command.add_flag("--quiet", a.quiet, "print errors only");
  return [made] { return run_review(*made); };
}

}  // namespace trocar::pipeline
