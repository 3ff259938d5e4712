// SPDX-License-Identifier: Apache-2.0
#include "runtime/checking/new_scene.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "formats/base/text_line.h"
#include "formats/session/scene.h"
#include "runtime/bone_cutting/material/bone_volume.h"
#include "runtime/checking/entry_column.h"
#include "runtime/checking/scene_check.h"
#include "runtime/checking/tissue_assignment.h"
#include "runtime/contact/sheet.h"
#include "runtime/devices/tip_workspace.h"

namespace trocar::runtime {
namespace {

using json = nlohmann::ordered_json;  // ordered, because people read scenes

constexpr double kNeedle_m = 0.0015, kPaperTool_m = 0.003;  // radii of tools
constexpr double kAbove_m = 0.006, kBelow_m = 0.013;        // length of the path beyond the slices
constexpr double kWorkspaceMargin_m = 0.004;
// Distance of slices at which each is felt separately: a puncture takes 7 mm.
constexpr double kApart_m = 0.0095;
constexpr std::size_t kMaxSlices = 5;

/// Rounds to a multiple of 1 / parts.
double rounded(double value, double parts) {
  return std::round(value * parts) / parts;
}

json keyframe(double t_s, double z_m) {
  return {{"t_s", rounded(t_s, 1e3)}, {"tip_m", {0, 0, rounded(z_m, 1e5)}}};
}

class Proposal {
 public:
  Proposal(const Asset& asset, const std::filesystem::path& asset_file,
           const std::filesystem::path& scene_file, const DeviceToCheck& device,
           const SessionOptions& options, NewSceneHand hand)
      : asset_(asset),
        asset_file_(asset_file),
        scene_file_(scene_file),
        device_(device),
        options_(options),
        hand_(hand) {}

  Result<NewScene> make() {
    if (auto ok = find_levels(); !ok) return ok.error();
    const std::string name = asset_file_.string();
    const auto heights =
        workspace_heights(device_.specification, options_.limits, make_tool(SceneTool{}));
    if (!heights) return refused(name + ": the device reaches nothing; choose another description");
    low_m_ = heights->min_m + kWorkspaceMargin_m;
    high_m_ = heights->max_m - kWorkspaceMargin_m;
    const double height_mm = 1e3 * (high_m_ - low_m_ - kAbove_m - kBelow_m);
    std::string why;  // reason why the last scene was not accepted
    std::string no_volume = has_hu_ ? "its slices are more than 3 mm apart" : "the asset has no HU";
    if (has_hu_) {
      const double gap_mm = 1e3 * (kMaxSlabGap_m + kSlabGapRounding_m);
      const auto column = find_entry_column(asset_, levels_, 1e3 * kNeedle_m, height_mm, gap_mm);
      if (column && column->last > column->first) {
        no_volume = "every session through a volume of its slices has a warning";
        for (const double force_scale : {0.5, 0.35, 0.25, 0.2, 0.15, 0.1}) {
          if (is_stopped()) return refused("interrupted");
          if (auto made = try_scene(cutting(*column, force_scale * weakness()), why))
            return finish(*made, *column,
                          "the law cutting with strength by HU, since the asset has HU and its "
                          "slices are close enough to be one bone volume");
        }
      }
    }
    const auto column = find_entry_column(asset_, levels_, 1e3 * kPaperTool_m, height_mm,
                                          std::numeric_limits<double>::max());
    if (!column && why.empty())
      return refused(name + text_line(": its bone is nowhere as wide as the tool, %.0f mm across: "
                                      "nothing can be punctured",
                                      2e3 * kPaperTool_m));
    for (const double threshold_N : {35.0, 20.0, 10.0}) {
      if (!column) break;
      if (is_stopped()) return refused("interrupted");
      if (auto made = try_scene(sheets(*column, threshold_N), why))
        return finish(*made, *column,
                      "the law hooke with the paper's tissue and slices at least 9.5 mm apart, so "
                      "that each is felt, since " +
                          no_volume);
    }
    return refused(name + ": no scene was found that runs without a warning; the last was: " + why);
  }

 private:
  bool is_stopped() const { return options_.stop != nullptr && options_.stop->load(); }

  /// Returns the share of a force along the tool that a device with a workspace of its own renders in the middle of it.
  double rendered_share(double force_N) const {
    if (!device_.specification.workspace()) return 1;
    Wrench up = Wrench::Zero();
    up[2] = force_N;
    return device_.specification.renderable_share(
        Pose{{0, 0, (low_m_ + high_m_) / 2}, {1, 0, 0, 0}}, up);
  }
  /// Factor on the force scales that are tried; 1 for a device that renders half of what bone bears.
  double weakness() const {
    constexpr double kBone_N = 100;
    return device_.specification.workspace() ? 2 * rendered_share(kBone_N) : 1;
  }

  Result<void> find_levels() {
    const std::string name = asset_file_.string();
    has_hu_ = true;
    for (const AssetSlice& slice : asset_.slices) {
      if (slice.mesh.triangles.empty()) continue;
      levels_.push_back({&slice, slice.z_mm});
      has_hu_ = has_hu_ && (!slice.hu.empty() || asset_.hu.find(slice.index) != nullptr);
    }
    if (levels_.empty())
      return refused(name +
                     ": no slice has material: nothing can be punctured; mesh the scan with "
                     "a lower threshold");
    std::sort(levels_.begin(), levels_.end(),
              [](const Level& a, const Level& b) { return a.z_mm > b.z_mm; });
    for (std::size_t i = 1; i < levels_.size(); ++i) {
      if (!(levels_[i - 1].z_mm - levels_[i].z_mm >= 1e3 * kMinSliceGap_m))
        return refused(name + ": slices " + std::to_string(levels_[i].slice->index) + " and " +
                       std::to_string(levels_[i - 1].slice->index) +
                       " are less than 0.1 mm apart: it has no true spacing for a scene");
    }
    return {};
  }

  std::string describe_asset() const {
    const MaterialBox box = material_box(asset_, levels_);
    return text_line(
        "%zu of %zu slices have material, within u %.1f to %.1f, v %.1f to %.1f mm and %.1f mm of "
        "height",
        levels_.size(), slice_count(asset_), box.low_mm[0], box.high_mm[0], box.low_mm[1],
        box.high_mm[1], levels_.front().z_mm - levels_.back().z_mm);
  }

  json head(const EntryColumn& column) const {
    std::error_code failed;
    std::filesystem::path folder = scene_file_.parent_path();
    if (folder.empty()) folder = ".";
    std::filesystem::path asset = asset_file_.is_absolute()
                                      ? asset_file_
                                      : std::filesystem::relative(asset_file_, folder, failed);
    if (failed || asset.empty()) asset = std::filesystem::absolute(asset_file_, failed);
    return {{"schema", kSceneSchema},
            {"name", "Proposed for " + asset_file_.filename().string()},
            {"asset", asset.generic_string()},
            {"placement",
             {{"anchor_mm", {rounded(column.at_mm[0], 100), rounded(column.at_mm[1], 100)}}}}};
  }

  /// Returns the height of the topmost slice with which the scene is in the middle
  /// of the workspace.
  double top_of(double thickness_m) const {
    const double free_m = high_m_ - low_m_ - kAbove_m - kBelow_m - thickness_m;
    return rounded(high_m_ - kAbove_m - std::max(0.0, free_m) / 2, 1e4);
  }

  json hand(double top_m, double bottom_m, double speed_m_per_s, bool returns, json& scene) const {
    constexpr double kRest_s = 0.2;
    const double from_m = top_m + kAbove_m, to_m = bottom_m - kBelow_m;
    const double down_s = kRest_s + (from_m - to_m) / speed_m_per_s;
    json keys = {keyframe(0, from_m), keyframe(kRest_s, from_m), keyframe(down_s, to_m)};
    double end_s = down_s + 0.3;
    if (returns) {
      keys.push_back(keyframe(down_s + 0.5, to_m));
      end_s = down_s + 0.5 + (from_m - to_m) / speed_m_per_s / 1.5;
      keys.push_back(keyframe(end_s, from_m));
      end_s += 0.2;
    }
    scene["duration_s"] = rounded(end_s, 100);
    return {
        {"stiffness_N_per_m", 8000}, {"damping_N_s_per_m", 140}, {"trajectory", std::move(keys)}};
  }

  json cutting(const EntryColumn& column, double force_scale) const {
    json scene = head(column);
    const double thickness_m = 1e-3 * (levels_[column.first].z_mm - levels_[column.last].z_mm);
    const double top_m = top_of(thickness_m);
    const int a = levels_[column.first].slice->index, b = levels_[column.last].slice->index;
    scene["body"] = {{"from", std::min(a, b)}, {"to", std::max(a, b)}, {"top_z_m", top_m}};
    scene["tissue"] = {{"cut",
                        {{"bone", {{"law", "kopperdahl-power"}}},
                         {"tearing_N_per_m", 500},
                         {"friction_kPa", 60},
                         {"bed_N_per_mm3", 30},
                         {"lateral_strength_MPa", 5}}}};
    scene["force_law"] = {{"kind", "cutting"}, {"force_scale", force_scale}};
    scene["tool"] = {{"sides", 12}, {"radius_m", kNeedle_m}};
    scene["hand"] = hand(top_m, top_m - thickness_m, 0.0115, true, scene);
    return scene;
  }

  json sheets(const EntryColumn& column, double threshold_N) const {
    json scene = head(column);
    std::vector<const Level*> chosen;
    for (std::size_t i = column.first; i <= column.last && chosen.size() < kMaxSlices; ++i) {
      if (column.is_clear[i] == 0) continue;
      if (chosen.empty() || chosen.back()->z_mm - levels_[i].z_mm >= 1e3 * kApart_m)
        chosen.push_back(&levels_[i]);
    }
    const double thickness_m = 1e-3 * (chosen.front()->z_mm - chosen.back()->z_mm);
    const double top_m = top_of(thickness_m);
    scene["slices"] = json::array();
    for (const Level* level : chosen)
      scene["slices"].push_back(
          {{"index", level->slice->index},
           {"z_m", rounded(top_m - 1e-3 * (chosen.front()->z_mm - level->z_mm), 1e7)}});
    scene["tissue"] = {{"stiffness_N_per_m", 5000}, {"threshold_N", threshold_N}};
    scene["force_law"] = {{"kind", "hooke"}};
    const double share = rendered_share(threshold_N);
    if (share < 1) scene["force_law"]["force_scale"] = std::floor(1e3 * share) / 1e3;
    scene["tool"] = {{"sides", 6}, {"radius_m", kPaperTool_m}};
    scene["hand"] = hand(top_m, top_m - thickness_m, 0.0175, false, scene);
    return scene;
  }

  struct Tried {
    std::string json;
    double force_max_N = 0;
    std::size_t punctured = 0, sheets = 0;
  };

  /// Returns the first warning of a scene, or the reason why it is refused; none: it has no problem.
  std::optional<std::string> first_problem(const Scene& scene,
                                           const std::vector<std::unique_ptr<const Sheet>>& sheets,
                                           const SessionOptions& options) const {
    const Result<SceneCheck> check =
        check_scene(scene, device_, sheets, choose_tissues(scene, asset_), {}, options);
    if (!check) return check.error().message;
    if (!check->warnings.empty()) return check->warnings.front();
    return std::nullopt;
  }

  /// Replaces the path of a scene's hand by a live hand at its start.
  static json with_live_hand(json scene) {
    json& hand = scene["hand"];
    json start = hand["trajectory"][0];
    hand["live"] = true;
    hand["trajectory"] = json::array({std::move(start)});
    scene["duration_s"] = 600;
    return scene;
  }

  /// Tries a scene. Returns none, with the reason in `why`, if it is refused, has a warning,
  /// or punctures nothing.
  std::optional<Tried> try_scene(const json& proposed, std::string& why) const {
    Tried tried;
    const auto text = [](const json& of) {
      return of.dump(2, ' ', false, json::error_handler_t::replace) + "\n";
    };
    tried.json = text(proposed);
    const std::string name = asset_file_.string();
    Result<Scene> scene = parse_scene(tried.json, scene_file_.string(), scene_file_.parent_path());
    const auto fails = [&](const std::string& reason) {
      why = reason;
      return std::nullopt;
    };
    if (!scene) return fails(scene.error().message);
    if (const auto placed = place_body(*scene, asset_, name); !placed)
      return fails(placed.error().message);
    auto sheets = place_slices(*scene, asset_, name);
    if (!sheets) return fails(sheets.error().message);
    SessionOptions options = options_;
    options.duration_s = scene->duration_s;
    if (device_.set_options) device_.set_options(*scene, options);
    if (const auto problem = first_problem(*scene, *sheets, options)) return fails(*problem);
    const Result<DryRun> dry_run = run_dry_run(*scene, device_, *sheets, options);
    if (!dry_run) return fails(dry_run.error().message);
    tried.force_max_N = dry_run->force_max_N;
    tried.sheets = dry_run->sheets.size();
    for (const SheetDryRun& each : dry_run->sheets)
      tried.punctured += each.punctured_t_s >= 0 ? 1 : 0;
    if (tried.punctured == 0) return fails("the tool punctures nothing");
    if (hand_ == NewSceneHand::kScripted) return tried;
    const json live = with_live_hand(proposed);
    tried.json = text(live);
    scene->hand.live = true;
    scene->hand.trajectory.resize(1);
    if (device_.set_options) device_.set_options(*scene, options);
    if (const auto problem = first_problem(*scene, *sheets, options)) return fails(*problem);
    return tried;
  }

  NewScene finish(const Tried& made, const EntryColumn& column, const std::string& because) const {
    const int a = levels_[column.first].slice->index, b = levels_[column.last].slice->index;
    NewScene out;
    out.json = made.json;
    out.text =
        asset_file_.string() + ": " + describe_asset() +
        text_line(
            "; its bone is thickest at u %.2f, v %.2f mm, where it is %.1f mm thick "
            "around the tool, within slices %d to %d: that is the entry point, and "
            "lies over the middle of the device. ",
            column.at_mm[0], column.at_mm[1], column.thickness_mm, std::min(a, b), std::max(a, b)) +
        "Chosen: " + because +
        text_line(
            ". Slices are at their true spacing, in the middle of the heights %.3f to "
            "%.3f m that the tip reaches. A dry run punctured %zu of %zu slices, with at "
            "most %.1f N, and --check has no warning. ",
            low_m_ - kWorkspaceMargin_m, high_m_ + kWorkspaceMargin_m, made.punctured, made.sheets,
            made.force_max_N) +
        (hand_ == NewSceneHand::kLive ? "That was with a scripted hand; the hand is now live: "
                                        "start the scene with trocar-console. "
                                      : "") +
        "For training, not for planning.\n";
    return out;
  }

  const Asset& asset_;
  const std::filesystem::path &asset_file_, &scene_file_;
  const DeviceToCheck& device_;
  const SessionOptions& options_;
  NewSceneHand hand_;
  std::vector<Level> levels_;      ///< levels of the asset, the topmost first
  bool has_hu_ = false;            ///< every slice with material has HU
  double low_m_ = 0, high_m_ = 0;  ///< heights of the tip that the proposal uses
};

}  // namespace

Result<NewScene> propose_scene(const Asset& asset, const std::filesystem::path& asset_file,
                               const std::filesystem::path& scene_file, const DeviceToCheck& device,
                               const SessionOptions& options, NewSceneHand hand) {
  return Proposal(asset, asset_file, scene_file, device, options, hand).make();
}

}  // namespace trocar::runtime
