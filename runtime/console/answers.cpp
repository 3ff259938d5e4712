// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/answers.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <span>

#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"
#include "formats/base/files.h"
#include "formats/base/json.h"
#include "formats/base/text.h"
#include "formats/session/faults.h"
#include "formats/session/recording.h"
#include "formats/session/trainee.h"
#include "runtime/device/device.h"
#include "runtime/haptics/sheet.h"
#include "runtime/haptics/tool.h"

namespace trocar::runtime {
namespace {

constexpr std::uint64_t kMaxAssetBytes = std::uint64_t{1} << 30,
                        kMaxGlbJson = std::uint64_t{64} << 20;
// Two slices lie relative to each other as in the scan if they differ from it by no more than this.
constexpr double kMaxAside_mm = 0.02, kMaxApart_m = 2e-5, kMaxTurned = 1e-4;

/// Returns true if the asset with this JSON text has a surface for display.
bool has_surface(std::string_view glb_json) {
  // Texts from a scan cannot contain this key with unescaped quotes. A false positive would
  // only cost time.
  return glb_json.find("\"surface\":") != std::string_view::npos;
}

/// A scene's bone as the console shows it: the asset, and where its slices lie in {B}.
struct PlacedBone {
  Scene scene;
  Asset asset;  ///< the part of the asset that the scene uses: its slices, with one mesh each
  std::vector<std::unique_ptr<const Sheet>> sheets;
  std::vector<AssetSurface> surfaces;
  /// All slices of the asset, also those that the scene does not use. Empty if load_bone() has read
  /// only the scene's slices (BoneParts).
  std::vector<AssetSlice> all;
};

/// The parts of an asset that load_bone() reads. kForView: the scene's slices, with HU at their
/// vertices; if the asset has a surface, also the surface and all other slices. kWithVolumes: the
/// whole asset, with its volumes of HU.
enum class BoneParts : std::uint8_t { kForView, kWithVolumes };

/// Loads a scene and its bone. If `asset` is not empty, it replaces the asset that the scene names.
/// Errors: kRefused if trocar-run would refuse the scene or the asset.
Result<PlacedBone> load_bone(const std::filesystem::path& scene_file,
                             const std::filesystem::path& asset, BoneParts parts) {
  PlacedBone loaded;
  if (const auto ok = read_scene(scene_file).into(loaded.scene); !ok) return ok.error();
  if (!asset.empty()) loaded.scene.asset = asset;
  const std::string name = loaded.scene.asset.string();
  const Result<std::string> text = glb_json(loaded.scene.asset);
  if (!text) return text.error();
  if (parts == BoneParts::kWithVolumes || has_surface(*text)) {
    const auto bytes = read_file(loaded.scene.asset, kMaxAssetBytes);
    if (!bytes) return bytes.error();
    Result<Asset> whole = decode_asset(*bytes, name);
    if (!whole) return whole.error();
    loaded.surfaces = std::move(whole->surfaces);
    loaded.asset = std::move(*whole);
    if (parts == BoneParts::kForView) add_hu_at_vertices(loaded.asset);
    loaded.all = loaded.asset.slices;
    const std::vector<int> indices = used_slices(loaded.scene);
    const std::set<int> used(indices.begin(), indices.end());
    std::erase_if(loaded.asset.slices,
                  [&used](const AssetSlice& slice) { return !used.contains(slice.index); });
  } else {
    Result<AssetPart> part = read_asset_part(loaded.scene.asset, used_slices(loaded.scene));
    if (!part) return part.error();
    loaded.asset = std::move(part->asset);
    add_hu_at_vertices(loaded.asset);
  }
  if (const auto ok = weld_materials(loaded.asset, name); !ok) return ok.error();
  if (const auto ok = place_body(loaded.scene, loaded.asset, name); !ok) return ok.error();
  if (const auto ok = place_slices(loaded.scene, loaded.asset, name).into(loaded.sheets); !ok)
    return ok.error();
  return loaded;
}

/// Returns the slice of the asset with this slice index. Precondition: the slice exists.
const AssetSlice& slice_of(const Asset& asset, int index) {
  return *std::find_if(asset.slices.begin(), asset.slices.end(),
                       [index](const AssetSlice& slice) { return slice.index == index; });
}

/// Returns the transform from the patient's frame (LPS) to the frame of the topmost sheet's slice
/// (u, v and the slice normal), both in mm. Errors: kRefused if the sheets do not lie relative to
/// each other as in the scan; the message is a sentence that says why.
Result<Eigen::Affine3d> plane_of_surface(const PlacedBone& loaded) {
  const Sheet& top = *loaded.sheets.front();
  const Eigen::Affine3d T_plane_lps = slice_of(loaded.asset, top.slice_index).T_lps_plane.inverse();
  for (const auto& sheet : loaded.sheets) {
    const Eigen::Affine3d between =
        T_plane_lps * slice_of(loaded.asset, sheet->slice_index).T_lps_plane;
    const Eigen::Vector3d shift = between.translation();
    // A scene puts slices straight above each other, so this is the same in all of its scenes.
    if (!between.linear().isIdentity(kMaxTurned) || !(shift.head<2>().norm() < kMaxAside_mm))
      return refused("The scan's slices are not straight above each other (a tilted gantry).");
    if (!(std::abs(shift.z() * 1e-3 - (sheet->z_m - top.z_m)) < kMaxApart_m))
      return refused("The scene's slices are not as far apart as in the scan.");
  }
  return T_plane_lps;
}

/// Returns the transform from the patient's frame (LPS, mm) to {B} (m), including the scale from mm
/// to m. Errors: those of plane_of_surface().
Result<Eigen::Affine3d> device_of_patient(const PlacedBone& loaded) {
  const auto T_plane_lps = plane_of_surface(loaded);
  if (!T_plane_lps) return T_plane_lps.error();
  const Sheet& top = *loaded.sheets.front();
  const auto in_device = [&](const Eigen::Vector3d& lps_mm) {
    const Eigen::Vector3d at = *T_plane_lps * lps_mm;
    const Eigen::Vector2d xy =
        top.transform.to_scene(at.head<2>() / top.transform.lattice.step_mm());
    return Eigen::Vector3d(xy.x(), xy.y(), top.z_m + at.z() * 1e-3);
  };
  Eigen::Affine3d T = Eigen::Affine3d::Identity();
  T.translation() = in_device(Eigen::Vector3d::Zero());
  for (int axis = 0; axis < 3; ++axis)
    T.linear().col(axis) = in_device(Eigen::Vector3d::Unit(axis)) - T.translation();
  return T;
}

double squared(double value) {
  return value * value;
}

using nlohmann::json;

void add_triangles(const AssetSurface& surface, std::size_t first_vertex,
                   std::vector<std::uint32_t>& triangles) {
  for (const auto& triangle : surface.surface.triangles) {
    for (const std::uint32_t v : triangle)
      triangles.push_back(static_cast<std::uint32_t>(first_vertex) + v);
  }
}

/// Finds the HU of the nearest vertex of a scan's slices. Positions are in the plane of
/// the topmost sheet.
class NearestHu {
 public:
  NearestHu(const std::vector<AssetSlice>& slices, const Lattice& lattice,
            const Eigen::Affine3d& T_plane_lps) {
    for (const AssetSlice& slice : slices) {
      if (slice.hu.empty() || slice.hu.size() != slice.mesh.vertices.size()) continue;
      const Eigen::Affine3d T_plane_slice = T_plane_lps * slice.T_lps_plane;
      Layer& layer = layers_[T_plane_slice.translation().z()];
      for (std::size_t v = 0; v < slice.hu.size(); ++v) {
        const LatticePoint p = slice.mesh.vertices[v];
        const Eigen::Vector3d at =
            T_plane_slice * Eigen::Vector3d(lattice.to_mm(p.x), lattice.to_mm(p.y), 0);
        layer[cell(at.x(), at.y())].push_back({at.x(), at.y(), slice.hu[v]});
      }
    }
  }
  bool is_empty() const { return layers_.empty(); }

  float at(const Eigen::Vector3d& p) const {
    auto above = layers_.lower_bound(p.z());
    if (above == layers_.end() ||
        (above != layers_.begin() && p.z() - std::prev(above)->first < above->first - p.z()))
      --above;
    const auto [i, j] = cell(p.x(), p.y());
    constexpr int kMaxRing = 8;
    float hu = 0;
    double nearest = -1;
    for (int ring = 0; ring <= kMaxRing; ++ring) {
      // A vertex of the next ring cannot be nearer than this ring's inner side.
      if (nearest >= 0 && nearest <= squared((ring - 1) * kCell_mm)) break;
      for (int di = -ring; di <= ring; ++di) {
        const int step = std::abs(di) == ring || ring == 0 ? 1 : 2 * ring;
        for (int dj = -ring; dj <= ring; dj += step) {
          const auto found = above->second.find({i + di, j + dj});
          if (found == above->second.end()) continue;
          for (const Sample& sample : found->second) {
            const double distance = squared(sample.u - p.x()) + squared(sample.v - p.y());
            if (nearest >= 0 && distance >= nearest) continue;
            nearest = distance;
            hu = sample.hu;
          }
        }
      }
    }
    return hu;
  }

 private:
  static constexpr double kCell_mm = 2;
  struct Sample {
    double u, v;
    float hu;
  };
  using Cell = std::pair<int, int>;
  using Layer = std::map<Cell, std::vector<Sample>>;
  static Cell cell(double u, double v) {
    // Coordinates of an asset are within 2^24 mm, so the indices fit.
    return {static_cast<int>(std::floor(u / kCell_mm)), static_cast<int>(std::floor(v / kCell_mm))};
  }
  std::map<double, Layer> layers_;
};

json describe_surface(const PlacedBone& loaded, Arrays& arrays) {
  if (loaded.surfaces.empty()) return nullptr;
  const auto T_plane_lps = plane_of_surface(loaded);
  if (!T_plane_lps) return nullptr;
  const Sheet& top = *loaded.sheets.front();
  const NearestHu field(loaded.all, loaded.asset.lattice, *T_plane_lps);
  std::vector<float> vertices, hu;
  std::vector<std::uint32_t> triangles;
  for (const AssetSurface& one : loaded.surfaces) {
    add_triangles(one, vertices.size() / 3, triangles);
    const double step_mm = one.surface.lattice.step_mm();
    for (const SpacePoint& p : one.surface.vertices) {
      const Eigen::Vector3d at = *T_plane_lps * (Eigen::Vector3d(p[0], p[1], p[2]) * step_mm);
      const Eigen::Vector2d xy =
          top.transform.to_scene(at.head<2>() / top.transform.lattice.step_mm());
      for (const double x : {xy.x(), xy.y(), top.z_m + at.z() * 1e-3})
        vertices.push_back(static_cast<float>(x));
      if (!field.is_empty()) hu.push_back(field.at(at));
    }
  }
  return {{"vertices", arrays.add(vertices)},
          {"triangles", arrays.add(triangles)},
          {"hu", field.is_empty() ? json() : json(arrays.add(hu))}};
}

json describe_sheet(const Sheet& sheet, const Asset& asset, Arrays& arrays) {
  const AssetSlice& slice = slice_of(asset, sheet.slice_index);
  std::vector<float> vertices;
  std::vector<std::uint32_t> triangles;
  for (const LatticePoint p : slice.mesh.vertices) {
    const Eigen::Vector2d at =
        sheet.transform.to_scene({static_cast<double>(p.x), static_cast<double>(p.y)});
    vertices.push_back(static_cast<float>(at.x()));
    vertices.push_back(static_cast<float>(at.y()));
  }
  for (const Triangle& triangle : slice.mesh.triangles)
    triangles.insert(triangles.end(), triangle.begin(), triangle.end());
  const bool has_hu = !slice.hu.empty() && slice.hu.size() == slice.mesh.vertices.size();
  return {{"slice", sheet.slice_index},
          {"z_m", sheet.z_m},
          {"vertices", arrays.add(vertices)},
          {"triangles", arrays.add(triangles)},
          {"hu", has_hu ? json(arrays.add(slice.hu)) : json()}};
}

json describe_tool(const SceneTool& scene_tool) {
  const Tool tool = make_tool(scene_tool);
  // The axes of the cross-section are those of the plate, tilted with the tool.
  const Eigen::Quaterniond tilt = rotation_from_z(tool.axis_plate);
  json outline = json::array(), corners = json::array();
  double radius_m = 0;
  for (int i = 0; i < tool.sides; ++i) {
    const Eigen::Vector3d& corner = tool.corner_plate_m[static_cast<std::size_t>(i)];
    const Eigen::Vector3d across = tilt.inverse() * (corner - tool.tip_plate_m);
    outline.push_back({across.x(), across.y()});
    corners.push_back({corner.x(), corner.y(), corner.z()});
    radius_m = std::max(radius_m, across.head<2>().norm());
  }
  return {{"outline_m", outline},
          {"corners_in_plate_m", corners},
          {"tip_in_plate_m", scene_tool.tip_in_plate_m},
          {"axis_in_plate", {tool.axis_plate.x(), tool.axis_plate.y(), tool.axis_plate.z()}},
          {"radius_m", radius_m}};
}

/// Returns the rows of the transform from {B} (m) to the patient's frame (LPS, mm); null if the slices do not lie relative to
/// each other as in the scan.
json patient_of_device(const PlacedBone& loaded) {
  const auto T_device_lps = device_of_patient(loaded);
  if (!T_device_lps) return nullptr;
  const Eigen::Affine3d T_lps_device = T_device_lps->inverse();
  json rows = json::array();
  for (int row = 0; row < 3; ++row)
    rows.push_back(
        {T_lps_device(row, 0), T_lps_device(row, 1), T_lps_device(row, 2), T_lps_device(row, 3)});
  return rows;
}

/// Returns the goals as they are written in the scene; null if it has none.
json goals_of(const std::filesystem::path& scene_file) {
  const auto bytes = read_file(scene_file, std::uint64_t{4} << 20);
  if (!bytes) return nullptr;
  const json scene = parse_json(*bytes);
  return scene.is_object() && scene.contains("goals") ? scene["goals"] : json();
}

constexpr std::uint64_t kMaxBytes = std::uint64_t{2} << 30;
constexpr std::size_t kMaxRows = 200'000;
constexpr int kContactPhases = static_cast<int>(ContactPhase::kFault) + 1;

/// Calls visit(name, values) for each column of a recording of this kind.
template <typename Visit>
void visit_columns(const RecordingRow& row, const RecordingKind& kind, const XrayUse& xray,
                   double rate_Hz, const Visit& visit) {
  const auto one = [&visit](const char* name, auto value) {
    const auto number = static_cast<double>(value);
    visit(name, std::span<const double>(&number, 1));
  };
  one("t_s", row.t_s);
  visit("p_m", row.p_m);
  visit("q", row.q);
  visit("tool_m", row.tool_m);
  visit("wrench_wanted", row.wrench_wanted);
  visit("wrench_delivered", row.wrench_delivered);
  if (!kind.has_pose_device) {
    visit("tau_Nm", row.tau_Nm);
    visit("motor_angle_rad", row.encoder_rad);
  }
  one("phase", row.phase);
  one("active_slice", row.active_slice);
  one("penetration_m", row.penetration_m);
  one("wrench_scale", row.wrench_scale);
  one("pose_residual_m", row.pose_residual_m);
  one("cuts_published", row.cuts_published);
  one("fault", row.fault);
  one("safety", row.safety);
  one("authority", row.authority);
  if (kind.has_guard) one("guard", row.guard);
  one("passivity_J", row.passivity_J);
  one("motor_heat_max", row.motor_heat_max);
  one("tip_N", row.tip_N);
  if (kind.has_xray) {
    one("xray_shots", xray.shots);
    one("xray_screening_s", xray.screening_s(rate_Hz));
  }
  if (!kind.has_cutting) return;
  one("front_z_m", row.cutting.front_z_m);
  one("front_HU", row.cutting.front_HU);
  one("embedded_m", row.cutting.embedded_m);
  one("cut_J", row.cutting.cut_J);
  one("absorbed_J", row.cutting.absorbed_J);
  one("stored_J", row.cutting.stored_J);
}

/// Returns punctures, break-throughs, faults and recoveries. Punctures cannot be found in rows of the force law
/// `cutting`, because the tool is also in holes on its way out.
json events_of(const std::vector<RecordingRow>& rows, bool with_punctures) {
  constexpr std::size_t kMaxEventsOfAnswer = 20'000;
  json events = json::array();
  RecordingRow before;
  FaultStarts faults;
  const auto add_xray = [&events](const char* kind, const char* what, double t_s) {
    events.push_back(
        {{"kind", kind}, {"t_s", t_s}, {"text", text_line("%s at %.3f s", what, t_s)}});
  };
  for (const RecordingRow& row : rows) {
    if (events.size() >= kMaxEventsOfAnswer) break;  // one row can add several
    const bool is_punctured =
        with_punctures && row.phase == ContactPhase::kPunctured &&
        (before.phase != ContactPhase::kPunctured || before.active_slice != row.active_slice);
    if (is_punctured) {
      events.push_back({{"kind", "puncture"},
                        {"t_s", row.t_s},
                        {"slice", row.active_slice},
                        {"tool_z_m", row.tool_m[2]},
                        {"penetration_m", row.penetration_m},
                        {"text", text_line("slice %d punctured at %.3f s: depth %.2f mm",
                                           row.active_slice, row.t_s, row.penetration_m * 1e3)}});
    }
    if (row.break_through_N > 0) {
      events.push_back(
          {{"kind", "break_through"},
           {"t_s", row.t_s},
           {"at", row.break_through_at},
           {"tool_z_m", row.tool_m[2]},
           {"tip_N", row.break_through_N},
           {"text", describe_break_through(row.break_through_at, row.t_s, row.break_through_N)}});
    }
    if (faults.take(row)) {
      const FaultWords& words = words_of(row.fault);
      events.push_back({{"kind", "fault"},
                        {"t_s", row.t_s},
                        {"fault", words.name},
                        {"meaning", words.meaning},
                        {"advice", words.advice},
                        {"text", describe(FaultDetail(row.fault), row.t_s)}});
    }
    if (row.fault != before.fault && row.fault == Fault::kNone) {
      events.push_back(
          {{"kind", "recovered"},
           {"t_s", row.t_s},
           {"fault", to_string(before.fault)},
           {"text", text_line("recovered from %s at %.3f s", to_string(before.fault), row.t_s)}});
    }
    if ((row.xray & kXrayPicture) != 0) add_xray("xray_shot", "X-ray shot", row.t_s);
    if (const int is_on = row.xray & kXrayBeam; is_on != (before.xray & kXrayBeam)) {
      add_xray(is_on != 0 ? "xray_on" : "xray_off",
               is_on != 0 ? "X-ray screening began" : "X-ray screening ended", row.t_s);
    }
    before = row;
  }
  return events;
}

/// More samples than these are thinned, by whole columns and rows.
constexpr std::size_t kMaxSamples = std::size_t{32} << 20;
constexpr std::int16_t kNoHu = -32768;

json array_of(const Eigen::Vector3d& v) {
  return {v.x(), v.y(), v.z()};
}

std::size_t sample_index(int row, int column, int columns) {
  return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
         static_cast<std::size_t>(column);
}

/// Counts how much of each sample's cell in a plane lies in a slice's material, in points of a finer grid.
class Coverage {
 public:
  static constexpr int kFiner = 4;  ///< points along each side of a cell

  Coverage(const HuPlane& plane, const Lattice& lattice)
      : plane_(plane),
        lattice_(lattice),
        columns_(plane.columns * kFiner),
        rows_(plane.rows * kFiner),
        is_inside_(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_)) {}

  void add(const SliceMesh& mesh) {
    for (const Triangle& triangle : mesh.triangles)
      add({at(mesh.vertices[triangle[0]]), at(mesh.vertices[triangle[1]]),
           at(mesh.vertices[triangle[2]])});
  }

  /// Returns for each sample how many of its kFiner * kFiner points are inside.
  std::vector<std::uint8_t> counts() const {
    std::vector<std::uint8_t> counts(static_cast<std::size_t>(plane_.columns) *
                                     static_cast<std::size_t>(plane_.rows));
    for (int row = 0; row < rows_; ++row) {
      for (int column = 0; column < columns_; ++column)
        counts[sample_index(row / kFiner, column / kFiner, plane_.columns)] +=
            is_inside_[sample_index(row, column, columns_)];
    }
    return counts;
  }

 private:
  using Corners = std::array<Eigen::Vector2d, 3>;

  /// A vertex in the finer grid, whose points are at whole numbers.
  Eigen::Vector2d at(LatticePoint p) const {
    const Eigen::Vector2d sample =
        (Eigen::Vector2d(lattice_.to_mm(p.x), lattice_.to_mm(p.y)) - plane_.origin_mm)
            .cwiseQuotient(plane_.pitch_mm);
    return (sample.array() + 0.5) * kFiner - 0.5;
  }

  void add(const Corners& corners) {
    const auto [low, high] = std::minmax({corners[0].y(), corners[1].y(), corners[2].y()});
    if (!(low <= rows_ - 1.0 && high >= 0)) return;  // a conversion to int could overflow
    const int first = static_cast<int>(std::ceil(std::max(0.0, low)));
    const int last = static_cast<int>(std::floor(std::min(rows_ - 1.0, high)));
    for (int row = first; row <= last; ++row)
      add(corners, row);
  }

  /// Marks the points of one row between the triangle's sides.
  void add(const Corners& corners, int row) {
    double left = columns_, right = -1;
    for (std::size_t i = 0; i < 3; ++i) {
      const Eigen::Vector2d &a = corners[i], &b = corners[(i + 1) % 3];
      if (a.y() == b.y() || std::min(a.y(), b.y()) > row || std::max(a.y(), b.y()) < row) continue;
      const double x = a.x() + (row - a.y()) / (b.y() - a.y()) * (b.x() - a.x());
      left = std::min(left, x);
      right = std::max(right, x);
    }
    if (!(left <= columns_ - 1.0 && right >= 0)) return;
    const int first = static_cast<int>(std::ceil(std::max(0.0, left)));
    const int last = static_cast<int>(std::floor(std::min(columns_ - 1.0, right)));
    for (int column = first; column <= last; ++column)
      is_inside_[sample_index(row, column, columns_)] = 1;
  }

  const HuPlane& plane_;
  const Lattice& lattice_;
  int columns_, rows_;
  std::vector<std::uint8_t> is_inside_;
};

std::vector<std::uint8_t> material_of(const HuPlane& plane, const PlacedBone& bone) {
  Coverage coverage(plane, bone.asset.lattice);
  for (const AssetSlice& slice : bone.all) {
    if (slice.index == plane.index) coverage.add(slice.mesh);
  }
  return coverage.counts();
}

std::vector<std::int16_t> hu_of(const HuPlane& plane) {
  std::vector<std::int16_t> hu;
  hu.reserve(plane.hu.size());
  for (const float value : plane.hu)
    hu.push_back(std::isnan(value) ? kNoHu
                                   : static_cast<std::int16_t>(std::clamp(
                                         std::lround(value), long{kNoHu + 1}, long{32767})));
  return hu;
}

/// The values in every n-th column and row.
template <typename Number>
std::vector<Number> thinned(const std::vector<Number>& values, const HuPlane& plane, int every) {
  if (every == 1) return values;
  std::vector<Number> kept;
  for (int row = 0; row < plane.rows; row += every) {
    for (int column = 0; column < plane.columns; column += every)
      kept.push_back(values[sample_index(row, column, plane.columns)]);
  }
  return kept;
}

/// Describes a volume; null if it has no planes. `bone`: where its material is; null: not stated.
json describe(const HuVolume& volume, const Eigen::Affine3d& T_device_lps, const PlacedBone* bone,
              Arrays& arrays) {
  std::size_t samples = 0;
  for (const HuPlane& plane : volume.planes)
    samples += plane.hu.size();
  const int every =
      std::max(1, static_cast<int>(std::ceil(
                      std::sqrt(static_cast<double>(samples) / static_cast<double>(kMaxSamples)))));
  json planes = json::array();
  for (const HuPlane& plane : volume.planes) {
    if (plane.columns < 1 || plane.rows < 1) continue;
    const Eigen::Affine3d T = T_device_lps * plane.T_lps_plane;
    const std::vector<std::int16_t> hu = thinned(hu_of(plane), plane, every);
    planes.push_back(
        {{"slice", plane.index},
         {"origin_m", array_of(T * Eigen::Vector3d(plane.origin_mm.x(), plane.origin_mm.y(), 0))},
         {"column_m", array_of(T.linear().col(0) * (plane.pitch_mm.x() * every))},
         {"row_m", array_of(T.linear().col(1) * (plane.pitch_mm.y() * every))},
         {"columns", (plane.columns + every - 1) / every},
         {"rows", (plane.rows + every - 1) / every},
         {"hu", arrays.add(hu)}});
    if (bone == nullptr) continue;
    const std::vector<std::uint8_t> inside = thinned(material_of(plane, *bone), plane, every);
    planes.back()["inside"] = arrays.add(inside);
  }
  if (planes.empty()) return nullptr;
  return {{"step_HU", volume.grid.step_hu}, {"every", every}, {"planes", std::move(planes)}};
}

/// True if the planes are parallel, in the same directions, and at different heights, so that positions between them are
/// defined. A hostile file may have any planes.
bool is_stack(const HuVolume& volume) {
  constexpr double kMaxUnlike = 1e-3, kMinApart_mm = 0.01;
  if (volume.planes.empty()) return true;
  const Eigen::Matrix3d& axes = volume.planes.front().T_lps_plane.linear();
  std::vector<double> heights_mm;
  for (const HuPlane& plane : volume.planes) {
    if (!plane.T_lps_plane.linear().isApprox(axes, kMaxUnlike)) return false;
    heights_mm.push_back(axes.col(2).dot(plane.T_lps_plane.translation()));
  }
  std::sort(heights_mm.begin(), heights_mm.end());
  for (std::size_t i = 1; i < heights_mm.size(); ++i)
    if (!(heights_mm[i] - heights_mm[i - 1] >= kMinApart_mm)) return false;
  return std::all_of(heights_mm.begin(), heights_mm.end(),
                     [](double height_mm) { return std::isfinite(height_mm); });
}

/// The middle of the scene's sheets in {B}.
Eigen::Vector3d middle_of(const PlacedBone& bone) {
  Eigen::AlignedBox3d box;
  for (const auto& sheet : bone.sheets) {
    for (const LatticePoint p : slice_of(bone.asset, sheet->slice_index).mesh.vertices) {
      const Eigen::Vector2d at =
          sheet->transform.to_scene({static_cast<double>(p.x), static_cast<double>(p.y)});
      box.extend(Eigen::Vector3d(at.x(), at.y(), sheet->z_m));
    }
  }
  return box.center();
}

}  // namespace

Result<std::string> glb_json(const std::filesystem::path& file) {
  Result<std::unique_ptr<ByteSource>> source = open_file(file);
  if (!source) return source.error();
  const Result<std::uint32_t> size = json_bytes_of(**source);
  if (!size) return refused(file.string() + ": " + size.error().message);
  if (*size > kMaxGlbJson) return refused(file.string() + ": its JSON is larger than 64 MiB");
  std::string text(*size, '\0');
  const std::span<std::uint8_t> into(reinterpret_cast<std::uint8_t*>(text.data()), text.size());
  if (const auto read = (*source)->read(kGlbHeader, into); !read) return read.error();
  return text;
}

Result<std::string> bone_of(const std::filesystem::path& scene_file,
                            const std::filesystem::path& asset) {
  const Result<PlacedBone> loaded = load_bone(scene_file, asset, BoneParts::kForView);
  if (!loaded) return loaded.error();
  Arrays arrays;
  json slices = json::array();
  for (const auto& sheet : loaded->sheets)
    slices.push_back(describe_sheet(*sheet, loaded->asset, arrays));
  const json head = {
      {"schema", "trocar.bone/1"},     {"surface", describe_surface(*loaded, arrays)},
      {"slices", std::move(slices)},   {"tool", describe_tool(loaded->scene.tool)},
      {"goals", goals_of(scene_file)}, {"lps_mm_of_device", patient_of_device(*loaded)}};
  return arrays.with_json(json_text(head));
}

Result<PatientBone> patient_bone_of(const std::filesystem::path& scene_file,
                                    const std::filesystem::path& asset) {
  const Result<PlacedBone> loaded = load_bone(scene_file, asset, BoneParts::kForView);
  if (!loaded) return loaded.error();
  PatientBone bone;
  const auto T_device_lps = device_of_patient(*loaded);
  if (!T_device_lps) return bone;
  // DICOM's LPS and RAS differ by the signs of x and y, and {B} is in m.
  bone.T_patient_device =
      Eigen::Scaling(-1.0, -1.0, 1.0) * T_device_lps->inverse() * Eigen::Scaling(1e-3);
  for (const AssetSurface& one : loaded->surfaces) {
    add_triangles(one, bone.vertices_mm.size() / 3, bone.triangles);
    const double step_mm = one.surface.lattice.step_mm();
    for (const SpacePoint& p : one.surface.vertices) {
      for (const double x : {-step_mm * p[0], -step_mm * p[1], step_mm * p[2]})
        bone.vertices_mm.push_back(static_cast<float>(x));
    }
  }
  return bone;
}

Result<std::string> rows_of(const std::filesystem::path& recording) {
  const auto bytes = read_file(recording, kMaxBytes);
  if (!bytes) return bytes.error();
  RecordingOrigin origin;
  bool is_cut = false;
  const auto rows = parse_recording({reinterpret_cast<const char*>(bytes->data()), bytes->size()},
                                    recording.filename().string(), &origin, &is_cut);
  if (!rows) return rows.error();
  const RecordingKind kind = recording_kind(origin);
  const double rate_Hz = origin.number("rate_Hz").value_or(0);
  if (kind.has_xray && !(rate_Hz > 0))
    return refused(recording.filename().string() + ": has X-ray, but not the rate of its ticks");
  const std::size_t every = std::max<std::size_t>(1, (rows->size() + kMaxRows - 1) / kMaxRows);
  XrayUse xray;
  json columns = json::array();
  std::size_t width = 0;
  visit_columns({}, kind, xray, rate_Hz, [&](const char* name, std::span<const double> values) {
    columns.push_back({{"name", name}, {"count", values.size()}});
    width += values.size();
  });
  std::vector<double> table;
  table.reserve((rows->size() / every + 2) * width);
  const auto append = [&table](const char*, std::span<const double> values) {
    table.insert(table.end(), values.begin(), values.end());
  };
  for (std::size_t i = 0; i < rows->size(); ++i) {
    const RecordingRow& row = (*rows)[i];
    xray.add(row);
    if (i % every == 0 || i + 1 == rows->size()) visit_columns(row, kind, xray, rate_Hz, append);
  }
  Arrays arrays;
  const auto at = arrays.add(table);
  return arrays.with_json(json_text({{"schema", "trocar.rows/1"},
                                     {"is_cut", is_cut},
                                     {"columns", columns},
                                     {"rows", table.size() / width},
                                     {"every", every},
                                     {"rows_at", at},
                                     {"phases", names_of<ContactPhase>(kContactPhases)},
                                     {"faults", names_of<Fault>(kFaults)},
                                     {"safety_states", names_of<SafetyState>(kSafetyStates)},
                                     {"events", events_of(*rows, !kind.has_cutting)}}));
}

Result<std::string> volume_of(const std::filesystem::path& scene_file,
                              const std::filesystem::path& asset) {
  const Result<PlacedBone> bone = load_bone(scene_file, asset, BoneParts::kWithVolumes);
  if (!bone) return bone.error();
  json head = {{"schema", "trocar.volume/1"}, {"bone", nullptr}, {"context", nullptr}};
  Arrays arrays;
  if (const auto T = device_of_patient(*bone); !T) {
    head["why"] = T.error().message;
  } else if (bone->asset.hu.planes.empty()) {
    head["why"] = "The asset has no HU.";
  } else if (!is_stack(bone->asset.hu) || !is_stack(bone->asset.context)) {
    head["why"] = "The scan's slices are not parallel.";
  } else {
    const auto axis = [&](const Eigen::Vector3d& lps) {
      return array_of((T->linear() * lps).normalized());
    };
    head["patient"] = {{"left", axis(Eigen::Vector3d::UnitX())},
                       {"back", axis(Eigen::Vector3d::UnitY())},
                       {"head", axis(Eigen::Vector3d::UnitZ())}};
    head["middle_m"] = array_of(middle_of(*bone));
    head["bone"] = describe(bone->asset.hu, *T, &*bone, arrays);
    head["context"] = describe(bone->asset.context, *T, nullptr, arrays);
    if (head["bone"].is_null()) head["why"] = "The asset has no HU.";
  }
  return arrays.with_json(json_text(head));
}

}  // namespace trocar::runtime
