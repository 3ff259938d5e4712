// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/scene_check.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>

#include "runtime/session/hand_path.h"
#include "runtime/session/text_line.h"
#include "runtime/session/trial.h"

namespace trocar::runtime {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;
constexpr std::size_t kMostReachHeights = 5;

/// Why a slice is not touched.
enum class Miss : std::uint8_t {
  kTouched,      ///< it is touched, or would be but for a fault
  kBeginsBelow,  ///< the path begins below it and never comes from above
  kStaysAbove,   ///< the path never goes below it
  kTooLate,      ///< only after the session's end
  kLetGo,        ///< only after the hand has let go
  kBeside,       ///< too little material under the tool where the path goes through
  kHeld,         ///< the tool does not follow the path to it
};

/// One sheet on the path.
struct SheetView {
  std::optional<SheetCrossing> crossing;  ///< the first that touches, or else the first
  Miss miss = Miss::kTouched;
};

/// What the text and the warnings are made from.
struct Judgement {
  const Scene& scene;
  const DeviceDescription& device;
  const std::vector<std::unique_ptr<const Sheet>>& sheets;
  const SessionOptions& options;
  Tool tool{};
  HandTrajectory path{};
  double end_s = 0;     ///< of the last tick
  double let_go_s = 0;  ///< the hand holds the tool until then; at most end_s
  PathReport report{};
  std::optional<Trial> trial{};  ///< none: the session cannot start
  std::vector<SheetView> views{};

  bool has_fault() const { return !trial || trial->fault != Fault::kNone; }
  double trial_end_s() const {
    return trial ? static_cast<double>(trial->ticks) / options.rate_Hz : 0;
  }
};

std::string describe_point(const Eigen::Vector3d& p_m) {
  return text_line("(%.4f, %.4f, %.4f) m", p_m.x(), p_m.y(), p_m.z());
}

std::string describe_rectangle(const ReachRectangle& r) {
  return text_line("x %.3f to %.3f, y %.3f to %.3f m", r.min_m.x(), r.max_m.x(), r.min_m.y(),
                   r.max_m.y());
}

Pose plate_at(const RecordingRow& row) {
  return {Eigen::Vector3d(row.p_m.data()),
          Eigen::Quaterniond(row.q[0], row.q[1], row.q[2], row.q[3])};
}

/// The pose that a row's encoders give; the row's own is an earlier one where a check failed.
Pose plate_by_encoders(const DeviceDescription& device, const RecordingRow& row) {
  const ForwardResult forward = forward_kinematics(device, row.encoder_rad);
  return forward.status ? forward.T_device_plate : plate_at(row);
}

// The path through the sheets.

SheetView view_sheet(const Judgement& j, std::size_t index) {
  const ContactModel contact;
  const Sheet& sheet = *j.sheets[index];
  const std::vector<SheetCrossing> crossings = sheet_crossings(j.path, j.tool, sheet);
  const auto touches = [&](const SheetCrossing& each) {
    return each.t_s <= j.let_go_s && each.overlap >= contact.least_overlap;
  };
  SheetView view;
  if (crossings.empty()) {
    const double begin_m = j.path.keyframes.front().T_device_tool.p_m.z();
    view.miss = begin_m < sheet.z_m ? Miss::kBeginsBelow : Miss::kStaysAbove;
  } else {
    const auto first = std::find_if(crossings.begin(), crossings.end(), touches);
    view.crossing = first == crossings.end() ? crossings.front() : *first;
    view.miss = first != crossings.end()          ? Miss::kHeld
                : view.crossing->t_s > j.end_s    ? Miss::kTooLate
                : view.crossing->t_s > j.let_go_s ? Miss::kLetGo
                                                  : Miss::kBeside;
  }
  const bool touched = j.trial && j.trial->sheets[index].touched;
  // After a fault or the trial's end the path alone says whether it would be touched.
  const bool unknown =
      view.miss == Miss::kHeld && (j.has_fault() || view.crossing->t_s >= j.trial_end_s());
  if (touched || unknown) view.miss = Miss::kTouched;
  return view;
}

// Why a session stops, and what to do.

/// What to do about a pose beyond a limit.
std::string advise_on_reach(const Judgement& j, const Eigen::Vector3d& tip_m) {
  const SafetyLimits& limits = j.options.limits;
  if (const auto r = reach_rectangle(j.device, limits, j.tool, tip_m.z())) {
    const bool inside = (tip_m.head<2>().array() >= r->min_m.array()).all() &&
                        (tip_m.head<2>().array() <= r->max_m.array()).all();
    return inside ? std::string("turn or tilt the hand less there")
                  : "keep the path at that height within " + describe_rectangle(*r);
  }
  const auto heights = reach_heights(j.device, limits, j.tool);
  return heights ? text_line("keep the path's height within %.3f to %.3f m", heights->min_m,
                             heights->max_m)
                 : "choose another device description: this one reaches nothing";
}

std::string advise(const Judgement& j, Fault fault, const Eigen::Vector3d& tip_m) {
  switch (fault) {
    case Fault::kWorkspace:
    case Fault::kJointLimit:
    case Fault::kSingularity:
    case Fault::kPoseResidual:
      return advise_on_reach(j, tip_m);
    case Fault::kToolTilt:
      return "tilt the tool or the hand less";
    case Fault::kSpeed:
    case Fault::kEncoderJump:
      return "move slower there, with later keyframes";
    case Fault::kMotorOverload:
      return "lower the tissue's threshold_N, or push for a shorter time";
    case Fault::kTorqueRate:
    case Fault::kTorqueLimit:
    case Fault::kEnergy:
      return "lower the tissue's stiffness, damping or friction";
    default:
      return "run the session with --record and look at its last rows";
  }
}

std::string at_time(double t_s) {
  return text_line("at %.4f s: ", t_s);
}

/// What ends the session, if anything does.
std::optional<std::string> warn_of_end(const Judgement& j) {
  if (!j.trial) {
    const HandKeyframe& start = j.path.keyframes.front();
    const Eigen::Vector3d& tip_m = start.T_device_tool.p_m;
    const std::string what =
        j.report.breaches.empty() ? std::string("out of reach") : j.report.breaches.front().what;
    return at_time(0) + "the session cannot start with the tip at " + describe_point(tip_m) + ": " +
           what + ": " + advise_on_reach(j, tip_m);
  }
  const Trial& trial = *j.trial;
  if (trial.fault != Fault::kNone) {
    const std::string what = measured(trial.fault);
    const Pose T_device_plate = plate_by_encoders(j.device, trial.at_fault);
    return at_time(trial.fault_t_s) + "the session ends with the fault " +
           to_string(Fault{trial.fault}) + (what.empty() ? "" : ": " + what) + ": " +
           advise(j, trial.fault, T_device_plate * j.tool.tip_plate_m);
  }
  if (!trial.is_cut()) return std::nullopt;
  const PathReport rest = judge_path(j.path, j.device, j.options.limits, j.tool, j.trial_end_s(),
                                     std::max(j.let_go_s, j.trial_end_s()));
  if (rest.breaches.empty() || j.let_go_s <= j.trial_end_s()) return std::nullopt;
  const PathBreach& breach = rest.breaches.front();
  return at_time(breach.t_s) + "the path leads to the fault " + to_string(breach.fault) + ": " +
         breach.what + ": " + advise(j, breach.fault, breach.tip_m);
}

// Warnings of slices that are not touched.

/// "slices 3-5 at 0.1200 to 0.1400 m", of sheets with the topmost first.
std::string name_sheets(const Judgement& j, const std::vector<std::size_t>& sheets) {
  std::vector<int> slices;
  slices.reserve(sheets.size());
  for (const std::size_t i : sheets)
    slices.push_back(j.sheets[i]->slice_index);
  const double high_m = j.sheets[sheets.front()]->z_m, low_m = j.sheets[sheets.back()]->z_m;
  return name_slices(slices) + (sheets.size() == 1
                                    ? text_line(" at %.4f m", high_m)
                                    : text_line(" at %.4f to %.4f m", low_m, high_m));
}

/// Where a sheet has material, in {B}.
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

/// The sheet above that bore the tool last and was not punctured then; none: none.
std::optional<std::size_t> find_bearing(const Trial& trial, std::size_t index) {
  std::optional<std::size_t> last;
  for (std::size_t i = 0; i < index; ++i) {
    const SheetTrial& above = trial.sheets[i];
    const bool came_through = above.punctured_t_s >= above.borne_t_s;
    if (!above.touched || came_through) continue;
    if (!last || above.borne_t_s >= trial.sheets[*last].borne_t_s) last = i;
  }
  return last;
}

/// Why a sheet was not touched though the path goes through its material.
std::string describe_held(const Judgement& j, std::size_t index) {
  const Trial& trial = *j.trial;
  if (trial.sheets[index].passed_beside) {
    return "the tool does not stay on the path and passes beside the material: use a stiffer hand "
           "or a slower path";
  }
  const std::string lowest = text_line("the tool gets no lower than %.4f m", trial.tip_lowest_m);
  const std::optional<std::size_t> bearing = find_bearing(trial, index);
  if (!bearing) return lowest + ": use a stiffer hand, or give the path more time";
  return (trial.tip_lowest_m < j.sheets[index]->z_m ? "" : lowest + ", where ") +
         name_sheets(j, {*bearing}) +
         text_line(
             " bears it, with up to %.1f of %.6g N: push deeper or with a stiffer hand, or lower "
             "that slice's threshold_N",
             trial.sheets[*bearing].force_max_N, j.sheets[*bearing]->tissue.threshold_N);
}

/// Of sheets beside whose material the path goes through: the first one's figures.
std::string describe_beside(const Judgement& j, const std::vector<std::size_t>& sheets) {
  const SheetCrossing& crossing = *j.views[sheets.front()].crossing;
  const Sheet& sheet = *j.sheets[sheets.front()];
  return (sheets.size() == 1 ? "" : name_slices({sheet.slice_index}) + ": ") +
         text_line(
             "%.0f %% of the tool over material at %.4f s, where the path goes through at (%.4f, "
             "%.4f) m, and contact takes %.0f %%; ",
             100 * crossing.overlap, crossing.t_s, crossing.tip_m.x(), crossing.tip_m.y(),
             100 * ContactModel{}.least_overlap) +
         describe_material(sheet, crossing.tip_m.head<2>()) + ": move the path or the placement";
}

std::string warn_of_miss(const Judgement& j, Miss miss, const std::vector<std::size_t>& sheets) {
  const std::optional<SheetCrossing>& crossing = j.views[sheets.front()].crossing;
  std::string text = name_sheets(j, sheets) + ": never touched: ";
  switch (miss) {
    case Miss::kBeginsBelow:
      text += text_line("the path begins below, with the tip at %.4f m: begin above",
                        j.path.keyframes.front().T_device_tool.p_m.z());
      break;
    case Miss::kStaysAbove:
      text += text_line(
          "the path stays above, with the lowest tip at %.4f m: lower the path, or raise the slice",
          j.report.tip_min_m.z());
      break;
    case Miss::kTooLate:
      text += text_line(
          "the path goes below at %.4f s, and the session ends at %.6g s: raise --duration or "
          "duration_s",
          crossing->t_s, j.options.duration_s);
      break;
    case Miss::kLetGo:
      text += text_line(
          "the hand lets go at %.6g s, and the path goes below at %.4f s: raise let_go_t_s",
          *j.scene.hand.let_go_t_s, crossing->t_s);
      break;
    case Miss::kBeside:
      text += describe_beside(j, sheets);
      break;
    case Miss::kHeld:
      text += describe_held(j, sheets.front());
      break;
    case Miss::kTouched:
      break;
  }
  return text;
}

void warn_of_misses(const Judgement& j, std::vector<std::string>& warnings) {
  for (const Miss miss : {Miss::kBeginsBelow, Miss::kStaysAbove, Miss::kTooLate, Miss::kLetGo,
                          Miss::kBeside, Miss::kHeld}) {
    std::vector<std::size_t> sheets;
    for (std::size_t i = 0; i < j.views.size(); ++i) {
      if (j.views[i].miss == miss) sheets.push_back(i);
    }
    if (!sheets.empty()) warnings.push_back(warn_of_miss(j, miss, sheets));
  }
}

/// A target that the tip cannot come to, if the scene has one.
std::optional<std::string> warn_of_target(const Judgement& j) {
  if (!j.scene.goals || !j.scene.goals->target) return std::nullopt;
  const Eigen::Vector3d at_m(j.scene.goals->target->at_m.data());
  const double radius_m = j.scene.goals->target->radius_m;
  const auto r = reach_rectangle(j.device, j.options.limits, j.tool, at_m.z());
  if (r && (at_m.head<2>().array() >= r->min_m.array() - radius_m).all() &&
      (at_m.head<2>().array() <= r->max_m.array() + radius_m).all())
    return std::nullopt;
  return "goals: the target at " + describe_point(at_m) +
         " cannot be reached with the plate upright, where the tip gets to " +
         (r ? describe_rectangle(*r) : std::string("nothing at that height")) + ": move it";
}

std::vector<std::string> find_warnings(const Judgement& j,
                                       const std::vector<SliceTissue>& tissues) {
  std::vector<std::string> warnings;
  const std::optional<std::string> end = warn_of_end(j);
  if (end) warnings.push_back(*end);
  // A path that ends within a body does not go through all of its slices.
  const bool ends_in_body =
      j.scene.body && std::any_of(j.views.begin(), j.views.end(), [](const SheetView& view) {
        return view.miss == Miss::kTouched;
      });
  if (!ends_in_body) warn_of_misses(j, warnings);
  if (j.trial && j.trial->scaled_ticks > 0 && j.trial->fault != Fault::kMotorOverload) {
    warnings.push_back(at_time(j.trial->scaled_t_s) +
                       text_line("the motors, of %.3g Nm, render too little force, down to %.0f %% "
                                 "of it, in %llu ticks: lower the tissue's threshold_N or "
                                 "stiffness, or push for a shorter time",
                                 j.device.motor_peak_torque_Nm, 100 * j.trial->scale_min,
                                 static_cast<unsigned long long>(j.trial->scaled_ticks)));
  }
  if (j.trial && j.trial->hole_error) {
    warnings.push_back("a hole cannot be cut: " + j.trial->hole_error->message);
  }
  if (const auto unfitting = warn_of_unfitting(j.scene, tissues)) warnings.push_back(*unfitting);
  if (const auto target = warn_of_target(j)) warnings.push_back(*target);
  return warnings;
}

// The text.

std::string describe_path(const Judgement& j) {
  const PathReport& r = j.report;
  std::string out = text_line(
      "path       %.6g s, tip x %.4f to %.4f, y %.4f to %.4f, z %.4f to %.4f m; speed at most %.3g "
      "of %.4g m/s\n",
      std::min(j.path.keyframes.back().t_s, j.options.duration_s), r.tip_min_m.x(), r.tip_max_m.x(),
      r.tip_min_m.y(), r.tip_max_m.y(), r.tip_min_m.z(), r.tip_max_m.z(), r.speed_max_m_per_s,
      j.options.limits.speed_max_m_per_s);
  out += text_line(
      "           plate %.1f mm %s the workspace's box, tilted by at most %.1f of %.1f "
      "deg",
      1e3 * std::abs(r.box_min_m), r.box_min_m < 0 ? "outside" : "within",
      r.tilt_max_rad * kDegrees, j.options.limits.plate_tilt_max_rad * kDegrees);
  if (r.within_reach) {
    out += text_line("; theta%d of leg %d %.1f deg %s its limit; inverse condition at least %.3f",
                     r.nearest.joint, r.nearest.leg, std::abs(r.nearest.joint_rad) * kDegrees,
                     r.nearest.joint_rad < 0 ? "beyond" : "from", r.inverse_condition_min);
  }
  out += '\n';
  if (j.has_fault() || r.breaches.empty() || r.breaches.front().t_s > j.trial_end_s()) return out;
  return out + text_line(
                   "           at %.4f s the hand pulls beyond a limit (%s), but the tool does "
                   "not get there\n",
                   r.breaches.front().t_s, r.breaches.front().what.c_str());
}

std::string describe_reach(const Judgement& j) {
  const SafetyLimits& limits = j.options.limits;
  const auto heights = reach_heights(j.device, limits, j.tool);
  if (!heights) return "reach      nothing with the plate upright\n";
  std::string out = text_line(
      "reach      tip, with the plate upright: z %.3f to %.3f m above the device's middle\n",
      heights->min_m, heights->max_m);
  std::vector<double> all_m{j.report.tip_max_m.z(), j.report.tip_min_m.z()};
  for (const auto& sheet : j.sheets)
    all_m.push_back(sheet->z_m);
  std::sort(all_m.begin(), all_m.end(), std::greater<>());
  all_m.erase(std::unique(all_m.begin(), all_m.end()), all_m.end());
  const std::size_t count = std::min(all_m.size(), kMostReachHeights);
  std::string last, high;                    // of heights with the same reach
  for (std::size_t k = 0; k < count; ++k) {  // evenly chosen, with the first and the last
    const std::size_t at = count == 1 ? 0 : k * (all_m.size() - 1) / (count - 1);
    const auto rectangle = reach_rectangle(j.device, limits, j.tool, all_m[at]);
    const std::string reach = rectangle ? describe_rectangle(*rectangle) : "nothing";
    const std::string height = text_line("%.4f", all_m[at]);
    if (reach == last) {
      out.resize(out.rfind("           at "));
      out +=
          text_line("           at %s to %s m %s\n", height.c_str(), high.c_str(), reach.c_str());
      continue;
    }
    last = reach;
    high = height;
    out += text_line("           at %s m %s\n", height.c_str(), reach.c_str());
  }
  return out;
}

std::string describe_trial(const Judgement& j) {
  if (!j.trial) return "trial      none: the session cannot start\n";
  const Trial& trial = *j.trial;
  const auto touched = std::count_if(trial.sheets.begin(), trial.sheets.end(),
                                     [](const SheetTrial& each) { return each.touched; });
  const auto punctured =
      std::count_if(trial.sheets.begin(), trial.sheets.end(),
                    [](const SheetTrial& each) { return each.punctured_t_s >= 0; });
  std::string out = text_line("trial      %llu ticks in virtual time",  //
                              static_cast<unsigned long long>(trial.ticks));
  if (trial.is_cut()) {
    out += text_line(", %.6g of %.6g s; from there on the path is judged", j.trial_end_s(),
                     j.options.duration_s);
  }
  out += trial.fault == Fault::kNone
             ? std::string(": no fault")
             : text_line(": fault %s at %.4f s", to_string(Fault{trial.fault}), trial.fault_t_s);
  return out + text_line(
                   "; %d of %zu slices touched, %d punctured; at most %.2f N and %.2f of %.2f "
                   "Nm\n",
                   static_cast<int>(touched), trial.sheets.size(), static_cast<int>(punctured),
                   trial.force_max_N, trial.torque_max_Nm, j.device.motor_peak_torque_Nm);
}

std::string describe_slice(const Judgement& j, std::size_t index, const SliceNeeds& needs,
                           const TissueChoice& choice) {
  const std::optional<SheetCrossing>& crossing = j.views[index].crossing;
  std::string out = needs.mesh + "; " + describe_choice(j.scene, choice) + "\n           ";
  out += crossing
             ? text_line(
                   "the path goes through at %.4f s at (%.4f, %.4f) m: %.0f %% of the "
                   "tool over material; ",
                   crossing->t_s, crossing->tip_m.x(), crossing->tip_m.y(), 100 * crossing->overlap)
             : std::string("the path does not go through; at the anchor ");
  out += needs.force + '\n';
  if (!j.trial || !j.trial->sheets[index].touched) return out;
  const SheetTrial& trial = j.trial->sheets[index];
  out += text_line("           touched at %.4f s, bears at most %.2f of %.6g N", trial.touched_t_s,
                   trial.force_max_N, j.sheets[index]->tissue.threshold_N);
  return out + (trial.punctured_t_s >= 0 ? text_line(", punctured at %.4f s\n", trial.punctured_t_s)
                                         : std::string(", not punctured\n"));
}

/// Where the tool is taken to touch each sheet.
std::vector<Pose> touching_poses(const Judgement& j) {
  std::vector<Pose> poses;
  for (std::size_t i = 0; i < j.sheets.size(); ++i) {
    const std::optional<SheetCrossing>& crossing = j.views[i].crossing;
    poses.push_back(crossing && is_upright(j.tool, crossing->T_device_plate)
                        ? crossing->T_device_plate
                        : over_anchor(*j.sheets[i], j.tool));
  }
  return poses;
}

}  // namespace

Result<SceneCheck> check_scene(const Scene& scene, const DeviceDescription& device,
                               const std::vector<std::unique_ptr<const Sheet>>& sheets,
                               const std::vector<SliceTissue>& tissues, const LoadedBytes& bytes,
                               const SessionOptions& options) {
  Judgement j{.scene = scene, .device = device, .sheets = sheets, .options = options};
  j.tool = make_tool(scene.tool);
  j.path = hand_trajectory(scene);
  j.end_s =
      static_cast<double>(tick_count(options.duration_s, options.rate_Hz) - 1) / options.rate_Hz;
  j.let_go_s = std::min(j.end_s, scene.hand.let_go_t_s.value_or(j.end_s));
  j.report = judge_path(j.path, device, options.limits, j.tool, 0, j.let_go_s);
  const Pose& T_device_tool = j.path.keyframes.front().T_device_tool;
  const Pose start{T_device_tool.p_m - T_device_tool.q * j.tool.tip_plate_m, T_device_tool.q};
  if (inverse_kinematics(device, start).status) {
    Result<Trial> trial = run_trial(scene, device, sheets, options);
    if (!trial) return trial.error();
    if (options.stop != nullptr && options.stop->load()) return refused("interrupted");
    j.trial = std::move(*trial);
  }
  for (std::size_t i = 0; i < sheets.size(); ++i)
    j.views.push_back(view_sheet(j, i));

  const Result<SceneNeeds> needs = describe_needs(scene, device, sheets, touching_poses(j), bytes,
                                                  options.rate_Hz, options.duration_s);
  if (!needs) return needs.error();
  SceneCheck check;
  check.text = needs->scene + describe_reach(j) + describe_path(j) + describe_trial(j);
  for (std::size_t i = 0; i < sheets.size(); ++i)
    check.text += describe_slice(j, i, needs->slices[i], tissues[i].choice);
  check.warnings = find_warnings(j, tissues);
  return check;
}

}  // namespace trocar::runtime
