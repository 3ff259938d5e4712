// SPDX-License-Identifier: Apache-2.0
#include "runtime/telemetry/published_sheets.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace trocar::runtime {

FirstSheet::FirstSheet(const Sheet& sheet) {
  if (!sheet.hu || sheet.hu->size() != sheet.mesh.vertices.size()) return;
  mesh_ = sheet.mesh;
  grid_ = sheet.grid;
  hu_ = sheet.hu;
}

float FirstSheet::hu_at(LatticePoint point) const {
  // A rounded point may lie just outside of all triangles. Therefore the triangle in which it lies
  // deepest is used.
  const std::vector<float>& hu = *hu_;
  double deepest = -std::numeric_limits<double>::infinity();
  double found = 0;
  LatticeBox box{point, point};
  for (int margin = 2; margin <= 4096 && !std::isfinite(deepest); margin *= 8) {
    box = {{point.x - margin, point.y - margin}, {point.x + margin, point.y + margin}};
    grid_.for_each(mesh_, box, [&](std::uint32_t t) {
      const auto [a, b, c] = corners(mesh_, t);
      const auto area = static_cast<double>(orient2d(a, b, c));
      const std::array<double, 3> coordinate = {static_cast<double>(orient2d(b, c, point)) / area,
                                                static_cast<double>(orient2d(c, a, point)) / area,
                                                static_cast<double>(orient2d(a, b, point)) / area};
      const double depth = std::min({coordinate[0], coordinate[1], coordinate[2]});
      if (depth <= deepest) return;
      deepest = depth;
      const Triangle& v = mesh_.triangles[t];
      double sum = 0, weight = 0;
      for (std::size_t i = 0; i < 3; ++i) {
        const double w = std::max(0.0, coordinate.at(i));
        sum += w * static_cast<double>(hu[v.at(i)]);
        weight += w;
      }
      found = sum / weight;
    });
  }
  return static_cast<float>(found);
}

TelemetrySheet FirstSheet::published(const Sheet& sheet) const {
  TelemetrySheet shown;
  shown.cuts = sheet.cuts;
  // Vertices are numbered in the order of their slots, as in to_slice_mesh(), so that a vertex of
  // the first mesh is found by its slot.
  std::vector<std::uint32_t> number(sheet.mesh.vertices.size(), kNoSlot);
  for (const Triangle& triangle : sheet.mesh.triangles) {
    if (triangle[0] == kNoSlot) continue;
    for (const std::uint32_t v : triangle)
      number[v] = 0;
  }
  std::uint32_t vertices = 0;
  for (std::size_t v = 0; v < number.size(); ++v) {
    if (number[v] == kNoSlot) continue;
    number[v] = vertices++;
    const LatticePoint point = sheet.mesh.vertices[v];
    const Eigen::Vector2d at_m =
        sheet.transform.to_scene({static_cast<double>(point.x), static_cast<double>(point.y)});
    shown.xy_m.push_back(static_cast<float>(at_m.x()));
    shown.xy_m.push_back(static_cast<float>(at_m.y()));
    if (!has_hu()) continue;
    const bool is_first = v < hu_->size() && mesh_.vertices[v] == point;
    shown.hu.push_back(is_first ? (*hu_)[v] : hu_at(point));
  }
  for (const Triangle& triangle : sheet.mesh.triangles) {
    if (triangle[0] == kNoSlot) continue;
    for (const std::uint32_t v : triangle)
      shown.triangles.push_back(number[v]);
  }
  return shown;
}

TelemetryShape published(const SheetShape& shape, const std::vector<std::int32_t>& slices) {
  TelemetryShape shown;
  const auto sheet = std::find(slices.begin(), slices.end(), shape.slice_index);
  shown.sheet = sheet == slices.end() ? -1 : static_cast<std::int32_t>(sheet - slices.begin());
  shown.cuts = shape.cuts;
  shown.z_m = shape.z_m;
  for (std::size_t i = 0; i < shape.vertices_m.size(); ++i) {
    for (const double x : {shape.vertices_m[i][0], shape.vertices_m[i][1], shape.w[i]})
      shown.xyw.push_back(static_cast<float>(x));
  }
  for (const Triangle& triangle : shape.triangles)
    shown.triangles.insert(shown.triangles.end(), triangle.begin(), triangle.end());
  return shown;
}

}  // namespace trocar::runtime
