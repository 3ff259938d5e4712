// SPDX-License-Identifier: Apache-2.0
#include "runtime/checking/new_scene.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "formats/base/text_line.h"
#include "formats/session/scene.h"
#include "runtime/bone_cutting/material/bone_volume.h"
#include "runtime/checking/scene_check.h"
#include "runtime/checking/scene_draft.h"
#include "runtime/checking/tissue_assignment.h"
#include "runtime/contact/sheet.h"
#include "runtime/device/pose.h"
#include "runtime/devices/pose_margins.h"
#include "runtime/devices/tip_workspace.h"

namespace trocar::runtime {
namespace {

constexpr double kWorkspaceMargin_m = 0.004;
// A scripted hand is sent farther until the tip ends this near the target, so often at most.
constexpr double kReached_m = 0.0015;
constexpr int kMaxReaches = 5;
constexpr double kAny = std::numeric_limits<double>::max();
constexpr const char *kWhyCutting =
                         "the law cutting with strength by HU, since the asset has HU and its "
                         "slices are close enough to be one bone volume",
                     *kWhySheets =
                         "the law hooke with the paper's tissue and slices at least 9.5 mm apart, "
                         "so that each is felt, since ",
                     *kNoSession =
                         "every session through a volume of its slices has a warning or "
                         "does not run; the last: ";

/// The arguments of propose_scene(), and what is found on the way to a scene.
struct Proposal {
  const Asset& asset;
  const std::filesystem::path &asset_file, &scene_file;
  const DeviceToCheck& device;
  const SessionOptions& options;
  const NewSceneChoices& choices;

  Result<NewScene> make() {
    if (auto ok = find_levels(); !ok) return ok.error();
    if (auto ok = find_heights(); !ok) return ok.error();
    std::string why;        // reason why the last scene was not accepted
    std::string no_volume;  // reason why there is no scene with the law cutting
    const Result<std::optional<NeedlePath>> volume = path_through_volume(no_volume);
    if (!volume) return volume.error().after(asset_file.string() + ": ");
    if (*volume) {
      for (const double force_scale : {0.5, 0.35, 0.25, 0.2, 0.15, 0.1}) {
        if (options.is_stopped()) return interrupted();
        SceneDraft draft = draft_of(**volume);
        auto made = try_draft(draft, [&] { return draft.cutting(force_scale * weakness()); });
        if (made && made->warnings.empty()) return finish(*made, **volume, kWhyCutting);
        if (!made) why = made.error().message;
        no_volume = kNoSession + (made ? made->warnings.front() : why);
        keep(std::move(made), **volume, kWhyCutting);
      }
    }
    const Result<std::optional<NeedlePath>> apart = path_through_sheets();
    if (!apart) return apart.error().after(asset_file.string() + ": ");
    if (!*apart && why.empty())
      return refused(asset_file.string() +
                     text_line(": its bone is nowhere as wide as the tool, %.0f mm across: "
                               "nothing can be punctured",
                               2e3 * kPaperToolRadius_m));
    const std::string why_sheets = kWhySheets + no_volume;
    for (const double threshold_N : {35.0, 20.0, 10.0}) {
      if (!*apart) break;
      if (options.is_stopped()) return interrupted();
      SceneDraft draft = draft_of(**apart);
      auto made =
          try_draft(draft, [&] { return draft.sheets(threshold_N, rendered_share(threshold_N)); });
      if (made && made->warnings.empty()) return finish(*made, **apart, why_sheets);
      if (!made) why = made.error().message;
      keep(std::move(made), **apart, why_sheets);
    }
    if (kept) return finish(kept->tried, kept->path, kept->because);
    return refused(asset_file.string() +
                   (is_chosen()
                        ? ": no scene along this path runs; the last ended so: "
                        : ": no scene was found that runs without a warning; the last was: ") +
                   why);
  }

  struct Tried {
    std::string json;
    double force_max_N = 0;
    std::size_t punctured = 0, sheets = 0;
    std::vector<std::string> warnings;
  };
  /// A scene along a chosen path that runs, but with warnings.
  struct Kept {
    Tried tried;
    NeedlePath path;
    std::string because;
  };
  struct Placed {
    Scene scene;
    std::vector<std::unique_ptr<const Sheet>> sheets;
    SessionOptions options;
  };

  bool is_chosen() const { return choices.points.has_value(); }

  /// Returns the share of a force along the tool that a device with a workspace of its own renders in the middle of it.
  double rendered_share(double force_N) const {
    if (!device.specification.workspace()) return 1;
    Wrench up = Wrench::Zero();
    up[2] = force_N;
    return device.specification.renderable_fraction(
        Pose{{0, 0, (heights.min_m + heights.max_m) / 2}, {1, 0, 0, 0}}, up);
  }
  /// Factor on the force scales that are tried; 1 for a device that renders half of what bone bears.
  double weakness() const {
    constexpr double kBone_N = 100;
    return device.specification.workspace() ? 2 * rendered_share(kBone_N) : 1;
  }

  Result<void> find_levels() {
    const std::string name = asset_file.string();
    has_hu = true;
    for (const AssetSlice& slice : asset.slices) {
      if (slice.mesh.triangles.empty()) continue;
      levels.push_back({&slice, slice.z_mm});
      has_hu = has_hu && (!slice.hu.empty() || asset.hu.find(slice.index) != nullptr);
    }
    if (levels.empty())
      return refused(name +
                     ": no slice has material: nothing can be punctured; mesh the scan with "
                     "a lower threshold");
    std::sort(levels.begin(), levels.end(),
              [](const Level& a, const Level& b) { return a.z_mm > b.z_mm; });
    for (std::size_t i = 1; i < levels.size(); ++i) {
      if (!(levels[i - 1].z_mm - levels[i].z_mm >= 1e3 * kMinSliceGap_m))
        return refused(name + ": slices " + std::to_string(levels[i].slice->index) + " and " +
                       std::to_string(levels[i - 1].slice->index) +
                       " are less than 0.1 mm apart: it has no true spacing for a scene");
    }
    return {};
  }

  /// Finds the heights that the tip reaches with the plate turned along a chosen path.
  Result<void> find_heights() {
    Eigen::Quaterniond q = Eigen::Quaterniond::Identity();
    if (is_chosen()) {
      const auto path = plan_needle_path(asset, levels, *choices.points);
      if (!path) return path.error().after(asset_file.string() + ": ");
      const double max_deg = options.limits.plate_tilt_max_rad * kDegreesPerRadian;
      if (tilt_deg(*path) > max_deg)
        return refused(asset_file.string() +
                       text_line(": the path from the entry to the target is tilted by %.1f deg, "
                                 "and the device turns by at most %.1f deg: choose points more "
                                 "nearly above each other",
                                 tilt_deg(*path), max_deg));
      q = rotation_from_z(-path->direction);
    }
    const auto reached =
        workspace_heights(device.specification, options.limits, make_tool(SceneTool{}), q);
    if (!reached)
      return refused(asset_file.string() +
                     (is_chosen() ? ": the device does not reach any point with the needle tilted "
                                    "along this path"
                                  : ": the device reaches nothing; choose another description"));
    heights = {reached->min_m + kWorkspaceMargin_m, reached->max_m - kWorkspaceMargin_m};
    return {};
  }

  /// Height of the bone that a path may go through.
  double room_mm() const {
    return 1e3 * (heights.max_m - heights.min_m - height_outside_bone_m(NeedlePath{}));
  }

  /// `limits`: the limits of the path besides the workspace of the device.
  Result<NeedlePath> chosen_path(PathLimits limits) const {
    limits.height_mm = room_mm();
    auto path = plan_needle_path(asset, levels, *choices.points, limits);
    if (!path || !path->has_target) return path;
    const double depth_mm = path->entry_mm.z() - path->end_mm.z();
    const double max_mm = 1e3 * (heights.max_m - heights.min_m - height_outside_bone_m(*path));
    if (depth_mm > max_mm)
      return refused(
          text_line("the target lies %.1f mm below the entry, and the device has room "
                    "for %.1f mm: choose nearer points",
                    depth_mm, max_mm));
    return path;
  }

  /// Returns why the law cutting is not tried, if it is not.
  std::string why_no_volume() const {
    if (!has_hu) return "the asset has no HU";
    return levels.size() == 1 ? "the asset has a single slice with material"
                              : "its slices are more than 3 mm apart, or slices without material "
                                "lie between them";
  }

  /// Returns the path for the law cutting. None: its levels are not one volume with HU, or are
  /// more than a scene's volume may have; `why` then has the reason.
  Result<std::optional<NeedlePath>> path_through_volume(std::string& why) const {
    why = why_no_volume();
    if (!has_hu) return std::optional<NeedlePath>();
    const double gap_mm = 1e3 * (kMaxSlabGap_m + kSlabGapRounding_m);
    if (is_chosen()) {
      const auto path = chosen_path({.gap_mm = gap_mm, .slices = kMaxSceneSlices});
      if (!path) return path.error();
      if (path->last == path->first || path->max_gap_mm > gap_mm)
        return std::optional<NeedlePath>();
      const std::size_t slices = slices_between(levels[path->first], levels[path->last]);
      if (slices <= kMaxSceneSlices) return std::optional<NeedlePath>(*path);
      why = text_line(
          "the path to the target goes through %zu slices, and a bone volume has at "
          "most %zu: choose a nearer target or a scan with thicker slices",
          slices, kMaxSceneSlices);
      return std::optional<NeedlePath>();
    }
    const auto column = find_entry_column(asset, levels, 1e3 * kNeedleRadius_m, room_mm(), gap_mm);
    return column && column->last > column->first ? std::optional(path_through(*column, levels))
                                                  : std::nullopt;
  }

  /// Returns the path for single sheets, down to the last of them or to the target; none: there is none.
  Result<std::optional<NeedlePath>> path_through_sheets() const {
    std::optional<NeedlePath> path;
    if (is_chosen()) {
      const auto chosen = chosen_path({});
      if (!chosen) return chosen.error();
      path = *chosen;
    } else if (const auto column =
                   find_entry_column(asset, levels, 1e3 * kPaperToolRadius_m, room_mm(), kAny)) {
      path = path_through(*column, levels);
    }
    if (path && !path->has_target) {
      path->last = separable_levels(levels, *path).back();
      path->end_mm = point_at(*path, levels[path->last].z_mm);
    }
    return path;
  }

  SceneDraft draft_of(const NeedlePath& path) const {
    SceneDraft draft(levels, path, is_chosen(), heights);
    draft.name_files(asset_file, scene_file);
    return draft;
  }

  Result<Placed> place(const std::string& text) const {
    const std::string name = asset_file.string();
    Result<Scene> scene = parse_scene(text, scene_file.string(), scene_file.parent_path());
    if (!scene) return scene.error();
    if (const auto placed = place_body(*scene, asset, name); !placed) return placed.error();
    auto sheets = place_slices(*scene, asset, name);
    if (!sheets) return sheets.error();
    Placed placed{std::move(*scene), std::move(*sheets), options};
    placed.options.duration_s = placed.scene.duration_s;
    if (device.set_options) device.set_options(placed.scene, placed.options);
    return placed;
  }

  /// Places a scene and sets its warnings. Errors: the scene is refused, or has a warning although nobody has chosen its path.
  Result<Placed> check(Tried& tried) const {
    Result<Placed> placed = place(tried.json);
    if (!placed) return placed;
    Result<SceneCheck> checked =
        check_scene(placed->scene, device, placed->sheets, choose_tissues(placed->scene, asset), {},
                    placed->options);
    if (!checked) return checked.error();
    tried.warnings = std::move(checked->warnings);
    if (!tried.warnings.empty() && !is_chosen()) return refused(tried.warnings.front());
    return placed;
  }

  /// Tries a draft. If its path has a target and its hand is scripted, the hand is first sent so far that the tip gets to
  /// the target. Errors: the scene is refused, has a warning although nobody has chosen its path, punctures nothing, or does
  /// not get to the target.
  Result<Tried> try_draft(SceneDraft& draft, const std::function<std::string()>& make) const {
    if (draft.path.has_target && !choices.has_live_hand) {
      double beyond_m = 0, short_m = 0;
      for (int turn = 0; turn < kMaxReaches; ++turn) {
        draft.beyond_target_m = beyond_m;
        const Result<Placed> placed = place(make());
        if (!placed) return placed.error();
        const auto dry_run = run_dry_run(placed->scene, device, placed->sheets, placed->options);
        if (!dry_run) return dry_run.error();
        short_m = dry_run->tip_lowest_m - draft.to_device(draft.path.end_mm).z();
        if (std::abs(short_m) <= kReached_m) break;
        beyond_m += short_m;
      }
      if (std::abs(short_m) > kReached_m)
        return refused(
            text_line("the scripted hand brings the tip to %.1f mm %s the target, and is "
                      "no better when it goes farther",
                      1e3 * std::abs(short_m), short_m > 0 ? "above" : "below"));
    }
    return try_scene(draft, make);
  }

  Result<Tried> try_scene(SceneDraft& draft, const std::function<std::string()>& make) const {
    Tried tried;
    tried.json = make();
    const Result<Placed> placed = check(tried);
    if (!placed) return placed.error();
    const Result<DryRun> dry_run =
        run_dry_run(placed->scene, device, placed->sheets, placed->options);
    if (!dry_run) return dry_run.error();
    tried.force_max_N = dry_run->force_max_N;
    tried.sheets = dry_run->sheets.size();
    for (const SheetDryRun& each : dry_run->sheets)
      tried.punctured += each.punctured_t_s >= 0 ? 1 : 0;
    if (tried.punctured == 0) return refused("the tool punctures nothing");
    if (!choices.has_live_hand) return tried;
    draft.has_live_hand = true;
    tried.json = make();
    if (const Result<Placed> live = check(tried); !live) return live.error();
    return tried;
  }

  /// Keeps the scene with the fewest warnings of those along a chosen path.
  void keep(Result<Tried> tried, const NeedlePath& path, const std::string& because) {
    if (!tried || (kept && kept->tried.warnings.size() <= tried->warnings.size())) return;
    kept = Kept{std::move(*tried), path, because};
  }

  std::string describe_asset() const {
    const Eigen::AlignedBox2d box = material_box(asset, levels);
    return text_line(
        "%zu of %zu slices have material, within u %.1f to %.1f, v %.1f to %.1f mm and %.1f mm of "
        "height",
        levels.size(), slice_count(asset), box.min().x(), box.max().x(), box.min().y(),
        box.max().y(), levels.front().z_mm - levels.back().z_mm);
  }

  /// Says what lies between bone on the path or behind it, if that is wider than kMaxBoneGap_mm.
  std::string describe_gap(const NeedlePath& path) const {
    std::string text;
    for (const BoneGap& gap : bone_gaps(levels, path)) {
      const std::string between =
          text_line("%.1f mm without bone between slices %d and %d", gap.mm,
                    levels[gap.above].slice->index, levels[gap.below].slice->index);
      text += gap.above >= path.last ? ", and ends before " + between : ", across " + between;
    }
    return text;
  }

  std::string describe_path(const NeedlePath& path) const {
    const int a = levels[path.first].slice->index, b = levels[path.last].slice->index;
    const std::string within = text_line("within slices %d to %d", std::min(a, b), std::max(a, b));
    if (!is_chosen())
      return text_line(
                 "; its bone is thickest at u %.2f, v %.2f mm, where it is %.1f mm thick "
                 "around the tool, ",
                 path.entry_mm.x(), path.entry_mm.y(), path.thickness_mm) +
             within + describe_gap(path) +
             ": that is the entry point, and lies over the middle of the device. ";
    std::string text =
        text_line("; the needle enters at u %.2f, v %.2f mm", path.entry_mm.x(), path.entry_mm.y());
    constexpr double kMoved_mm = 0.1;
    if (path.entry_shift_mm > kMoved_mm)
      text += text_line(", where the path meets the bone, %.1f mm from the chosen point",
                        path.entry_shift_mm);
    text += text_line(", tilted by %.1f deg, and goes through %.1f mm of bone ", tilt_deg(path),
                      path.thickness_mm) +
            within;
    if (path.has_target)
      text +=
          text_line(" to the target, %.1f mm from the entry", (path.end_mm - path.entry_mm).norm());
    text += describe_gap(path);
    return text + ". ";
  }

  static std::string describe_warnings(const std::vector<std::string>& warnings) {
    if (warnings.empty()) return "and check has no warning. ";
    return "and check has " + std::to_string(warnings.size()) +
           (warnings.size() == 1 ? " warning: " : " warnings, the first: ") + warnings.front() +
           ". ";
  }

  NewScene finish(const Tried& made, const NeedlePath& path, const std::string& because) const {
    NewScene out;
    out.json = made.json;
    out.text = asset_file.string() + ": " + describe_asset() + describe_path(path) +
               "Chosen: " + because +
               text_line(
                   ". Slices are at their true spacing, in the middle of the heights %.3f to "
                   "%.3f m that the tip reaches. A dry run punctured %zu of %zu slices, with at "
                   "most %.1f N, ",
                   heights.min_m - kWorkspaceMargin_m, heights.max_m + kWorkspaceMargin_m,
                   made.punctured, made.sheets, made.force_max_N) +
               describe_warnings(made.warnings) +
               (choices.has_live_hand ? "That was with a scripted hand; the hand is now live: "
                                        "start the scene with trocar-console. "
                                      : "") +
               "For training, not for planning.\n";
    return out;
  }

  std::vector<Level> levels{};  ///< levels of the asset, the topmost first
  bool has_hu = false;          ///< every slice with material has HU
  WorkspaceHeights heights{};   ///< heights of the tip that the proposal uses
  std::optional<Kept> kept{};
};

}  // namespace

Result<NewScene> propose_scene(const Asset& asset, const std::filesystem::path& asset_file,
                               const std::filesystem::path& scene_file, const DeviceToCheck& device,
                               const SessionOptions& options, const NewSceneChoices& choices) {
  Result<NewScene> made = Proposal{asset, asset_file, scene_file, device, options, choices}.make();
  // Whatever was found or not: a dry run may have been cut short.
  if (options.is_stopped()) return interrupted();
  return made;
}

}  // namespace trocar::runtime
