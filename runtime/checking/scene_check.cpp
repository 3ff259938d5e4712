// SPDX-License-Identifier: Apache-2.0
#include "runtime/checking/scene_check.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>

#include "formats/base/text_line.h"
#include "runtime/checking/scene_evaluation.h"
#include "runtime/checking/scene_warnings.h"

namespace trocar::runtime {
namespace {

constexpr std::size_t kMaxListedHeights = 5;

std::string describe_path(const SceneEvaluation& e) {
  const PathReport& r = e.report;
  std::string out = text_line(
      "path       %.6g s, tip x %.4f to %.4f, y %.4f to %.4f, z %.4f to %.4f m; speed at most %.3g "
      "of %.4g m/s\n",
      std::min(e.path.keyframes.back().t_s, e.options.duration_s), r.tip_min_m.x(), r.tip_max_m.x(),
      r.tip_min_m.y(), r.tip_max_m.y(), r.tip_min_m.z(), r.tip_max_m.z(), r.speed_max_m_per_s,
      e.options.limits.speed_max_m_per_s);
  out += text_line(
      "           plate %.1f mm %s the workspace's box, tilted by at most %.1f of %.1f "
      "deg",
      1e3 * std::abs(r.box_min_m), r.box_min_m < 0 ? "outside" : "within",
      r.tilt_max_rad * kDegreesPerRadian, e.options.limits.plate_tilt_max_rad * kDegreesPerRadian);
  const std::string own = r.device.is_reachable ? e.device.describe_margins(r.device) : "";
  out += own.empty() ? "\n" : "; " + own + "\n";
  if (e.has_fault() || r.breaches.empty() || r.breaches.front().t_s > e.dry_run_end_s()) return out;
  return out + text_line(
                   "           at %.4f s the hand pulls beyond a limit (%s), but the tool does "
                   "not get there\n",
                   r.breaches.front().t_s, r.breaches.front().what.c_str());
}

std::string describe_workspace(const SceneEvaluation& e) {
  const SafetyLimits& limits = e.options.limits;
  const auto heights = workspace_heights(e.device, limits, e.tool);
  if (!heights) return "workspace  nothing with the plate upright\n";
  std::string out = text_line(
      "workspace  tip, with the plate upright: z %.3f to %.3f m above the device's middle\n",
      heights->min_m, heights->max_m);
  std::vector<double> all_m{e.report.tip_max_m.z(), e.report.tip_min_m.z()};
  for (const auto& sheet : e.sheets)
    all_m.push_back(sheet->z_m);
  std::sort(all_m.begin(), all_m.end(), std::greater<>());
  all_m.erase(std::unique(all_m.begin(), all_m.end()), all_m.end());
  const std::size_t count = std::min(all_m.size(), kMaxListedHeights);
  std::string last, high;                    // range of heights with the same rectangle
  for (std::size_t k = 0; k < count; ++k) {  // choose evenly, including the first and the last
    const std::size_t at = count == 1 ? 0 : k * (all_m.size() - 1) / (count - 1);
    const auto rectangle = workspace_rectangle(e.device, limits, e.tool, all_m[at]);
    const std::string extent = rectangle ? describe_rectangle(*rectangle) : "nothing";
    const std::string height = text_line("%.4f", all_m[at]);
    if (extent == last) {
      out.resize(out.rfind("           at "));
      out +=
          text_line("           at %s to %s m %s\n", height.c_str(), high.c_str(), extent.c_str());
      continue;
    }
    last = extent;
    high = height;
    out += text_line("           at %s m %s\n", height.c_str(), extent.c_str());
  }
  return out;
}

std::string describe_live_hand(const LiveHandLimits& hand) {
  const Eigen::Vector3d& at_m = hand.T_device_tool_start.p_m;
  return text_line(
      "hand       live, begins with the tip at (%.4f, %.4f, %.4f) m; moves within x %.3f to %.3f, "
      "y %.3f "
      "to %.3f, z %.3f to %.3f m, at up to %.2f m/s; no dry run\n",
      at_m.x(), at_m.y(), at_m.z(), hand.min_m.x(), hand.max_m.x(), hand.min_m.y(), hand.max_m.y(),
      hand.min_m.z(), hand.max_m.z(), hand.speed_max_m_per_s);
}

std::string describe_feel(const SceneEvaluation& e) {
  const ContactFeel& feel = e.dry_run->feel;
  std::string out = text_line(
      "           the law wants %.2f to %.2f N along z; at most %.2f N alternate from "
      "tick to tick\n",
      feel.wanted_least_N, feel.wanted_most.value, feel.alternation.value);
  if (e.scene.force_law.kind != ForceLawKind::kCutting) return out;
  out += text_line(
      "           tip at most %.2f mm past the front that bears it; the front moves at most "
      "%.2f mm in a tick\n",
      1e3 * feel.past_front.value, 1e3 * feel.front_jump.value);
  if (e.let_go)
    out += text_line(
        "           letting go at %d moments: the plate moves at most %.2f mm, at up to %.3f m/s\n",
        e.let_go->moments, 1e3 * e.let_go->distance_m, e.let_go->speed_m_per_s);
  return out;
}

std::string describe_dry_run(const SceneEvaluation& e) {
  if (!e.dry_run) return "dry run    none: the session cannot start\n";
  const DryRun& dry_run = *e.dry_run;
  const auto touched = std::count_if(dry_run.sheets.begin(), dry_run.sheets.end(),
                                     [](const SheetDryRun& each) { return each.touched; });
  const auto punctured =
      std::count_if(dry_run.sheets.begin(), dry_run.sheets.end(),
                    [](const SheetDryRun& each) { return each.punctured_t_s >= 0; });
  std::string out = text_line("dry run    %llu ticks in virtual time",  //
                              static_cast<unsigned long long>(dry_run.ticks));
  if (dry_run.is_shortened()) {
    out += text_line(", %.6g of %.6g s; after that only the path is evaluated", e.dry_run_end_s(),
                     e.options.duration_s);
  }
  out +=
      dry_run.fault == Fault::kNone
          ? std::string(": no fault")
          : text_line(": fault %s at %.4f s", to_string(Fault{dry_run.fault}), dry_run.fault_t_s);
  out += text_line("; %d of %zu slices touched, %d punctured; at most %.2f N",
                   static_cast<int>(touched), dry_run.sheets.size(), static_cast<int>(punctured),
                   dry_run.force_max_N);
  if (const auto peak_Nm = e.device.motors_and_joints().motor_peak_torque_Nm)
    out += text_line(" and %.2f of %.2f Nm", dry_run.torque_max_Nm, *peak_Nm);
  return out + '\n' + describe_feel(e);
}

std::string describe_slice(const SceneEvaluation& e, std::size_t index,
                           const SliceRequirements& needs, const TissueChoice& choice) {
  const std::optional<SheetCrossing>& crossing = e.views[index].crossing;
  std::string out = needs.mesh + "; " + describe_choice(e.scene, choice) + "\n           ";
  out += crossing ? text_line(
                        "the path goes through at %.4f s at (%.4f, %.4f) m: %.0f %% of the "
                        "tool over material; ",
                        crossing->t_s, crossing->tip_m.x(), crossing->tip_m.y(),
                        100 * crossing->coverage)
                  : std::string(e.scene.hand.live ? "" : "the path does not go through; ") +
                        "at the anchor ";
  out += needs.force + '\n';
  if (!e.dry_run || !e.dry_run->sheets[index].touched) return out;
  const SheetDryRun& sheet = e.dry_run->sheets[index];
  out += text_line("           touched at %.4f s, bears at most %.2f", sheet.touched_t_s,
                   sheet.force_max_N);
  const std::optional<double> threshold_N = rendered_threshold_N(e, index);
  out += threshold_N ? text_line(" of %.6g N", *threshold_N) : std::string(" N");
  return out + (sheet.punctured_t_s >= 0 ? text_line(", punctured at %.4f s\n", sheet.punctured_t_s)
                                         : std::string(", not punctured\n"));
}

/// Returns the poses in which the tool is assumed to touch the sheets.
std::vector<Pose> touching_poses(const SceneEvaluation& e) {
  std::vector<Pose> poses;
  for (std::size_t i = 0; i < e.sheets.size(); ++i) {
    const std::optional<SheetCrossing>& crossing = e.views[i].crossing;
    poses.push_back(crossing && is_upright(e.tool, crossing->T_device_plate)
                        ? crossing->T_device_plate
                        : over_anchor(*e.sheets[i], e.tool));
  }
  return poses;
}

}  // namespace

Result<SceneCheck> check_scene(const Scene& scene, const DeviceToCheck& device,
                               const std::vector<std::unique_ptr<const Sheet>>& sheets,
                               const std::vector<SliceTissue>& tissues, const LoadedBytes& bytes,
                               const SessionOptions& options) {
  Result<SceneEvaluation> evaluated = evaluate_scene(scene, device, sheets, options);
  if (!evaluated) return evaluated.error();
  const SceneEvaluation& e = *evaluated;
  const Result<SceneRequirements> needs =
      describe_requirements(scene, e.device, sheets, touching_poses(e), bytes, options);
  if (!needs) return needs.error();
  SceneCheck check;
  if (scene.hand.live) {
    const Result<LiveHandLimits> hand = live_hand_limits(scene, e.device, options.limits);
    check.text = needs->scene + describe_workspace(e) + (hand ? describe_live_hand(*hand) : "");
    check.warnings = find_live_hand_warnings(e, tissues, hand);
  } else {
    check.text = needs->scene + describe_workspace(e) + describe_path(e) + describe_dry_run(e);
    check.warnings = find_warnings(e, tissues);
  }
  for (std::size_t i = 0; i < sheets.size(); ++i)
    check.text += describe_slice(e, i, needs->slices[i], tissues[i].choice);
  if (options.is_stopped()) return interrupted();
  if (!needs->stability_warning.empty()) check.warnings.push_back(needs->stability_warning);
  return check;
}

}  // namespace trocar::runtime
