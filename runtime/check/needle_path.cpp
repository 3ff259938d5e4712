// SPDX-License-Identifier: Apache-2.0
#include "runtime/check/needle_path.h"

#include <tuple>

#include "formats/base/json.h"
#include "formats/base/text.h"

namespace trocar::runtime {
namespace {

constexpr double kCell_mm = 1;
constexpr double kEndless = std::numeric_limits<double>::infinity();
constexpr std::size_t kMaxCells = 400'000;

/// A grid over the slice plane that covers the material of all slices.
class Cells {
 public:
  Cells(const Asset& asset, const std::vector<Level>& levels) {
    const Eigen::AlignedBox2d box = material_box(asset, levels);
    low_ = box.min();
    const double width_mm = box.sizes()[0], height_mm = box.sizes()[1];
    cell_mm_ = std::max(kCell_mm, std::sqrt((width_mm + kCell_mm) * (height_mm + kCell_mm) /
                                            static_cast<double>(kMaxCells)));
    count_ = {static_cast<int>(width_mm / cell_mm_) + 1,
              static_cast<int>(height_mm / cell_mm_) + 1};
    const double step_mm = asset.lattice.step_mm();
    for (const Level& level : levels)
      material_.push_back(filled(level, step_mm));
  }

  std::size_t size() const { return static_cast<std::size_t>(count_[0]) * count_[1]; }
  std::array<double, 2> middle_mm(std::size_t cell) const {
    const auto i = static_cast<int>(cell);
    const int column = i % count_[0], row = i / count_[0];
    return {low_[0] + (column + 0.5) * cell_mm_, low_[1] + (row + 0.5) * cell_mm_};
  }

  /// Returns, for each cell, whether everything within the radius around it is material.
  std::vector<std::uint8_t> clear(std::size_t level, double radius_mm) const {
    std::vector<std::uint8_t> out(size());
    const int margin = static_cast<int>(std::ceil(radius_mm / cell_mm_));
    for (int y = margin; y < count_[1] - margin; ++y) {
      for (int x = margin; x < count_[0] - margin; ++x)
        out[index(x, y)] = is_clear(material_[level], x, y, margin, radius_mm) ? 1 : 0;
    }
    return out;
  }

 private:
  std::size_t index(int x, int y) const { return static_cast<std::size_t>(y) * count_[0] + x; }

  bool is_clear(const std::vector<std::uint8_t>& material, int x, int y, int margin,
                double radius_mm) const {
    if (material[index(x, y)] == 0) return false;
    for (int dy = -margin; dy <= margin; ++dy) {
      for (int dx = -margin; dx <= margin; ++dx) {
        if (std::hypot(dx, dy) * cell_mm_ > radius_mm + cell_mm_ / 2) continue;
        if (material[index(x + dx, y + dy)] == 0) return false;
      }
    }
    return true;
  }

  std::vector<std::uint8_t> filled(const Level& level, double step_mm) const {
    std::vector<std::uint8_t> material(size());
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
          if (side(0, 1) >= 0 && side(1, 2) >= 0 && side(2, 0) >= 0) material[index(x, y)] = 1;
        }
      }
    }
    return material;
  }

  Eigen::Vector2d low_;
  std::array<int, 2> count_{1, 1};
  double cell_mm_ = kCell_mm;
  std::vector<std::vector<std::uint8_t>> material_;  ///< one mask of cells with material per level
};

/// Returns the mean spacing of the slices from one level to a lower one.
double spacing_mm(const Level& above, const Level& below) {
  return (above.z_mm - below.z_mm) / (static_cast<double>(slices_between(above, below)) - 1);
}

/// Returns the thickness that each level stands for: from half-way to the slice above to half-way
/// to the slice below, with or without material. For slices without material that lie between two
/// levels, their mean spacing counts. The topmost and the lowest level are assumed to have a second
/// neighbour at the same distance as their only neighbour. A single slice counts as 1 mm thick. A
/// distance of more than `max_gap_mm` counts as `max_gap_mm`.
std::vector<double> level_thickness(const std::vector<Level>& levels, double max_gap_mm) {
  const std::size_t n = levels.size();
  std::vector<double> thickness_mm(n, 1);
  for (std::size_t i = 0; n > 1 && i < n; ++i) {
    const double above = i > 0 ? spacing_mm(levels[i - 1], levels[i]) : 0;
    const double below = i + 1 < n ? spacing_mm(levels[i], levels[i + 1]) : 0;
    thickness_mm[i] = (std::min(i > 0 ? above : below, max_gap_mm) +
                       std::min(i + 1 < n ? below : above, max_gap_mm)) /
                      2;
  }
  return thickness_mm;
}

/// Returns the last level of the window of levels that begins with `first`.
std::size_t window_end(const std::vector<Level>& levels, std::size_t first, double height_mm,
                       double max_gap_mm) {
  std::size_t last = first;
  while (last + 1 < levels.size() && levels[first].z_mm - levels[last + 1].z_mm <= height_mm &&
         slices_between(levels[first], levels[last + 1]) <= kMaxSceneSlices &&
         levels[last].z_mm - levels[last + 1].z_mm <= max_gap_mm)
    ++last;
  return last;
}

/// Rank of a cell: thickness in a window of levels, thickness for a wider tool, and closeness
/// to the centre.
using Score = std::tuple<double, double, double>;

struct Best {
  Score score{0, 0, 0};
  std::optional<std::size_t> cell;
  NeedlePath path;
};

using Clearance = std::vector<std::vector<std::uint8_t>>;  ///< indexed by level and cell

/// Compares the cells of the window [first, last] with the best so far.
void search_window(const std::vector<Level>& levels, const Cells& cells, const Clearance& clear,
                   const Clearance& wide, const std::vector<double>& thickness_mm,
                   std::size_t first, std::size_t last, Best& best) {
  std::vector<double> thickness(cells.size()), wide_thickness(cells.size());
  constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();
  // By cell: the lowest level with material so far, and whether the column's bone has ended.
  std::vector<std::size_t> lowest(cells.size(), kNone), end(cells.size(), kNone);
  std::vector<std::uint8_t> has_ended(cells.size());
  for (std::size_t i = 0; i <= last; ++i) {
    for (std::size_t c = 0; c < cells.size(); ++c) {
      if (clear[i][c] == 0) continue;
      const bool is_apart =
          lowest[c] != kNone && gap_mm(levels[lowest[c]], levels[i]) > kMaxBoneGap_mm;
      lowest[c] = i;
      if (is_apart) has_ended[c] = 1;
      if (has_ended[c] != 0 || i < first) continue;
      end[c] = i;
      thickness[c] += thickness_mm[i];
      wide_thickness[c] += wide[i][c] != 0 ? thickness_mm[i] : 0;
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
    const Score score{thickness[c], wide_thickness[c],
                      -std::hypot(at[0] - sum[0] / total, at[1] - sum[1] / total)};
    if (best.cell && !(score > best.score)) continue;
    best.score = score;
    best.cell = c;
    best.path.first = first;
    best.path.last = end[c];
    best.path.thickness_mm = thickness[c];
  }
}

using Eigen::Vector3d;

constexpr double kSame_mm = 0.15;     // a height this far above a point counts as its own
constexpr double kLeastDepth_mm = 1;  // of a target below the entry

/// Returns a point of the patient in the frame of the levels, by the level that is nearest to it.
Vector3d in_levels(const std::vector<Level>& levels, const std::array<double, 3>& lps_mm) {
  Vector3d nearest = Vector3d::Constant(kEndless);
  double z_mm = 0;
  for (const Level& level : levels) {
    const Vector3d at = level.slice->T_lps_plane.inverse() * Vector3d(lps_mm.data());
    if (std::abs(at.z()) >= std::abs(nearest.z())) continue;
    nearest = at;
    z_mm = level.z_mm;
  }
  return {nearest.x(), nearest.y(), z_mm + nearest.z()};
}

/// Returns whether the slices lie straight above each other, so that what is straight in the frame of the levels is so in the
/// patient.
bool is_straight(const std::vector<Level>& levels) {
  constexpr double kMaxAside_mm = 0.02, kMaxTurned = 1e-4;
  const Eigen::Affine3d T_first_lps = levels.front().slice->T_lps_plane.inverse();
  return std::all_of(levels.begin(), levels.end(), [&](const Level& level) {
    const Eigen::Affine3d between = T_first_lps * level.slice->T_lps_plane;
    return between.linear().isIdentity(kMaxTurned) &&
           between.translation().head<2>().norm() <= kMaxAside_mm;
  });
}

/// Returns whether no slice without material lies between a level and the next one.
bool is_next(const std::vector<Level>& levels, std::size_t above) {
  return std::abs(levels[above].slice->index - levels[above + 1].slice->index) == 1;
}

/// Returns the distance of a level from its neighbours; 0: it has none.
double spacing_at(const std::vector<Level>& levels, std::size_t at) {
  if (at + 1 < levels.size() && is_next(levels, at)) return levels[at].z_mm - levels[at + 1].z_mm;
  if (at > 0 && is_next(levels, at - 1)) return levels[at - 1].z_mm - levels[at].z_mm;
  return 0;
}

bool is_in_material(const Level& level, double step_mm, const Vector3d& at_mm) {
  const SliceMesh& mesh = level.slice->mesh;
  const double x = at_mm.x() / step_mm, y = at_mm.y() / step_mm;
  return std::any_of(mesh.triangles.begin(), mesh.triangles.end(), [&](const Triangle& triangle) {
    for (std::size_t k = 0; k < 3; ++k) {
      const LatticePoint a = mesh.vertices[triangle[k]], b = mesh.vertices[triangle[(k + 1) % 3]];
      const double side =
          (static_cast<double>(b.x) - static_cast<double>(a.x)) * (y - static_cast<double>(a.y)) -
          (static_cast<double>(b.y) - static_cast<double>(a.y)) * (x - static_cast<double>(a.x));
      if (side < 0) return false;
    }
    return true;
  });
}

std::string name_point(const char* what, const std::array<double, 3>& lps_mm) {
  return text_line("the %s (%.1f, %.1f, %.1f) mm", what, lps_mm[0], lps_mm[1], lps_mm[2]);
}

/// Finds the levels of the bone that the path enters. Returns the reason if there is no such bone, else an empty text.
std::string find_entry(const std::vector<Level>& levels, double entry_z_mm, NeedlePath& path) {
  const std::size_t count = levels.size();
  std::size_t at = 0;
  while (at < count && levels[at].z_mm > entry_z_mm + kSame_mm)
    ++at;
  while (at < count && path.has_material[at] == 0)
    ++at;
  if (at == count) return "the needle meets no bone there: choose another entry";
  while (at > 0 && path.has_material[at - 1] != 0 && is_next(levels, at - 1))
    --at;
  for (std::size_t i = 0; i < at; ++i) {
    if (path.has_material[i] != 0)
      return "the needle would first go through the bone of slice " +
             std::to_string(levels[i].slice->index) +
             ", which lies above it: choose an entry there, or another direction";
  }
  path.first = at;
  return {};
}

/// Returns the last level of a path without a target.
std::size_t find_end(const std::vector<Level>& levels, const NeedlePath& path,
                     const PathLimits& limits) {
  std::size_t last = path.first;
  for (std::size_t i = path.first + 1; i < levels.size(); ++i) {
    if (levels[path.first].z_mm - levels[i].z_mm > limits.height_mm) break;
    if (levels[i - 1].z_mm - levels[i].z_mm > limits.gap_mm) break;
    if (slices_between(levels[path.first], levels[i]) > limits.slices) break;
    if (path.has_material[i] == 0) continue;
    if (gap_mm(levels[last], levels[i]) / -path.direction.z() > kMaxBoneGap_mm) break;
    last = i;
  }
  return last;
}

Pose plate_of(const Pose& T_device_tool, const Tool& tool) noexcept {
  return {T_device_tool.p_m - T_device_tool.q * tool.tip_plate_m, T_device_tool.q};
}

std::string describe_box(const SafetyLimits& limits, const Pose& T_device_plate) {
  constexpr std::array<const char*, 3> kAxes{"x", "y", "z"};
  for (std::size_t i = 0; i < 3; ++i) {
    const double at_m = T_device_plate.p_m[static_cast<Eigen::Index>(i)];
    if (at_m >= limits.workspace_min_m[i] && at_m <= limits.workspace_max_m[i]) continue;
    const double low_m = limits.workspace_min_m[i], high_m = limits.workspace_max_m[i];
    return text_line("the plate is at %s %s m; its workspace is %.4f to %.4f m", kAxes[i],
                     apart_from(at_m, at_m < low_m ? low_m : high_m, 4).c_str(), low_m, high_m);
  }
  return {};
}

/// Speed of the plate's origin, and its rotation rate.
struct PlateSpeed {
  double m_per_s = 0, rad_per_s = 0;
};
PlateSpeed plate_speed(const HandTarget& target, const Pose& T_device_plate) noexcept {
  const Eigen::Vector3d omega = target.twist_device.tail<3>();
  const Eigen::Vector3d lever_m = T_device_plate.p_m - target.T_device_tool.p_m;
  return {(target.twist_device.head<3>() + omega.cross(lever_m)).norm(), omega.norm()};
}

std::string describe_speed(const SafetyLimits& limits, const PlateSpeed& speed) {
  if (speed.m_per_s > limits.speed_max_m_per_s) {
    return describe_beyond("the plate moves at", speed.m_per_s, limits.speed_max_m_per_s, " m/s",
                           2);
  }
  if (!(speed.rad_per_s > limits.rotation_rate_max_rad_per_s)) return {};
  return describe_beyond("the plate turns at", speed.rad_per_s, limits.rotation_rate_max_rad_per_s,
                         " rad/s", 1);
}

void note_margins(const PoseMargins& margins, PathReport& report) noexcept {
  report.box_min_m = std::min(report.box_min_m, margins.box_m);
  report.tilt_max_rad = std::max(report.tilt_max_rad, margins.tilt_rad);
  DeviceMargins& device = report.device;
  device.is_reachable = device.is_reachable && margins.device.is_reachable;
  if (!margins.device.is_reachable) return;
  device.inverse_condition = std::min(device.inverse_condition, margins.device.inverse_condition);
  if (!(margins.device.joint_rad < device.joint_rad)) return;
  device.joint_rad = margins.device.joint_rad;
  device.joint = margins.device.joint;
}

}  // namespace

double gap_mm(const Level& above, const Level& below) {
  return spacing_mm(above, below) * (static_cast<double>(slices_between(above, below)) - 2);
}

std::size_t slices_between(const Level& a, const Level& b) {
  return static_cast<std::size_t>(std::abs(a.slice->index - b.slice->index)) + 1;
}

Eigen::AlignedBox2d material_box(const Asset& asset, const std::vector<Level>& levels) {
  const double step_mm = asset.lattice.step_mm();
  Eigen::AlignedBox2d box;
  for (const Level& level : levels) {
    for (const LatticePoint p : level.slice->mesh.vertices)
      box.extend(Eigen::Vector2d(p.x * step_mm, p.y * step_mm));
  }
  return box;
}

std::optional<NeedlePath> find_entry_column(const Asset& asset, const std::vector<Level>& levels,
                                            double radius_mm, double height_mm, double max_gap_mm) {
  const Cells cells(asset, levels);
  Clearance clear, wide;
  for (std::size_t i = 0; i < levels.size(); ++i) {
    clear.push_back(cells.clear(i, radius_mm));
    wide.push_back(cells.clear(i, 3 * radius_mm));
  }
  const std::vector<double> thickness_mm = level_thickness(levels, max_gap_mm);
  Best best;
  std::size_t earlier_last = 0;
  for (std::size_t first = 0; first < levels.size(); ++first) {
    const std::size_t last = window_end(levels, first, height_mm, max_gap_mm);
    // The windows that follow are parts of this one.
    if (first > 0 && last + 1 == levels.size() && last == earlier_last) break;
    earlier_last = last;
    search_window(levels, cells, clear, wide, thickness_mm, first, last, best);
  }
  if (!best.cell) return std::nullopt;
  NeedlePath& path = best.path;
  for (const auto& level : clear)
    path.has_material.push_back(level[*best.cell]);
  while (path.has_material[path.first] == 0)
    ++path.first;
  while (path.has_material[path.last] == 0)
    --path.last;
  const auto [u_mm, v_mm] = cells.middle_mm(*best.cell);
  path.entry_mm = {rounded(u_mm, 100), rounded(v_mm, 100), levels[path.first].z_mm};
  path.end_mm = point_at(path, levels[path.last].z_mm);
  return path;
}

Result<NeedlePath> plan_needle_path(const Asset& asset, const std::vector<Level>& levels,
                                    const ChosenPoints& points, const PathLimits& limits) {
  NeedlePath path;
  if (!is_straight(levels))
    return refused(
        "its slices do not lie straight above each other, as with a tilted gantry: no straight "
        "path "
        "can be planned through them");
  const Vector3d chosen = in_levels(levels, points.entry_mm);
  path.entry_mm = chosen;
  if (points.target_mm) {
    path.has_target = true;
    path.end_mm = in_levels(levels, *points.target_mm);
    if (!(chosen.z() - path.end_mm.z() >= kLeastDepth_mm))
      return refused(
          name_point("target", *points.target_mm) +
          text_line(" is not below the entry in the stack, by at least %.0f mm: the needle goes "
                    "from the last slices to the first",
                    kLeastDepth_mm));
    path.direction = (path.end_mm - chosen).normalized();
  }
  const double step_mm = asset.lattice.step_mm();
  for (const Level& level : levels)
    path.has_material.push_back(is_in_material(level, step_mm, point_at(path, level.z_mm)) ? 1 : 0);
  if (const std::string why = find_entry(levels, chosen.z(), path); !why.empty())
    return refused(name_point("entry", points.entry_mm) + ": " + why);
  const double top_mm = levels[path.first].z_mm;
  // The surface of bone lies up to half a slice above its topmost level.
  const double surface_mm = top_mm + spacing_at(levels, path.first) / 2;
  if (chosen.z() < top_mm || chosen.z() > surface_mm + kSame_mm)
    path.entry_mm = point_at(path, top_mm);
  path.entry_shift_mm = (path.entry_mm - chosen).norm();
  if (path.has_target) {
    if (!(path.end_mm.z() < top_mm))
      return refused(name_point("target", *points.target_mm) + " lies above the bone on its path");
    path.last = path.first;
    while (path.last + 1 < levels.size() && levels[path.last + 1].z_mm >= path.end_mm.z())
      ++path.last;
  } else {
    path.last = find_end(levels, path, limits);
    path.end_mm = point_at(path, levels[path.last].z_mm);
  }
  const std::vector<double> thickness_mm = level_thickness(levels, limits.gap_mm);
  for (std::size_t i = path.first; i <= path.last; ++i) {
    path.thickness_mm += path.has_material[i] != 0 ? thickness_mm[i] / -path.direction.z() : 0;
    if (i > path.first)
      path.max_gap_mm = std::max(path.max_gap_mm, levels[i - 1].z_mm - levels[i].z_mm);
  }
  return path;
}

std::vector<BoneGap> bone_gaps(const std::vector<Level>& levels, const NeedlePath& path) {
  std::vector<BoneGap> gaps;
  std::size_t above = path.first;
  for (std::size_t i = path.first + 1; i < levels.size(); ++i) {
    if (path.has_material[i] == 0) continue;
    const double mm = gap_mm(levels[above], levels[i]) / -path.direction.z();
    if (mm > kMaxBoneGap_mm) gaps.push_back({above, i, mm});
    if (i > path.last) break;
    above = i;
  }
  return gaps;
}

Vector3d point_at(const NeedlePath& path, double z_mm) {
  return path.entry_mm + (z_mm - path.entry_mm.z()) / path.direction.z() * path.direction;
}

double tilt_deg(const NeedlePath& path) {
  return std::acos(std::clamp(-path.direction.z(), -1.0, 1.0)) * 180 / std::numbers::pi;
}

std::string describe_pose_fault(Fault fault, const DeviceSpecification& device,
                                const SafetyLimits& limits, const Tool& tool,
                                const Pose& T_device_plate) {
  const PoseMargins margins = pose_margins(device, limits, tool, T_device_plate);
  switch (fault) {
    case Fault::kWorkspace:
      if (margins.box_m < 0) {
        std::string beyond = describe_box(limits, T_device_plate);
        return beyond.empty() ? device.describe_fault(fault, T_device_plate) : beyond;
      }
      if (margins.tilt_rad <= limits.plate_tilt_max_rad) return {};
      return describe_beyond("the plate is tilted by", margins.tilt_rad * kDegreesPerRadian,
                             limits.plate_tilt_max_rad * kDegreesPerRadian, " deg", 1);
    case Fault::kToolTilt:
      if (margins.tool_tilt_rad * kDegreesPerRadian <= kMaxTilt_deg) return {};
      return describe_beyond("the tool is tilted by", margins.tool_tilt_rad * kDegreesPerRadian,
                             kMaxTilt_deg, " deg", 1);
    default:
      return device.describe_fault(fault, T_device_plate);
  }
}

PathReport evaluate_path(const HandTrajectory& path, const DeviceSpecification& device,
                         const SafetyLimits& limits, const Tool& tool, double rate_Hz, double to_s,
                         double from_s) {
  PathReport report;
  report.tip_min_m.setConstant(kEndless);
  report.tip_max_m.setConstant(-kEndless);
  report.box_min_m = kEndless;
  const double end_s = std::min(to_s, path.keyframes.back().t_s + 1 / rate_Hz);
  for (std::uint64_t tick = 0; from_s + static_cast<double>(tick) / rate_Hz <= end_s; ++tick) {
    const double t_s = from_s + static_cast<double>(tick) / rate_Hz;
    const HandTarget target = hand_target(path, t_s);
    const Pose T_device_plate = plate_of(target.T_device_tool, tool);
    const Eigen::Vector3d& tip_m = target.T_device_tool.p_m;
    report.tip_min_m = report.tip_min_m.cwiseMin(tip_m);
    report.tip_max_m = report.tip_max_m.cwiseMax(tip_m);
    const PoseMargins margins = pose_margins(device, limits, tool, T_device_plate);
    note_margins(margins, report);
    const PlateSpeed speed = plate_speed(target, T_device_plate);
    report.speed_max_m_per_s = std::max(report.speed_max_m_per_s, speed.m_per_s);
    if (report.breach) continue;
    if (const Fault fault = pose_fault(limits, margins); fault != Fault::kNone) {
      report.breach = {fault, t_s,
                       describe_pose_fault(fault, device, limits, tool, T_device_plate)};
    } else if (std::string fast = describe_speed(limits, speed); !fast.empty()) {
      report.breach = {Fault::kSpeed, t_s, std::move(fast)};
    }
  }
  return report;
}

std::vector<SheetCrossing> sheet_crossings(const HandTrajectory& path, const Tool& tool,
                                           const Sheet& sheet) {
  std::vector<SheetCrossing> crossings;
  for (std::size_t i = 1; i < path.keyframes.size(); ++i) {
    const HandKeyframe& a = path.keyframes[i - 1];
    const HandKeyframe& b = path.keyframes[i];
    const double above_m = a.T_device_tool.p_m.z() - sheet.z_m;
    const double below_m = sheet.z_m - b.T_device_tool.p_m.z();
    if (!(above_m >= 0 && below_m > 0)) continue;
    SheetCrossing crossing;
    crossing.t_s = a.t_s + (b.t_s - a.t_s) * above_m / (above_m + below_m);
    const HandTarget target = hand_target(path, crossing.t_s);
    crossing.tip_m = target.T_device_tool.p_m;
    crossing.T_device_plate = plate_of(target.T_device_tool, tool);
    crossing.coverage =
        overlap(sheet, tool,
                outline_on_lattice(tool, crossing.T_device_plate, sheet.transform, sheet.z_m), {})
            .coverage;
    crossings.push_back(crossing);
  }
  return crossings;
}

}  // namespace trocar::runtime
