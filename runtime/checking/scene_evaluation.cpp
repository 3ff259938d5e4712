// SPDX-License-Identifier: Apache-2.0
#include "runtime/checking/scene_evaluation.h"

#include <algorithm>
#include <utility>

#include "formats/base/text_line.h"
#include "runtime/devices/scene_hand.h"
#include "runtime/session/tick_rate.h"

namespace trocar::runtime {
namespace {

SheetView view_sheet(const SceneEvaluation& e, std::size_t index) {
  const ContactModel contact;
  const Sheet& sheet = *e.sheets[index];
  const std::vector<SheetCrossing> crossings = sheet_crossings(e.path, e.tool, sheet);
  const auto touches = [&](const SheetCrossing& each) {
    return each.t_s <= e.let_go_s && each.coverage >= contact.min_coverage;
  };
  SheetView view;
  if (crossings.empty()) {
    const double begin_m = e.path.keyframes.front().T_device_tool.p_m.z();
    view.miss = begin_m < sheet.z_m ? Miss::kBeginsBelow : Miss::kStaysAbove;
  } else {
    const auto first = std::find_if(crossings.begin(), crossings.end(), touches);
    view.crossing = first == crossings.end() ? crossings.front() : *first;
    view.miss = first != crossings.end()          ? Miss::kHeld
                : view.crossing->t_s > e.end_s    ? Miss::kTooLate
                : view.crossing->t_s > e.let_go_s ? Miss::kLetGo
                                                  : Miss::kMissed;
  }
  const bool touched = e.dry_run && e.dry_run->sheets[index].touched;
  // After a fault, or after the end of the dry run, only the path shows whether the
  // slice is touched.
  const bool unknown =
      view.miss == Miss::kHeld && (e.has_fault() || view.crossing->t_s >= e.dry_run_end_s());
  if (touched || unknown) view.miss = Miss::kTouched;
  return view;
}

}  // namespace

Result<SceneEvaluation> evaluate_scene(const Scene& scene, const DeviceToCheck& device,
                                       const std::vector<std::unique_ptr<const Sheet>>& sheets,
                                       const SessionOptions& options) {
  SceneEvaluation e{
      .scene = scene, .device = device.specification, .sheets = sheets, .options = options};
  e.tool = make_tool(scene.tool);
  e.path = hand_trajectory(scene);
  e.end_s =
      static_cast<double>(tick_count(options.duration_s, options.rate_Hz) - 1) / options.rate_Hz;
  e.let_go_s = std::min(e.end_s, scene.hand.let_go_t_s.value_or(e.end_s));
  e.report = evaluate_path(e.path, e.device, options.limits, e.tool, 0, e.let_go_s);
  if (scene.hand.live) {
    e.views.resize(sheets.size());
    return e;
  }
  const auto first = device.simulate(scene);
  if (!first && first.error().code != ExitCode::kRefused) return first.error();
  if (first) {  // otherwise the session cannot start
    Result<DryRun> dry_run = run_dry_run(scene, device, sheets, options);
    if (!dry_run) return dry_run.error();
    e.dry_run = std::move(*dry_run);
    if (scene.force_law.kind == ForceLawKind::kCutting) {
      auto let_go = try_letting_go(scene, device, sheets, options, *e.dry_run);
      if (!let_go) return let_go.error();
      e.let_go = *let_go;
    }
  }
  for (std::size_t i = 0; i < sheets.size(); ++i)
    e.views.push_back(view_sheet(e, i));
  return e;
}

std::optional<double> rendered_threshold_N(const SceneEvaluation& e, std::size_t index) {
  const Tissue& tissue = e.sheets[index]->tissue;
  if (e.scene.force_law.kind == ForceLawKind::kCutting && tissue.cut) return std::nullopt;
  return e.scene.force_law.force_scale * tissue.threshold_N;
}

std::string describe_rectangle(const WorkspaceRectangle& rectangle) {
  return text_line("x %.3f to %.3f, y %.3f to %.3f m", rectangle.min_m.x(), rectangle.max_m.x(),
                   rectangle.min_m.y(), rectangle.max_m.y());
}

}  // namespace trocar::runtime
