// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/preview_command.h"

#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/info.h>

#include <cstdio>
#include <string>
#include <system_error>

#include "formats/base/file_io.h"
#include "formats/base/program.h"
#include "formats/base/terminal_text.h"
#include "pipeline/preview/preview.h"
#include "pipeline/preview/preview_page.h"
#include "pipeline/preview/preview_sheet.h"
#include "pipeline/preview/preview_text.h"
#include "pipeline/preview/sheet_png.h"
#include "pipeline/program/mesh_scan.h"
#include "pipeline/program/messages.h"
#include "pipeline/scan/small_pixels.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;

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

}  // namespace

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

}  // namespace trocar::pipeline
