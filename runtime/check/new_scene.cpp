// SPDX-License-Identifier: Apache-2.0
#include "runtime/check/new_scene.h"

#include <nlohmann/json.hpp>

#include "formats/base/json.h"
#include "formats/base/text.h"
#include "runtime/check/scene_check.h"
#include "runtime/haptics/bone/bone_volume.h"

namespace trocar::runtime {
namespace {

using Eigen::Vector3d;
using Json = nlohmann::ordered_json;  // ordered, because people read scenes

// Radius of the tool in SceneDraft::cutting() and in SceneDraft::sheets().
constexpr double kNeedleRadius_m = 0.0015, kPaperToolRadius_m = 0.003;
// Length of the path above the bone, below the last slice, and below a target.
constexpr double kAbove_m = 0.006, kBelow_m = 0.013, kBelowTarget_m = 0.008;
// Distance of slices at which each is felt separately: a puncture takes 7 mm.
constexpr double kApart_m = 0.0095;
constexpr std::size_t kMaxSlices = 5;
// The goals of a path that a person has chosen.
constexpr double kTargetRadius_m = 0.002, kCorridor_m = 0.003;

Json rounded_point(const Vector3d& at_m) {
  Json point = Json::array();
  for (const double x : at_m) {
    const double value = rounded(x, 1e5);
    point.push_back(value == 0 ? Json(0) : Json(value));
  }
  return point;
}

/// Returns the indices of at most 5 levels at which the path goes through material, from the top
/// down. The levels are at least 9.5 mm apart, so that each puncture is felt separately.
std::vector<std::size_t> separable_levels(const std::vector<Level>& levels,
                                          const NeedlePath& path) {
  std::vector<std::size_t> felt;
  for (std::size_t i = path.first; i <= path.last && felt.size() < kMaxSlices; ++i) {
    if (path.has_material[i] == 0) continue;
    if (felt.empty() || levels[felt.back()].z_mm - levels[i].z_mm >= 1e3 * kApart_m)
      felt.push_back(i);
  }
  return felt;
}

/// The hand's motion begins above the entry of a path and reaches below the path's end. Returns the
/// sum of these two additional heights in m.
double height_outside_bone_m(const NeedlePath& path) {
  return kAbove_m + (path.has_target ? kBelowTarget_m : kBelow_m);
}

Json keyframe(const NeedlePath& path, double t_s, const Vector3d& tip_m) {
  Json key = {{"t_s", rounded(t_s, 1e3)}, {"tip_m", rounded_point(tip_m)}};
  const double angle_deg = tilt_deg(path);
  if (!(angle_deg > 0)) return key;
  const Vector3d axis = (-Vector3d::UnitZ()).cross(path.direction).normalized();
  Json rotation = Json::array();
  for (const double x : axis)
    rotation.push_back(rounded(x * angle_deg, 1e3));
  key["rotation_deg"] = std::move(rotation);
  return key;
}

/// A draft of a scene for a needle's path, as JSON. It is not checked here.
struct SceneDraft {
  /// `levels` and `path` must outlive the draft.
  SceneDraft(const std::vector<Level>& asset_levels, const NeedlePath& needle_path,
             bool has_chosen_path, WorkspaceHeights tip_heights)
      : levels(asset_levels), path(needle_path), is_chosen(has_chosen_path), heights(tip_heights) {
    anchor_mm = (path.entry_mm + path.end_mm).head<2>() / 2;
    for (double& x : anchor_mm)
      x = rounded(x, 100);
    // The path is in the middle of the heights.
    const double used_m =
        1e-3 * (path.entry_mm.z() - path.end_mm.z()) + height_outside_bone_m(path);
    const double free_m = heights.max_m - heights.min_m - used_m;
    entry_z_m = rounded(heights.max_m - kAbove_m - std::max(0.0, free_m) / 2, 1e4);
  }

  /// Sets the scene's name, and the file name by which the scene names the asset.
  void name_files(const std::filesystem::path& asset_file,
                  const std::filesystem::path& scene_file) {
    std::error_code failed;
    std::filesystem::path folder = scene_file.parent_path();
    if (folder.empty()) folder = ".";
    std::filesystem::path asset = std::filesystem::relative(asset_file, folder, failed);
    const bool is_outside = asset.empty() || *asset.begin() == "..";
    if (asset_file.is_absolute() && is_outside) asset = asset_file;
    if (failed || asset.empty()) asset = std::filesystem::absolute(asset_file, failed);
    asset_name = asset.generic_string();
    scene_name = "Proposed for " + asset_file.filename().string();
  }

  Vector3d to_device(const Vector3d& at_mm) const {
    const Eigen::Vector2d xy_m = 1e-3 * (at_mm.head<2>() - anchor_mm);
    return {xy_m.x(), xy_m.y(), entry_z_m + 1e-3 * (at_mm.z() - path.entry_mm.z())};
  }

  /// Height of a level in {B}.
  double height_m(std::size_t level) const {
    return entry_z_m + 1e-3 * (levels[level].z_mm - path.entry_mm.z());
  }

  /// Returns a scene with one bone volume, made of the levels along the path, with a strength
  /// computed from HU, and with a hand that moves in along the path and back out. `force_scale`:
  /// the scene's factor on the tissue's forces.
  std::string cutting(double force_scale) const {
    Json scene = head();
    std::size_t first = path.first, last = path.last;
    // All bone near a chosen path is there, because a person may leave it, or stop in the bone.
    const auto is_joined = [&](std::size_t above) {
      return levels[above].z_mm - levels[above + 1].z_mm <=
             1e3 * (kMaxSlabGap_m + kSlabGapRounding_m);
    };
    const auto fits = [&](std::size_t from, std::size_t to) {
      return slices_between(levels[from], levels[to]) <= kMaxSceneSlices;
    };
    while (is_chosen && last + 1 < levels.size() && is_joined(last) &&
           height_m(last + 1) >= heights.min_m && fits(first, last + 1))
      ++last;
    while (is_chosen && first > 0 && is_joined(first - 1) && height_m(first - 1) <= heights.max_m &&
           fits(first - 1, last))
      --first;
    const int a = levels[first].slice->index, b = levels[last].slice->index;
    scene["body"] = {{"from", std::min(a, b)},
                     {"to", std::max(a, b)},
                     {"top_z_m", rounded(height_m(first), 1e7)}};
    scene["tissue"] = {{"cut",
                        {{"bone", {{"law", "kopperdahl-power"}}},
                         {"tearing_N_per_m", 500},
                         {"friction_kPa", 60},
                         {"bed_N_per_mm3", 30},
                         {"lateral_strength_MPa", 5}}}};
    scene["force_law"] = {{"kind", "cutting"}, {"force_scale", force_scale}};
    scene["tool"] = {{"sides", 12}, {"radius_m", kNeedleRadius_m}};
    scene["hand"] = hand(0.0115, true, scene);
    if (is_chosen) scene["goals"] = goals();
    return json_text(scene, 2) + "\n";
  }

  /// Returns a scene with a single sheet at each of separable_levels(). `threshold_N`: puncture
  /// threshold of the tissue. `share`: the fraction of `threshold_N` that the device can render. If
  /// this fraction is below 1, it becomes the scene's factor on the tissue's forces.
  std::string sheets(double threshold_N, double share) const {
    Json scene = head();
    scene["slices"] = Json::array();
    for (const std::size_t level : separable_levels(levels, path))
      scene["slices"].push_back(
          {{"index", levels[level].slice->index}, {"z_m", rounded(height_m(level), 1e7)}});
    scene["tissue"] = {{"stiffness_N_per_m", 5000}, {"threshold_N", threshold_N}};
    scene["force_law"] = {{"kind", "hooke"}};
    if (share < 1) scene["force_law"]["force_scale"] = std::floor(1e3 * share) / 1e3;
    scene["tool"] = {{"sides", 6}, {"radius_m", kPaperToolRadius_m}};
    scene["hand"] = hand(0.0175, false, scene);
    if (is_chosen) scene["goals"] = goals();
    return json_text(scene, 2) + "\n";
  }

  Json head() const {
    return {{"schema", kSceneSchema},
            {"name", scene_name},
            {"asset", asset_name},
            {"placement", {{"anchor_mm", {anchor_mm.x(), anchor_mm.y()}}}}};
  }

  Json goals() const {
    Json line = {{"entry_m", rounded_point(to_device(path.entry_mm))}};
    if (!path.has_target) line["direction"] = rounded_point(path.direction);
    line["entry_radius_m"] = line["corridor_m"] = kCorridor_m;
    Json out;
    if (path.has_target)
      out["target"] = {{"at_m", rounded_point(to_device(path.end_mm))},
                       {"radius_m", kTargetRadius_m}};
    out["line"] = std::move(line);
    return out;
  }

  Json hand(double speed_m_per_s, bool returns, Json& scene) const {
    constexpr double kRest_s = 0.2;
    const Vector3d& along = path.direction;
    const Vector3d from_m = to_device(path.entry_mm) + kAbove_m / along.z() * along;
    const double below_m = path.has_target ? beyond_target_m : kBelow_m;
    const Vector3d to_m = to_device(path.end_mm) - below_m / along.z() * along;
    const double length_m = (to_m - from_m).norm();
    const double down_s = kRest_s + length_m / speed_m_per_s;
    Json keys = {keyframe(path, 0, from_m), keyframe(path, kRest_s, from_m),
                 keyframe(path, down_s, to_m)};
    double end_s = down_s + 0.3;
    if (returns) {
      keys.push_back(keyframe(path, down_s + 0.5, to_m));
      end_s = down_s + 0.5 + length_m / speed_m_per_s / 1.5;
      keys.push_back(keyframe(path, end_s, from_m));
      end_s += 0.2;
    }
    scene["duration_s"] = rounded(end_s, 100);
    Json out = {{"stiffness_N_per_m", 8000}, {"damping_N_s_per_m", 140}};
    if (has_live_hand) {
      out["trajectory"] = Json::array({keys[0]});
      out["live"] = true;
      scene["duration_s"] = 600;
    } else {
      out["trajectory"] = std::move(keys);
    }
    return out;
  }

  const std::vector<Level>& levels;  ///< the levels of the asset, the topmost first
  const NeedlePath& path;
  /// A person has chosen the path. It is then a goal of the scene, and so is the target if there is
  /// one. The scene's bone volume then also includes the connected slices above and below the path.
  bool is_chosen;
  WorkspaceHeights heights;  ///< heights of the tip in {B} that the draft may use
  std::string asset_name{}, scene_name{};
  Eigen::Vector2d anchor_mm = Eigen::Vector2d::Zero();
  double entry_z_m = 0;  ///< height of the entry in {B}
  /// The path of the scripted hand ends this far below the target (negative: above). This
  /// compensates for the tip's lag behind the hand. Without a target this has no effect.
  double beyond_target_m = 0;
  /// The scenes have a live hand, which begins at the pose where the scripted hand would begin.
  bool has_live_hand = false;
};

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
    return column && column->last > column->first ? column : std::nullopt;
  }

  /// Returns the path for single sheets, down to the last of them or to the target; none: there is none.
  Result<std::optional<NeedlePath>> path_through_sheets() const {
    std::optional<NeedlePath> path;
    if (is_chosen()) {
      if (const auto ok = chosen_path({}).into(path); !ok) return ok.error();
    } else {
      path = find_entry_column(asset, levels, 1e3 * kPaperToolRadius_m, room_mm(), kAny);
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

  /// Sends the scripted hand so far that the tip gets to the target of the path. Errors: it does not get there.
  Result<void> reach_target(SceneDraft& draft, const std::function<std::string()>& make) const {
    double beyond_m = 0, short_m = 0;
    for (int turn = 0; turn < kMaxReaches; ++turn) {
      draft.beyond_target_m = beyond_m;
      const Result<Placed> placed = place(make());
      if (!placed) return placed.error();
      const auto dry_run = run_dry_run(placed->scene, device, placed->sheets, placed->options);
      if (!dry_run) return dry_run.error();
      short_m = dry_run->tip_lowest_m - draft.to_device(draft.path.end_mm).z();
      if (std::abs(short_m) <= kReached_m) return {};
      beyond_m += short_m;
    }
    return refused(
        text_line("the scripted hand brings the tip to %.1f mm %s the target, and is "
                  "no better when it goes farther",
                  1e3 * std::abs(short_m), short_m > 0 ? "above" : "below"));
  }

  /// Checks a draft's scene. Errors: the scene is refused, or has a warning although nobody has chosen its path.
  Result<SceneCheck> check(const std::string& json) const {
    const Result<Placed> placed = place(json);
    if (!placed) return placed.error();
    auto checked =
        check_scene(placed->scene, device, placed->sheets, choose_tissues(placed->scene, asset), {},
                    placed->options, is_chosen() ? CheckExtent::kWhole : CheckExtent::kUntilWarned);
    if (checked && !checked->warnings.empty() && !is_chosen())
      return refused(checked->warnings.front());
    return checked;
  }

  /// Tries a draft. Errors: those of reach_target() and check(); the scene punctures nothing.
  Result<Tried> try_draft(SceneDraft& draft, const std::function<std::string()>& make) const {
    if (draft.path.has_target && !choices.has_live_hand) {
      if (const auto reached = reach_target(draft, make); !reached) return reached.error();
    }
    Tried tried;
    tried.json = make();
    Result<SceneCheck> checked = check(tried.json);
    if (!checked) return checked.error();
    if (!checked->dry_run) return refused(checked->warnings.front());  // it cannot start
    tried.force_max_N = checked->dry_run->force_max_N;
    tried.sheets = checked->dry_run->sheets.size();
    for (const SheetDryRun& each : checked->dry_run->sheets)
      tried.punctured += each.punctured_t_s >= 0 ? 1 : 0;
    if (tried.punctured == 0) return refused("the tool punctures nothing");
    if (choices.has_live_hand) {
      draft.has_live_hand = true;
      tried.json = make();
      checked = check(tried.json);
      if (!checked) return checked.error();
    }
    tried.warnings = std::move(checked->warnings);
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
