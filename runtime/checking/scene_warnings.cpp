// SPDX-License-Identifier: Apache-2.0
#include "runtime/checking/scene_warnings.h"

#include <algorithm>
#include <limits>
#include <optional>

#include "formats/base/text_line.h"

namespace trocar::runtime {
namespace {

// Limits of contact_feel.h.
constexpr double kMaxPastFront_m = 3e-3, kMaxFrontJump_m = 1.5e-3, kMaxAlternation_N = 5,
                 kMaxLetGo_m = 3e-3, kMaxLetGo_m_per_s = 0.25;

std::string describe_point(const Eigen::Vector3d& p_m) {
  return text_line("(%.4f, %.4f, %.4f) m", p_m.x(), p_m.y(), p_m.z());
}

Pose plate_at(const RecordingRow& row) {
  return {Eigen::Vector3d(row.p_m.data()),
          Eigen::Quaterniond(row.q[0], row.q[1], row.q[2], row.q[3])};
}

/// Returns advice on a pose that exceeds a limit.
std::string advise_on_workspace(const SceneEvaluation& e, const Eigen::Vector3d& tip_m) {
  const SafetyLimits& limits = e.options.limits;
  if (const auto r = workspace_rectangle(e.device, limits, e.tool, tip_m.z())) {
    const bool inside = (tip_m.head<2>().array() >= r->min_m.array()).all() &&
                        (tip_m.head<2>().array() <= r->max_m.array()).all();
    return inside ? std::string("turn or tilt the hand less there")
                  : "keep the path at that height within " + describe_rectangle(*r);
  }
  const auto heights = workspace_heights(e.device, limits, e.tool);
  return heights ? text_line("keep the path's height within %.3f to %.3f m", heights->min_m,
                             heights->max_m)
                 : "choose another device description: this one reaches nothing";
}

std::string advise(const SceneEvaluation& e, Fault fault, const Eigen::Vector3d& tip_m) {
  switch (fault) {
    case Fault::kWorkspace:
    case Fault::kJointLimit:
    case Fault::kSingularity:
    case Fault::kPoseResidual:
      return advise_on_workspace(e, tip_m);
    case Fault::kToolTilt:
      return "tilt the tool or the hand less";
    case Fault::kSpeed:
    case Fault::kEncoderJump:
      return "move slower there, with later keyframes";
    case Fault::kMotorOverload:
      return "lower the tissue's threshold_N, or push for a shorter time";
    case Fault::kTorqueRate:
    case Fault::kTorqueLimit:
    case Fault::kEnergyLimit:
      return "lower the tissue's stiffness, damping or friction";
    default:
      return "run the session with --record and inspect its last rows";
  }
}

std::string at_time(double t_s) {
  return text_line("at %.4f s: ", t_s);
}

/// Returns the warning that a fault ends the session, if it does.
std::optional<std::string> warn_of_end(const SceneEvaluation& e) {
  if (!e.dry_run) {
    const HandKeyframe& start = e.path.keyframes.front();
    const Eigen::Vector3d& tip_m = start.T_device_tool.p_m;
    const std::string what =
        e.report.breaches.empty() ? std::string("out of reach") : e.report.breaches.front().what;
    return at_time(0) + "the session cannot start with the tip at " + describe_point(tip_m) + ": " +
           what + ": " + advise_on_workspace(e, tip_m);
  }
  const DryRun& dry_run = *e.dry_run;
  if (dry_run.fault != Fault::kNone) {
    const std::string what = measured(dry_run.fault);
    // If a check failed, the pose in the row is that of an earlier tick.
    const Pose T_device_plate =
        e.device.pose_of(dry_run.at_fault).value_or(plate_at(dry_run.at_fault));
    return at_time(dry_run.fault_t_s) + "the session ends with the fault " +
           to_string(Fault{dry_run.fault}) + (what.empty() ? "" : ": " + what) + ": " +
           advise(e, dry_run.fault, T_device_plate * e.tool.tip_plate_m);
  }
  if (!dry_run.is_shortened()) return std::nullopt;
  const PathReport rest = evaluate_path(e.path, e.device, e.options.limits, e.tool,
                                        e.dry_run_end_s(), std::max(e.let_go_s, e.dry_run_end_s()));
  if (rest.breaches.empty() || e.let_go_s <= e.dry_run_end_s()) return std::nullopt;
  const PathBreach& breach = rest.breaches.front();
  return at_time(breach.t_s) + "the path leads to the fault " + to_string(breach.fault) + ": " +
         breach.what + ": " + advise(e, breach.fault, breach.tip_m);
}

/// Returns a text such as "slices 3-5 at 0.1200 to 0.1400 m". `sheets`: the topmost first.
std::string name_sheets(const SceneEvaluation& e, const std::vector<std::size_t>& sheets) {
  std::vector<int> slices;
  slices.reserve(sheets.size());
  for (const std::size_t i : sheets)
    slices.push_back(e.sheets[i]->slice_index);
  const double high_m = e.sheets[sheets.front()]->z_m, low_m = e.sheets[sheets.back()]->z_m;
  return name_slices(slices) + (sheets.size() == 1
                                    ? text_line(" at %.4f m", high_m)
                                    : text_line(" at %.4f to %.4f m", low_m, high_m));
}

/// Describes the extent of a sheet's material in {B}, and its point nearest to `from_m`.
std::string describe_material(const Sheet& sheet, const Eigen::Vector2d& from_m) {
  Eigen::Vector2d low_m = Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity());
  Eigen::Vector2d high_m = -low_m, nearest_m = low_m;
  for (const Triangle& triangle : sheet.mesh.triangles) {
    if (triangle == kFreeSlot) continue;
    for (const std::uint32_t v : triangle) {
      const LatticePoint p = sheet.mesh.vertices[v];
      const Eigen::Vector2d at_m = sheet.transform.to_scene(
          Eigen::Vector2d(static_cast<double>(p.x), static_cast<double>(p.y)));
      low_m = low_m.cwiseMin(at_m);
      high_m = high_m.cwiseMax(at_m);
      if ((at_m - from_m).norm() < (nearest_m - from_m).norm()) nearest_m = at_m;
    }
  }
  return text_line(
      "its material lies within x %.4f to %.4f, y %.4f to %.4f m, the nearest at "
      "(%.4f, %.4f) m",
      low_m.x(), high_m.x(), low_m.y(), high_m.y(), nearest_m.x(), nearest_m.y());
}

/// Returns the sheet above sheet `index` that was loaded last and was not punctured.
std::optional<std::size_t> find_loaded_sheet(const DryRun& dry_run, std::size_t index) {
  std::optional<std::size_t> last;
  for (std::size_t i = 0; i < index; ++i) {
    const SheetDryRun& above = dry_run.sheets[i];
    const bool came_through = above.punctured_t_s >= above.loaded_t_s;
    if (!above.touched || came_through) continue;
    if (!last || above.loaded_t_s >= dry_run.sheets[*last].loaded_t_s) last = i;
  }
  return last;
}

/// Returns the reason why a sheet was not touched although the path crosses its material.
std::string describe_held(const SceneEvaluation& e, std::size_t index) {
  const DryRun& dry_run = *e.dry_run;
  if (dry_run.sheets[index].missed) {
    return "the tool does not stay on the path and misses the material: use a stiffer hand "
           "or a slower path";
  }
  const std::string lowest = text_line("the tool gets no lower than %.4f m", dry_run.tip_lowest_m);
  const std::optional<std::size_t> bearing = find_loaded_sheet(dry_run, index);
  if (!bearing) return lowest + ": use a stiffer hand, or give the path more time";
  const std::optional<double> threshold_N = rendered_threshold_N(e, *bearing);
  return (dry_run.tip_lowest_m < e.sheets[index]->z_m ? "" : lowest + ", where ") +
         name_sheets(e, {*bearing}) +
         text_line(" bears it, with up to %.1f", dry_run.sheets[*bearing].force_max_N) +
         (threshold_N ? text_line(" of %.6g N", *threshold_N) : std::string(" N")) +
         ": push deeper or with a stiffer hand, or lower " +
         (threshold_N ? "that slice's threshold_N" : "force_scale");
}

/// Describes the first of several sheets whose material the path misses.
std::string describe_missed(const SceneEvaluation& e, const std::vector<std::size_t>& sheets) {
  const SheetCrossing& crossing = *e.views[sheets.front()].crossing;
  const Sheet& sheet = *e.sheets[sheets.front()];
  return (sheets.size() == 1 ? "" : name_slices({sheet.slice_index}) + ": ") +
         text_line(
             "%.0f %% of the tool over material at %.4f s, where the path goes through at (%.4f, "
             "%.4f) m, and contact takes %.0f %%; ",
             100 * crossing.coverage, crossing.t_s, crossing.tip_m.x(), crossing.tip_m.y(),
             100 * ContactModel{}.min_coverage) +
         describe_material(sheet, crossing.tip_m.head<2>()) + ": move the path or the placement";
}

std::string warn_of_miss(const SceneEvaluation& e, Miss miss,
                         const std::vector<std::size_t>& sheets) {
  const std::optional<SheetCrossing>& crossing = e.views[sheets.front()].crossing;
  std::string text = name_sheets(e, sheets) + ": never touched: ";
  switch (miss) {
    case Miss::kBeginsBelow:
      text += text_line("the path begins below, with the tip at %.4f m: begin above",
                        e.path.keyframes.front().T_device_tool.p_m.z());
      break;
    case Miss::kStaysAbove:
      text += text_line(
          "the path stays above, with the lowest tip at %.4f m: lower the path, or raise the slice",
          e.report.tip_min_m.z());
      break;
    case Miss::kTooLate:
      text += text_line(
          "the path goes below at %.4f s, and the session ends at %.6g s: raise --duration or "
          "duration_s",
          crossing->t_s, e.options.duration_s);
      break;
    case Miss::kLetGo:
      text += text_line(
          "the hand lets go at %.6g s, and the path goes below at %.4f s: raise let_go_t_s",
          *e.scene.hand.let_go_t_s, crossing->t_s);
      break;
    case Miss::kMissed:
      text += describe_missed(e, sheets);
      break;
    case Miss::kHeld:
      text += describe_held(e, sheets.front());
      break;
    case Miss::kTouched:
      break;
  }
  return text;
}

void warn_of_misses(const SceneEvaluation& e, std::vector<std::string>& warnings) {
  for (const Miss miss : {Miss::kBeginsBelow, Miss::kStaysAbove, Miss::kTooLate, Miss::kLetGo,
                          Miss::kMissed, Miss::kHeld}) {
    std::vector<std::size_t> sheets;
    for (std::size_t i = 0; i < e.views.size(); ++i) {
      if (e.views[i].miss == miss) sheets.push_back(i);
    }
    if (!sheets.empty()) warnings.push_back(warn_of_miss(e, miss, sheets));
  }
}

/// Warns of contact that does not feel like bone (contact_feel.h).
void warn_of_feel(const SceneEvaluation& e, std::vector<std::string>& warnings) {
  if (!e.dry_run) return;
  const ContactFeel& feel = e.dry_run->feel;
  if (feel.past_front.value > kMaxPastFront_m)
    warnings.push_back(
        at_time(feel.past_front.t_s) +
        text_line("the tip is %.1f mm past the front that bears it, and snaps when "
                  "that breaks; bone lets it sink in by at most %.1f mm: raise or "
                  "leave out stiffness_N_per_m and coupling_N_per_m, or raise --rate",
                  1e3 * feel.past_front.value, 1e3 * kMaxPastFront_m));
  if (feel.front_jump.value > kMaxFrontJump_m)
    warnings.push_back(
        at_time(feel.front_jump.t_s) +
        text_line("the front moves %.1f mm in one tick, more than %.1f mm: raise or "
                  "leave out stiffness_N_per_m and coupling_N_per_m, or raise --rate",
                  1e3 * feel.front_jump.value, 1e3 * kMaxFrontJump_m));
  if (feel.alternation.value > kMaxAlternation_N)
    warnings.push_back(at_time(feel.alternation.t_s) +
                       text_line("the force alternates by %.1f N from tick to tick: lower the "
                                 "tissue's stiffness, damping or friction, or raise --rate",
                                 feel.alternation.value));
  if (!e.let_go) return;
  const LetGoTrial& trial = *e.let_go;
  if (trial.fault != Fault::kNone)
    warnings.push_back(std::string("a hand that lets go in the bone causes the fault ") +
                       to_string(trial.fault) +
                       ": lower force_scale or the tissue's strength, or raise --rate");
  else if (trial.speed_m_per_s > kMaxLetGo_m_per_s || trial.distance_m > kMaxLetGo_m)
    warnings.push_back(
        at_time(trial.t_s) +
        text_line("a hand that lets go is pushed away by up to %.1f mm at %.2f m/s, more than %.1f "
                  "mm or %.2f m/s: lower force_scale, or raise --rate",
                  1e3 * trial.distance_m, trial.speed_m_per_s, 1e3 * kMaxLetGo_m,
                  kMaxLetGo_m_per_s));
}

/// Returns the warning about a target that the tip cannot reach, if it cannot.
std::optional<std::string> warn_of_target(const SceneEvaluation& e) {
  if (!e.scene.goals || !e.scene.goals->target) return std::nullopt;
  const Eigen::Vector3d at_m(e.scene.goals->target->at_m.data());
  const double radius_m = e.scene.goals->target->radius_m;
  const auto r = workspace_rectangle(e.device, e.options.limits, e.tool, at_m.z());
  if (r && (at_m.head<2>().array() >= r->min_m.array() - radius_m).all() &&
      (at_m.head<2>().array() <= r->max_m.array() + radius_m).all())
    return std::nullopt;
  return "goals: the target at " + describe_point(at_m) +
         " cannot be reached with the plate upright, where the tip gets to " +
         (r ? describe_rectangle(*r) : std::string("nothing at that height")) + ": move it";
}

/// Warns of what does not depend on how the hand moves.
void warn_of_scene(const SceneEvaluation& e, const std::vector<SliceTissue>& tissues,
                   std::vector<std::string>& warnings) {
  if (const auto unfitting = warn_of_unfitting(e.scene, tissues)) warnings.push_back(*unfitting);
  if (const auto target = warn_of_target(e)) warnings.push_back(*target);
}

}  // namespace

std::vector<std::string> find_warnings(const SceneEvaluation& e,
                                       const std::vector<SliceTissue>& tissues) {
  std::vector<std::string> warnings;
  const std::optional<std::string> end = warn_of_end(e);
  if (end) warnings.push_back(*end);
  // A path that ends within a bone volume does not cross all of its slices.
  const bool ends_in_volume =
      e.scene.body && std::any_of(e.views.begin(), e.views.end(), [](const SheetView& view) {
        return view.miss == Miss::kTouched;
      });
  if (!ends_in_volume) warn_of_misses(e, warnings);
  if (e.dry_run && e.dry_run->scaled_ticks > 0 && e.dry_run->fault != Fault::kMotorOverload) {
    const auto peak_Nm = e.device.motors_and_joints().motor_peak_torque_Nm;
    warnings.push_back(
        at_time(e.dry_run->scaled_t_s) +
        (peak_Nm ? text_line("the motors, of %.3g Nm, render", *peak_Nm)
                 : std::string("the device renders")) +
        text_line(" too little force, down to %.0f %% of it, in %llu ticks: lower "
                  "the tissue's threshold_N or stiffness, or push for a shorter time",
                  100 * e.dry_run->scale_min,
                  static_cast<unsigned long long>(e.dry_run->scaled_ticks)));
  }
  if (e.dry_run && e.dry_run->hole_error) {
    warnings.push_back("a hole cannot be cut: " + e.dry_run->hole_error->message);
  }
  warn_of_feel(e, warnings);
  warn_of_scene(e, tissues, warnings);
  return warnings;
}

std::vector<std::string> find_live_hand_warnings(const SceneEvaluation& e,
                                                 const std::vector<SliceTissue>& tissues,
                                                 const Result<LiveHandLimits>& hand) {
  std::vector<std::string> warnings;
  std::vector<std::size_t> outside;
  if (!hand) warnings.push_back(hand.error().message);
  for (std::size_t i = 0; hand && i < e.sheets.size(); ++i) {
    if (e.sheets[i]->z_m < hand->min_m.z() || e.sheets[i]->z_m > hand->max_m.z())
      outside.push_back(i);
  }
  if (!outside.empty())
    warnings.push_back(name_sheets(e, outside) +
                       text_line(": out of the live hand's heights, which are %.4f to %.4f m: move "
                                 "the slices, or begin at another height",
                                 hand->min_m.z(), hand->max_m.z()));
  warn_of_scene(e, tissues, warnings);
  return warnings;
}

}  // namespace trocar::runtime
