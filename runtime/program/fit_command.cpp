// SPDX-License-Identifier: Apache-2.0
#include "runtime/program/fit_command.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <numbers>

#include "formats/base/file_io.h"
#include "formats/base/terminal_text.h"
#include "formats/session/scene.h"
#include "runtime/bone_cutting/material/bone_volume.h"
#include "runtime/bone_cutting/material/tool_in_tissue.h"
#include "runtime/calibration/curve_fit.h"
#include "runtime/calibration/fit_page.h"
#include "runtime/calibration/fitted_tissue.h"
#include "runtime/calibration/force_curve.h"
#include "runtime/program/session_messages.h"

namespace trocar::runtime {
namespace {

/// The tool of the options, as a polygon with the area of the disc. Errors: (usage) options are missing or exclude
/// each other.
Result<SceneTool> tool_of(const FitArguments& a) {
  const bool has_options =
      a.gauge || a.diameter_mm || a.bore_mm || a.half_angle_deg || !a.tip.empty();
  if (!a.tool.empty()) {
    if (has_options) return usage("--tool: states the tool; leave its other options out");
    return read_fit_tool(a.tool);
  }
  if (!a.gauge && !a.diameter_mm)
    return usage("fit: needs the tool: --tool, --gauge or --diameter");
  if (a.gauge && a.diameter_mm) return usage("--gauge: states the diameter; leave --diameter out");
  double radius_m = a.diameter_mm.value_or(0) * 0.5e-3;
  if (a.gauge) {
    const std::optional<double> known = gauge_radius_m(*a.gauge);
    if (!known)
      return usage("--gauge " + std::to_string(*a.gauge) + ": is not known; give --diameter in mm");
    radius_m = *known;
  }
  if (a.half_angle_deg && a.tip.empty())
    return usage("--half-angle: needs --tip, because a flat tip has no such angle");
  SceneTool tool;
  tool.kind = a.tip;
  tool.half_angle_deg = a.half_angle_deg.value_or(SceneTool::usual_half_angle_deg(a.tip));
  tool.inner_radius_m = a.bore_mm.value_or(0) * 0.5e-3;
  tool.sides = kMaxToolSides;
  const double part = 2 * std::numbers::pi / tool.sides;
  tool.radius_m = radius_m * std::sqrt(part / std::sin(part));
  if (const Result<ToolShape> shape = tool_shape(tool); !shape) return usage(shape.error().message);
  return tool;
}

}  // namespace

void declare_fit(CommandLine& line, FitArguments& a) {
  const Command fit =
      line.add_command(kFit, "makes a tissue for scenes from a measured curve of force over depth");
  fit.option("CURVE", a.curve,
             "the curve of an insertion, with or without the withdrawal after it: CSV with the "
             "columns\n"
             "depth_mm and force_N, and optionally speed_mm_per_s and time_s")
      .required();
  fit.option("-o,--output", a.output,
             "the tissue to write, JSON, for use as the \"tissue\" of a scene")
      .with_form("FILE")
      .required();
  fit.option("--page", a.page,
             "write a page with the fitted curve and its deviations from the measured one: HTML")
      .with_form("FILE");
  fit.option("--tool", a.tool, "JSON file with the tool: a scene, or its \"tool\" alone")
      .with_form("FILE");
  fit.option("--gauge", a.gauge,
             "gauge number of the needle, which states its diameter; instead of --tool");
  fit.option("--diameter", a.diameter_mm, "diameter of the tool in mm, instead of --tool")
      .within(0.2, 50.0);
  fit.option("--bore", a.bore_mm, "inner diameter of a hollow tool in mm").within(0.0, 50.0);
  fit.option("--tip", a.tip,
             "kind of tip: needle-bevel, needle-conical, needle-diamond, trocar or\n"
             "jamshidi (default: a flat tip)")
      .with_form("TIP");
  fit.option("--half-angle", a.half_angle_deg,
             "angle between the axis and the faces of the tip of --tip, degrees (default: 30;\n"
             "a jamshidi must have 90)")
      .within(3.0, 90.0);
  fit.flag("--quiet", a.quiet, "print errors only");
}

int run_fit(const FitArguments& a) {
  const OutputFile outputs[] = {{"-o", a.output}, {"--page", a.page}};
  const std::filesystem::path inputs[] = {a.curve, a.tool};
  if (const auto good = check_outputs(outputs, inputs); !good) return fail(good.error());
  const Result<SceneTool> tool = tool_of(a);
  if (!tool) return fail(tool.error());
  const Result<ToolShape> shape = tool_shape(*tool);
  if (!shape) return fail(shape.error());
  const Result<ForceCurve> curve = read_force_curve(a.curve);
  if (!curve) return fail(curve.error());
  const Result<CurveFit> fit = fit_curve(*curve, 2e3 * shape->outer_radius_m);
  if (!fit) return fail(refused(a.curve + ": " + fit.error().message));
  const Result<std::string> tissue = fitted_tissue(*fit, *tool);
  if (!tissue) return fail(refused(a.curve + ": " + tissue.error().message));
  if (const auto written = write_file_atomically(a.output, *tissue); !written)
    return fail(written.error());
  if (!a.page.empty()) {
    const std::string page = fit_page(*fit, without_folder(a.curve), *tissue);
    if (const auto written = write_file_atomically(a.page, page); !written)
      return fail(written.error());
  }
  if (a.quiet) return 0;
  print_lines(stdout, fit_text(*fit));
  if (curve->high_speed_mm_per_s > 1.5 * curve->low_speed_mm_per_s)
    std::fprintf(stderr,
                 "trocar-run: note: the speed varies from %.3g to %.3g mm/s, and the fit takes the "
                 "force as the same "
                 "at any speed\n",
                 curve->low_speed_mm_per_s, curve->high_speed_mm_per_s);
  return 0;
}

}  // namespace trocar::runtime
