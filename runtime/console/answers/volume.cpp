// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/answers/volume.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/base/json_text.h"
#include "runtime/console/answers/container.h"
#include "runtime/console/answers/placed_bone.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;

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
