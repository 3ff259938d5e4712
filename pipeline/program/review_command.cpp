// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/review_command.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <string>

#include "formats/base/file_io.h"
#include "formats/base/json_text.h"
#include "formats/base/program.h"
#include "formats/base/terminal_text.h"
#include "pipeline/program/messages.h"
#include "pipeline/review/review.h"

namespace trocar::pipeline {
namespace {

using nlohmann::json;

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

}  // namespace

void add_review_options(const Command& command, ReviewArguments& a) {
  command
      .option("STORE", a.store, "the store, a folder in which trocar-mesh batch keeps its results")
      .required();
  command
      .option("-o,--output", a.page,
              "page to write (NAME.html); with more than 240 scans also NAME-2.html and so on")
      .with_form("FILE")
      .required();
  command
      .option(
          "--against", a.against,
          "an older store: show how the scans of STORE differ from those of the older store, in "
          "this\n"
          "order: damaged, failed, gone (only in the older store), changed, repaired and new scans")
      .with_form("STORE");
  command.flag("--json", a.as_json, "print the summary as JSON");
  command.flag("--quiet", a.quiet, "print errors only");
}

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
  if (a.as_json) {
    print_lines(stdout, json_text(*numbers, 1) + "\n");
  } else if (!a.quiet) {
    print_summary(a, *numbers);
  }
  return 0;
}

}  // namespace trocar::pipeline
