// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/new_scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "formats/session/scene.h"
#include "runtime/contact/sheet.h"
#include "runtime/cutting/body.h"
#include "runtime/session/hand_path.h"
#include "runtime/session/scene_check.h"
#include "runtime/session/text_line.h"
#include "runtime/session/tissue_report.h"
#include "runtime/session/trial.h"

namespace trocar::runtime {
namespace {

using json = nlohmann::ordered_json;  // a scene is read by people

constexpr double kNeedle_m = 0.0015, kPaperTool_m = 0.003;  // radius of the tool
constexpr double kAbove_m = 0.006, kBelow_m = 0.013;        // of the path beyond the slices
constexpr double kReachMargin_m = 0.004;
constexpr double kCell_mm = 1;
constexpr std::size_t kMostCells = 400'000;
constexpr double kApart_m = 0.0095;  // of slices each of which is felt: 7 mm to its puncture
constexpr std::size_t kMostSlices = 5;

/// A slice with material, in the order of heights from above.
struct Level {
  const AssetSlice* slice = nullptr;
  double z_mm = 0;
  std::vector<std::uint8_t> material;  ///< of the cells
};

/// Cells over the slice plane in which all slices have their material.
class Cells {
 public:
  Cells(const Asset& asset, std::vector<Level>& levels) {
    const double step_mm = asset.lattice.step_mm();
    constexpr double kFar = std::numeric_limits<double>::infinity();
    low_ = {kFar, kFar};
    high_ = {-kFar, -kFar};
    for (const Level& level : levels) {
      for (const LatticePoint p : level.slice->mesh.vertices) {
        const std::array<double, 2> at{p.x * step_mm, p.y * step_mm};
        for (std::size_t k = 0; k < 2; ++k) {
          low_[k] = std::min(low_[k], at[k]);
          high_[k] = std::max(high_[k], at[k]);
        }
      }
    }
    const double area = (high_[0] - low_[0] + kCell_mm) * (high_[1] - low_[1] + kCell_mm);
    cell_mm_ = std::max(kCell_mm, std::sqrt(area / static_cast<double>(kMostCells)));
    for (std::size_t k = 0; k < 2; ++k)
      count_[k] = static_cast<int>((high_[k] - low_[k]) / cell_mm_) + 1;
    for (Level& level : levels)
      fill(level, step_mm);
  }

  std::size_t size() const { return static_cast<std::size_t>(count_[0]) * count_[1]; }
  std::array<double, 2> middle_mm(std::size_t cell) const {
    const auto i = static_cast<int>(cell);
    const int column = i % count_[0], row = i / count_[0];
    return {low_[0] + (column + 0.5) * cell_mm_, low_[1] + (row + 0.5) * cell_mm_};
  }
  const std::array<double, 2>& low_mm() const { return low_; }
  const std::array<double, 2>& high_mm() const { return high_; }

  /// The cells around which all within the radius is material.
  std::vector<std::uint8_t> clear(const Level& level, double radius_mm) const {
    std::vector<std::uint8_t> out(size());
    const int reach = static_cast<int>(std::ceil(radius_mm / cell_mm_));
    for (int y = reach; y < count_[1] - reach; ++y) {
      for (int x = reach; x < count_[0] - reach; ++x)
        out[index(x, y)] = is_clear(level, x, y, reach, radius_mm) ? 1 : 0;
    }
    return out;
  }

 private:
  std::size_t index(int x, int y) const { return static_cast<std::size_t>(y) * count_[0] + x; }

  bool is_clear(const Level& level, int x, int y, int reach, double radius_mm) const {
    if (level.material[index(x, y)] == 0) return false;
    for (int dy = -reach; dy <= reach; ++dy) {
      for (int dx = -reach; dx <= reach; ++dx) {
        if (std::hypot(dx, dy) * cell_mm_ > radius_mm + cell_mm_ / 2) continue;
        if (level.material[index(x + dx, y + dy)] == 0) return false;
      }
    }
    return true;
  }

  void fill(Level& level, double step_mm) {
    level.material.assign(size(), 0);
    const SliceMesh& mesh = level.slice->mesh;
    for (const Triangle& triangle : mesh.triangles) {
      std::array<std::array<double, 2>, 3> p;
      for (std::size_t k = 0; k < 3; ++k) {
        const LatticePoint corner = mesh.vertices[triangle[k]];
        p[k] = {(corner.x * step_mm - low_[0]) / cell_mm_,
                (corner.y * step_mm - low_[1]) / cell_mm_};
      }
      const auto [y0, y1] = std::minmax({p[0][1], p[1][1], p[2][1]});
      const auto [x0, x1] = std::minmax({p[0][0], p[1][0], p[2][0]});
      for (int y = std::max(0, static_cast<int>(y0 - 0.5)); y < count_[1] && y + 0.5 <= y1; ++y) {
        for (int x = std::max(0, static_cast<int>(x0 - 0.5)); x < count_[0] && x + 0.5 <= x1; ++x) {
          const auto side = [&](std::size_t a, std::size_t b) {
            return (p[b][0] - p[a][0]) * (y + 0.5 - p[a][1]) -
                   (p[b][1] - p[a][1]) * (x + 0.5 - p[a][0]);
          };
          if (side(0, 1) >= 0 && side(1, 2) >= 0 && side(2, 0) >= 0)
            level.material[index(x, y)] = 1;
        }
      }
    }
  }

  std::array<double, 2> low_{}, high_{};
  std::array<int, 2> count_{1, 1};
  double cell_mm_ = kCell_mm;
};

/// Where the tool is to go in: a column of the slices [first, last] of the levels.
struct Column {
  std::array<double, 2> at_mm{};
  std::size_t first = 0, last = 0;
  double thickness_mm = 0;             ///< of material around it
  std::vector<std::uint8_t> is_clear;  ///< of the levels
};

/// The thickest column among windows of levels that fit in `height_mm`; of equally thick ones that
/// with the most room around it. `most_gap_mm`: between levels that follow each other.
std::optional<Column> thickest(const Cells& cells, const std::vector<Level>& levels,
                               double radius_mm, double height_mm, double most_gap_mm) {
  std::vector<std::vector<std::uint8_t>> clear, roomy;
  for (const Level& level : levels) {
    clear.push_back(cells.clear(level, radius_mm));
    roomy.push_back(cells.clear(level, 3 * radius_mm));
  }
  const std::size_t n = levels.size();
  std::vector<double> share_mm(n);  // of each level: half-way to its neighbours
  for (std::size_t i = 0; i < n; ++i) {
    const double above = i > 0 ? levels[i - 1].z_mm - levels[i].z_mm : 0;
    const double below = i + 1 < n ? levels[i].z_mm - levels[i + 1].z_mm : 0;
    // At an end as far as inwards; a lone slice counts as a millimetre.
    share_mm[i] = n == 1 ? 1
                         : (std::min(i > 0 ? above : below, most_gap_mm) +
                            std::min(i + 1 < n ? below : above, most_gap_mm)) /
                               2;
  }
  std::tuple<double, double, double> best{0, 0, 0};
  std::optional<Column> found;
  for (std::size_t first = 0; first < n; ++first) {
    std::size_t last = first;
    while (last + 1 < n && levels[first].z_mm - levels[last + 1].z_mm <= height_mm &&
           std::abs(levels[last + 1].slice->index - levels[first].slice->index) <
               static_cast<int>(kMaxSceneSlices) &&
           levels[last].z_mm - levels[last + 1].z_mm <= most_gap_mm)
      ++last;
    const bool seen_before =
        first > 0 && last + 1 == n && found && found->last == last && found->first < first;
    if (seen_before) break;  // part of an earlier window
    std::vector<double> thickness(cells.size()), room(cells.size());
    for (std::size_t i = first; i <= last; ++i) {
      for (std::size_t c = 0; c < cells.size(); ++c) {
        thickness[c] += clear[i][c] != 0 ? share_mm[i] : 0;
        room[c] += roomy[i][c] != 0 ? share_mm[i] : 0;
      }
    }
    std::array<double, 2> sum{};
    double total = 0;
    for (std::size_t c = 0; c < cells.size(); ++c) {
      sum[0] += thickness[c] * cells.middle_mm(c)[0];
      sum[1] += thickness[c] * cells.middle_mm(c)[1];
      total += thickness[c];
    }
    for (std::size_t c = 0; total > 0 && c < cells.size(); ++c) {
      if (!(thickness[c] > 0)) continue;
      const std::array<double, 2> at = cells.middle_mm(c);
      const std::tuple<double, double, double> score{
          thickness[c], room[c], -std::hypot(at[0] - sum[0] / total, at[1] - sum[1] / total)};
      if (found && !(score > best)) continue;
      best = score;
      found = Column{at, first, last, thickness[c], {}};
      for (const auto& level : clear)
        found->is_clear.push_back(level[c]);
    }
  }
  if (!found) return std::nullopt;
  // From the first slice with material there to the last.
  while (found->is_clear[found->first] == 0)
    ++found->first;
  while (found->is_clear[found->last] == 0)
    --found->last;
  return found;
}

/// To so many parts of one.
double rounded(double value, double parts) {
  return std::round(value * parts) / parts;
}

json keyframe(double t_s, double z_m) {
  return {{"t_s", rounded(t_s, 1e3)}, {"tip_m", {0, 0, rounded(z_m, 1e5)}}};
}

class Proposal {
 public:
  Proposal(const Asset& asset, const std::filesystem::path& asset_file,
           const std::filesystem::path& scene_file, const DeviceDescription& device,
           const SessionOptions& options)
      : asset_(asset),
        asset_file_(asset_file),
        scene_file_(scene_file),
        device_(device),
        options_(options) {}

  Result<NewScene> make() {
    const std::string name = asset_file_.string();
    std::size_t with_hu = 0;
    for (const AssetSlice& slice : asset_.slices) {
      if (slice.mesh.triangles.empty()) continue;
      levels_.push_back({&slice, slice.z_mm, {}});
      with_hu += slice.hu.empty() ? 0 : 1;
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
    const Tool tool = make_tool(SceneTool{});
    const auto reach = reach_heights(device_, options_.limits, tool);
    if (!reach) return refused(name + ": the device reaches nothing; choose another description");
    low_m_ = reach->min_m + kReachMargin_m;
    high_m_ = reach->max_m - kReachMargin_m;
    const double height_mm = 1e3 * (high_m_ - low_m_ - kAbove_m - kBelow_m);
    const Cells cells(asset_, levels_);
    describe_box(cells);

    std::string why, no_body = with_hu == levels_.size() ? "its slices are more than 3 mm apart"
                                                         : "the asset has no HU";
    if (with_hu == levels_.size()) {
      const double gap_mm = 1e3 * (kOneBody_m + kOneBodyRounding_m);
      const auto column = thickest(cells, levels_, 1e3 * kNeedle_m, height_mm, gap_mm);
      if (column && column->last > column->first) {
        no_body = "no session through a body of its slices is without a warning";
        for (const double force_scale : {0.5, 0.25, 0.1}) {
          if (options_.stop != nullptr && options_.stop->load()) return refused("interrupted");
          if (auto made = try_scene(cutting(*column, force_scale), why)) {
            return finish(*made, *column,
                          "the law cutting with strength by HU, since the asset has HU and its "
                          "slices are close enough to be one body");
          }
        }
      }
    }
    const auto column =
        thickest(cells, levels_, 1e3 * kPaperTool_m, height_mm, std::numeric_limits<double>::max());
    if (!column && why.empty())
      return refused(name + text_line(": its bone is nowhere as wide as the tool, %.0f mm across: "
                                      "nothing can be punctured",
                                      2e3 * kPaperTool_m));
    if (column) {
      for (const double threshold_N : {35.0, 20.0, 10.0}) {
        if (options_.stop != nullptr && options_.stop->load()) return refused("interrupted");
        if (auto made = try_scene(sheets(*column, threshold_N), why)) {
          return finish(*made, *column,
                        std::string("the law hooke with the paper's tissue and slices at least "
                                    "9.5 mm apart, so that each is felt, since ") +
                            no_body);
        }
      }
    }
    return refused(name + ": no scene was found that runs without a warning; the last was: " + why);
  }

 private:
  void describe_box(const Cells& cells) {
    box_ = text_line(
        "%zu of %zu slices have material, within u %.1f to %.1f, v %.1f to %.1f mm and %.1f mm of "
        "height",
        levels_.size(), slice_count(asset_), cells.low_mm()[0], cells.high_mm()[0],
        cells.low_mm()[1], cells.high_mm()[1], levels_.front().z_mm - levels_.back().z_mm);
  }

  json head(const Column& column) const {
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

  /// In the middle of what the tip reaches.
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

  json cutting(const Column& column, double force_scale) const {
    json scene = head(column);
    const double thickness_m = 1e-3 * (levels_[column.first].z_mm - levels_[column.last].z_mm);
    const double top_m = top_of(thickness_m);
    const int a = levels_[column.first].slice->index, b = levels_[column.last].slice->index;
    scene["body"] = {{"from", std::min(a, b)},
                     {"to", std::max(a, b)},
                     {"top_z_m", top_m},
                     {"shell", {{"thickness_m", 0.0005}, {"strength_factor", 1.5}}}};
    scene["tissue"] = {{"stiffness_N_per_m", 20000},
                       {"cut",
                        {{"bone", {{"law", "kopperdahl-linear"}}},
                         {"tearing_N_per_m", 500},
                         {"friction_kPa", 20},
                         {"bed_N_per_mm3", 0.3},
                         {"lateral_strength_MPa", 5}}}};
    scene["force_law"] = {
        {"kind", "cutting"}, {"coupling_N_per_m", 20000}, {"force_scale", force_scale}};
    scene["tool"] = {{"sides", 12}, {"radius_m", kNeedle_m}};
    scene["hand"] = hand(top_m, top_m - thickness_m, 0.0115, true, scene);
    return scene;
  }

  json sheets(const Column& column, double threshold_N) const {
    json scene = head(column);
    std::vector<const Level*> chosen;
    for (std::size_t i = column.first; i <= column.last && chosen.size() < kMostSlices; ++i) {
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
    scene["tool"] = {{"sides", 6}, {"radius_m", kPaperTool_m}};
    scene["hand"] = hand(top_m, top_m - thickness_m, 0.0175, false, scene);
    return scene;
  }

  struct Tried {
    std::string json;
    double force_max_N = 0;
    std::size_t punctured = 0, sheets = 0;
  };

  /// None, with the reason in `why`: refused, warned of, or nothing is punctured.
  std::optional<Tried> try_scene(const json& proposed, std::string& why) const {
    Tried tried;
    tried.json = proposed.dump(2, ' ', false, json::error_handler_t::replace) + "\n";
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
    const Result<SceneCheck> check =
        check_scene(*scene, device_, *sheets, choose_tissues(*scene, asset_), {}, options);
    if (!check) return fails(check.error().message);
    if (!check->warnings.empty()) return fails(check->warnings.front());
    const Result<Trial> trial = run_trial(*scene, device_, *sheets, options);
    if (!trial) return fails(trial.error().message);
    tried.force_max_N = trial->force_max_N;
    tried.sheets = trial->sheets.size();
    for (const SheetTrial& each : trial->sheets)
      tried.punctured += each.punctured_t_s >= 0 ? 1 : 0;
    if (tried.punctured == 0) return fails("the tool punctures nothing");
    return tried;
  }

  NewScene finish(const Tried& made, const Column& column, const std::string& because) const {
    const int a = levels_[column.first].slice->index, b = levels_[column.last].slice->index;
    NewScene out;
    out.json = made.json;
    out.text =
        asset_file_.string() + ": " + box_ +
        text_line(
            "; its bone is thickest at u %.2f, v %.2f mm, where it is %.1f mm thick "
            "around the tool, within slices %d to %d: that is the entry point, and "
            "lies over the middle of the device. ",
            column.at_mm[0], column.at_mm[1], column.thickness_mm, std::min(a, b), std::max(a, b)) +
        "Chosen: " + because +
        text_line(
            ". Slices are at their true spacing, in the middle of the heights %.3f to "
            "%.3f m that the tip reaches. A trial punctured %zu of %zu slices, with at "
            "most %.1f N, and --check has no warning. ",
            low_m_ - kReachMargin_m, high_m_ + kReachMargin_m, made.punctured, made.sheets,
            made.force_max_N) +
        "For training, not for planning.\n";
    return out;
  }

  const Asset& asset_;
  const std::filesystem::path &asset_file_, &scene_file_;
  const DeviceDescription& device_;
  const SessionOptions& options_;
  std::vector<Level> levels_;
  double low_m_ = 0, high_m_ = 0;
  std::string box_;
};

}  // namespace

Result<NewScene> propose_scene(const Asset& asset, const std::filesystem::path& asset_file,
                               const std::filesystem::path& scene_file,
                               const DeviceDescription& device, const SessionOptions& options) {
  return Proposal(asset, asset_file, scene_file, device, options).make();
}

}  // namespace trocar::runtime
