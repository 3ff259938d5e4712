// SPDX-License-Identifier: Apache-2.0
#include "runtime/check/scene_check.h"

#include "formats/base/text.h"
#include "runtime/check/needle_path.h"
#include "runtime/session/force_law_table.h"
#include "runtime/session/live_hand.h"
#include "runtime/session/open_device.h"

namespace trocar::runtime {
namespace {

constexpr std::size_t kMaxListed = 12;  // number of labels, tissues or runs of slices

std::string quoted(const std::string& name) {
  return '"' + name + '"';
}

/// Returns the first kMaxListed elements of a list, separated by ", ", followed by a text such as
/// "and 7 more".
template <typename List, typename Describe>
std::string listed(const List& list, Describe&& describe) {
  std::string text;
  std::size_t count = 0;
  for (const auto& each : list) {
    if (++count > kMaxListed) break;
    if (!text.empty()) text += ", ";
    text += describe(each);
  }
  if (list.size() > kMaxListed)
    text += " and " + std::to_string(list.size() - kMaxListed) + " more";
  return text;
}

std::string describe_labels(const std::vector<int>& labels) {
  return (labels.size() == 1 ? "label " : "labels ") +
         listed(labels, [](int label) { return std::to_string(label); });
}

/// Returns true if a slice can get this tissue by its labels or HU, without naming it.
bool is_chosen_by_slice(const NamedTissue& tissue) {
  return tissue.hu || !tissue.labels.empty();
}

std::string describe_condition(const NamedTissue& tissue) {
  return quoted(tissue.name) + ' ' +
         (tissue.hu ? text_line("%.6g to %.6g HU", (*tissue.hu)[0], (*tissue.hu)[1])
                    : describe_labels(tissue.labels));
}

/// Describes slices that no tissue fits, by labels and range of mean HU.
std::string describe_slices(const std::vector<const SliceTissue*>& slices) {
  double lowest = INFINITY, highest = -INFINITY;
  for (const SliceTissue* each : slices) {
    if (!each->choice.mean_hu) continue;
    lowest = std::min(lowest, *each->choice.mean_hu);
    highest = std::max(highest, *each->choice.mean_hu);
  }
  const std::vector<int>& labels = slices.front()->choice.asset_labels;
  std::string text = labels.empty() ? "" : describe_labels(labels) + ", ";
  if (!(lowest <= highest)) return text + "no mean HU in the asset";
  text += text_line("mean HU %.0f", lowest);
  return std::round(lowest) == std::round(highest) ? text : text + text_line(" to %.0f", highest);
}

/// Reason why the tool does not touch a slice.
enum class Miss : std::uint8_t {
  kTouched,      ///< touched, or unknown because the dry run had a fault or ended too early
  kBeginsBelow,  ///< the path begins below the slice and never comes from above
  kStaysAbove,   ///< the path never goes below the slice
  kTooLate,      ///< the path goes below the slice only after the session's end
  kLetGo,        ///< the path goes below the slice only after the hand has let go
  kMissed,       ///< too little material is under the tool where the path crosses the slice
  kHeld,         ///< forces keep the tool from following the path down to the slice
};

/// The crossing of the hand's path with a sheet, and why the tool does not touch this sheet.
struct SheetView {
  /// The first crossing before the hand lets go that has enough material under the tool. If there
  /// is no such crossing, the first of all crossings. None: the path does not cross the sheet.
  std::optional<SheetCrossing> crossing;
  Miss miss = Miss::kTouched;
};

/// Everything from which the text and the warnings of a check are made.
struct SceneEvaluation {
  const Scene& scene;
  const DeviceSpecification& device;
  const std::vector<std::unique_ptr<const Sheet>>& sheets;
  const SessionOptions& options;
  Tool tool = make_tool(scene.tool);
  HandTrajectory path = hand_trajectory(scene);
  double end_s = 0;                 ///< time of the last tick
  double let_go_s = 0;              ///< time until which the hand holds the tool, at most end_s
  PathReport report{};              ///< the path up to let_go_s, or to the end of the dry run
  std::optional<DryRun> dry_run{};  ///< none: the session cannot start, or the hand is live
  /// Force law `cutting` only: the result of try_letting_go(), if the dry run had contact
  /// and no fault.
  std::optional<LetGoTrial> let_go{};
  std::vector<SheetView> views{};

  /// Returns true if the dry run had a fault, or if there is no dry run.
  bool has_fault() const { return !dry_run || dry_run->fault != Fault::kNone; }
  /// Time at which the dry run ended; 0: there was none.
  double dry_run_end_s() const {
    return dry_run ? static_cast<double>(dry_run->ticks) / options.rate_Hz : 0;
  }
};

/// Returns the force at which a sheet is punctured, as the device renders it. None: the force law
/// `cutting` cuts the sheet's tissue (Tissue::cut), which breaks at the strength under the tool.
std::optional<double> rendered_threshold_N(const SceneEvaluation& e, std::size_t index) {
  const Tissue& tissue = e.sheets[index]->tissue;
  if (e.scene.force_law.kind == ForceLawKind::kCutting && tissue.cut) return std::nullopt;
  return e.scene.force_law.force_scale * tissue.threshold_N;
}

/// Returns a text such as "x -0.050 to 0.050, y -0.050 to 0.050 m".
std::string describe_rectangle(const WorkspaceRectangle& rectangle) {
  return text_line("x %.3f to %.3f, y %.3f to %.3f m", rectangle.min_m.x(), rectangle.max_m.x(),
                   rectangle.min_m.y(), rectangle.max_m.y());
}

// Limits of ContactFeel.
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
    const std::string what = e.report.breach ? e.report.breach->what : "out of reach";
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
  // The rest of a long session is judged by its path, at as many places as the dry run has ticks.
  const double rest_s = e.let_go_s - e.dry_run_end_s();
  if (!(rest_s > 0)) return std::nullopt;
  const double rate_Hz = std::min(e.options.rate_Hz, static_cast<double>(kMaxDryRunTicks) / rest_s);
  const auto breach = evaluate_path(e.path, e.device, e.options.limits, e.tool, rate_Hz, e.let_go_s,
                                    e.dry_run_end_s())
                          .breach;
  if (!breach) return std::nullopt;
  return at_time(breach->t_s) + "the path leads to the fault " + to_string(breach->fault) + ": " +
         breach->what + ": " +
         advise(e, breach->fault, hand_target(e.path, breach->t_s).T_device_tool.p_m);
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

bool gives_warning(const LetGoTrial& trial) {
  return trial.fault != Fault::kNone || trial.speed_m_per_s > kMaxLetGo_m_per_s ||
         trial.distance_m > kMaxLetGo_m;
}

/// Warns of contact that does not feel like bone.
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
  else if (gives_warning(trial))
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

/// Warns of what the hand's path and the dry run show.
void warn_of_session(const SceneEvaluation& e, std::vector<std::string>& warnings) {
  if (const auto end = warn_of_end(e)) warnings.push_back(*end);
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
  if (e.dry_run && e.dry_run->hole_error)
    warnings.push_back("a hole cannot be cut: " + e.dry_run->hole_error->message);
  warn_of_feel(e, warnings);
}

void warn_of_live_hand(const SceneEvaluation& e, const Result<LiveHandLimits>& hand,
                       std::vector<std::string>& warnings) {
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
}

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

/// Follows the path and does a dry run. With a live hand there is no dry run, and SheetView::miss
/// is kTouched for every sheet. If the device cannot reach the hand's first pose, this is no error,
/// but the result has no dry run.
Result<SceneEvaluation> evaluate(const Scene& scene, const DeviceToCheck& device,
                                 const std::vector<std::unique_ptr<const Sheet>>& sheets,
                                 const SessionOptions& options, CheckExtent extent) {
  SceneEvaluation e{
      .scene = scene, .device = device.specification, .sheets = sheets, .options = options};
  const std::uint64_t ticks = tick_count(options.duration_s, options.rate_Hz);
  e.end_s = static_cast<double>(ticks - 1) / options.rate_Hz;
  e.let_go_s = std::min(e.end_s, scene.hand.let_go_t_s.value_or(e.end_s));
  e.report =
      evaluate_path(e.path, e.device, options.limits, e.tool, options.rate_Hz,
                    std::min(e.let_go_s, static_cast<double>(kMaxDryRunTicks) / options.rate_Hz));
  if (scene.hand.live) {
    e.views.resize(sheets.size());
    return e;
  }
  const auto first = device.simulate(scene);
  if (!first && first.error().code != ExitCode::kRefused) return first.error();
  if (first) {  // otherwise the session cannot start
    if (const auto ok = run_dry_run(scene, device, sheets, options).into(e.dry_run); !ok)
      return ok.error();
  }
  for (std::size_t i = 0; i < sheets.size(); ++i)
    e.views.push_back(view_sheet(e, i));
  std::vector<std::string> warnings;
  if (extent == CheckExtent::kUntilWarned) warn_of_session(e, warnings);
  if (e.dry_run && scene.force_law.kind == ForceLawKind::kCutting && warnings.empty()) {
    auto let_go =
        try_letting_go(scene, device, sheets, options, *e.dry_run, [&](const auto& trial) {
          return extent == CheckExtent::kUntilWarned && gives_warning(trial);
        });
    if (!let_go) return let_go.error();
    e.let_go = *let_go;
  }
  return e;
}

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
  if (e.has_fault() || !r.breach) return out;
  return out + text_line(
                   "           at %.4f s the hand pulls beyond a limit (%s), but the tool does "
                   "not get there\n",
                   r.breach->t_s, r.breach->what.c_str());
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
    out += text_line(", %.6g of %.6g s; what comes after that is judged by the path alone",
                     e.dry_run_end_s(), e.options.duration_s);
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

/// Describes what the scene, without its slices, takes: bytes that are loaded and kept, ticks and tool.
std::string describe_scene(const SceneEvaluation& e, const LoadedBytes& bytes) {
  // A sheet needs memory for its mesh and for two grids in which triangles are searched. The sheet's replicas
  // (runtime/session/remesher.h) share it. If holes change the mesh, a replica needs more bytes, which are not counted.
  std::uint64_t kept = 0;
  for (const auto& sheet : e.sheets)
    kept += sheet->mesh.bytes() + sheet->grid.bytes() + sheet->boundary_grid.bytes();
  std::string out = text_line("scene      %s\n", e.scene.name.c_str());
  out += text_line(
      "asset      %s: %zu of its %zu slices, %.1f of its %.1f kB read, %.1f kB kept in memory\n",
      e.scene.asset.c_str(), e.sheets.size(), bytes.asset_slices,
      static_cast<double>(bytes.read) / 1e3, static_cast<double>(bytes.asset) / 1e3,
      static_cast<double>(kept) / 1e3);
  out += "device     " + std::string(e.device.name()) + ", " + e.device.describe_strength() + "\n";
  out += text_line(
      "loop       %.6g Hz for %.6g s: %llu ticks\n", e.options.rate_Hz, e.options.duration_s,
      static_cast<unsigned long long>(tick_count(e.options.duration_s, e.options.rate_Hz)));
  return out + text_line("tool       %d corners, %.3g mm from the axis\n", e.tool.sides,
                         (e.tool.corner_plate_m[0] - e.tool.tip_plate_m).norm() * 1e3);
}

std::string describe_slice(const SceneEvaluation& e, std::size_t index, ForceLaw& law,
                           const TissueChoice& choice) {
  const Sheet& sheet = *e.sheets[index];
  const std::optional<SheetCrossing>& crossing = e.views[index].crossing;
  const TipForce tip = law.tip_force(index, sheet);
  std::string out =
      text_line("slice %-4d at %.4f m: %zu vertices, %zu triangles; %.6g N/m up to %.6g N",
                sheet.slice_index, sheet.z_m, sheet.mesh.vertices_in_use(),
                sheet.mesh.triangles_in_use(), tip.stiffness_N_per_m, tip.threshold_N);
  out += "; " + describe_choice(e.scene, choice) + "\n           ";
  out += crossing ? text_line(
                        "the path goes through at %.4f s at (%.4f, %.4f) m: %.0f %% of the "
                        "tool over material; ",
                        crossing->t_s, crossing->tip_m.x(), crossing->tip_m.y(),
                        100 * crossing->coverage)
                  : std::string(e.scene.hand.live ? "" : "the path does not go through; ") +
                        "at the anchor ";
  // A pose in which the tool is assumed to touch the sheet, and the one in which it breaks there.
  const Pose touching = crossing && is_upright(e.tool, crossing->T_device_plate)
                            ? crossing->T_device_plate
                            : over_anchor(sheet, e.tool);
  Pose breaking = touching;
  breaking.p_m.z() -= tip.threshold_N / tip.stiffness_N_per_m;
  out += e.device.describe_demand("threshold", breaking,
                                  wrench_at({0, 0, tip.scale * tip.threshold_N},
                                            breaking * e.tool.tip_plate_m, breaking)) +
         law.describe_sheet(index, sheet, touching) + '\n';
  if (!e.dry_run || !e.dry_run->sheets[index].touched) return out;
  const SheetDryRun& dry_run = e.dry_run->sheets[index];
  out += text_line("           touched at %.4f s, bears at most %.2f", dry_run.touched_t_s,
                   dry_run.force_max_N);
  const std::optional<double> threshold_N = rendered_threshold_N(e, index);
  out += threshold_N ? text_line(" of %.6g N", *threshold_N) : std::string(" N");
  return out + (dry_run.punctured_t_s >= 0
                    ? text_line(", punctured at %.4f s\n", dry_run.punctured_t_s)
                    : std::string(", not punctured\n"));
}

}  // namespace

std::string name_slices(std::vector<int> slices) {
  std::sort(slices.begin(), slices.end());
  slices.erase(std::unique(slices.begin(), slices.end()), slices.end());
  std::vector<std::string> runs;
  for (std::size_t i = 0; i < slices.size();) {
    std::size_t end = i + 1;
    while (end < slices.size() && slices[end] == slices[end - 1] + 1)
      ++end;
    std::string run = std::to_string(slices[i]);
    if (end - i > 1) run += '-' + std::to_string(slices[end - 1]);
    runs.push_back(std::move(run));
    i = end;
  }
  return (slices.size() == 1 ? "slice " : "slices ") +
         listed(runs, [](const std::string& run) { return run; });
}

std::vector<SliceTissue> choose_tissues(const Scene& scene, const Asset& asset) {
  std::vector<SliceTissue> tissues;
  for (const SceneSlice& wanted : scene.slices) {
    const auto slice =
        std::find_if(asset.slices.begin(), asset.slices.end(),
                     [&](const AssetSlice& each) { return each.index == wanted.index; });
    if (slice == asset.slices.end()) continue;
    tissues.push_back({wanted.index, wanted.z_m, choose_tissue(scene, wanted, asset, *slice)});
  }
  std::sort(tissues.begin(), tissues.end(),
            [](const SliceTissue& a, const SliceTissue& b) { return a.z_m > b.z_m; });
  return tissues;
}

std::string describe_choice(const Scene& scene, const TissueChoice& choice) {
  switch (choice.reason) {
    case TissueReason::kNamed:
      return "tissue " + quoted(choice.name) + ": named by the slice";
    case TissueReason::kLabel:
      return "tissue " + quoted(choice.name) + ": the asset's " +
             describe_labels(choice.asset_labels);
    case TissueReason::kMeanHu:
      return "tissue " + quoted(choice.name) + text_line(": mean HU %.0f", *choice.mean_hu);
    case TissueReason::kDefault:
      break;
  }
  std::string whose = scene.tissue_is_given ? "the scene's \"tissue\"" : "the default tissue";
  if (std::none_of(scene.tissues.begin(), scene.tissues.end(), is_chosen_by_slice)) return whose;
  return whose + (choice.mean_hu ? text_line(": no other fits mean HU %.0f", *choice.mean_hu)
                                 : std::string(": no other fits"));
}

std::optional<std::string> warn_of_unfitting(const Scene& scene,
                                             const std::vector<SliceTissue>& tissues) {
  if (scene.tissue_is_given) return std::nullopt;
  std::vector<const NamedTissue*> conditions;
  for (const NamedTissue& tissue : scene.tissues) {
    if (is_chosen_by_slice(tissue)) conditions.push_back(&tissue);
  }
  if (conditions.empty()) return std::nullopt;
  std::vector<const SliceTissue*> unfitting;
  std::vector<int> slices;
  for (const SliceTissue& each : tissues) {
    if (each.choice.reason != TissueReason::kDefault) continue;
    unfitting.push_back(&each);
    slices.push_back(each.slice);
  }
  if (unfitting.empty()) return std::nullopt;
  return name_slices(slices) + ": none of the scene's tissues fits (" + describe_slices(unfitting) +
         "; the scene has " +
         listed(conditions, [](const NamedTissue* each) { return describe_condition(*each); }) +
         text_line("): the default of %.6g N/m and %.6g N is taken; ",
                   scene.tissue.stiffness_N_per_m, scene.tissue.threshold_N) +
         "change a tissue's labels or hu, name a tissue in the slice, or give the scene a "
         "\"tissue\"";
}

Result<SceneCheck> check_scene(const Scene& scene, const DeviceToCheck& device,
                               const std::vector<std::unique_ptr<const Sheet>>& sheets,
                               const std::vector<SliceTissue>& tissues, const LoadedBytes& bytes,
                               const SessionOptions& options, CheckExtent extent) {
  Result<SceneEvaluation> evaluated = evaluate(scene, device, sheets, options, extent);
  if (!evaluated) return evaluated.error();
  SceneEvaluation& e = *evaluated;
  std::vector<const Sheet*> all;
  all.reserve(sheets.size());
  for (const auto& sheet : sheets)
    all.push_back(sheet.get());
  const auto law =
      make_force_law({scene, e.device, all, options.rate_Hz, options.coupling, options.stiffness});
  if (!law) return law.error();
  SceneCheck check;
  check.text = describe_scene(e, bytes) + (*law)->describe() + describe_workspace(e);
  if (scene.hand.live) {
    const Result<LiveHandLimits> hand = live_hand_limits(scene, e.device, options.limits);
    if (hand) check.text += describe_live_hand(*hand);
    warn_of_live_hand(e, hand, check.warnings);
  } else {
    check.text += describe_path(e) + describe_dry_run(e);
    warn_of_session(e, check.warnings);
  }
  if (const auto unfitting = warn_of_unfitting(scene, tissues))
    check.warnings.push_back(*unfitting);
  if (const auto target = warn_of_target(e)) check.warnings.push_back(*target);
  for (std::size_t i = 0; i < sheets.size(); ++i)
    check.text += describe_slice(e, i, **law, tissues[i].choice);
  if (options.is_stopped()) return interrupted();
  if (const std::string unstable = (*law)->contact_warning(); !unstable.empty())
    check.warnings.push_back(unstable);
  check.dry_run = std::move(e.dry_run);
  return check;
}

}  // namespace trocar::runtime
