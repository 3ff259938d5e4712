// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/review/mesh_thumbnail.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace trocar::pipeline {
namespace {

// All colours are RGB. The picture is drawn larger and then reduced, which makes its lines smooth.
constexpr int kLarger = 3, kShift = 4;
const cv::Scalar kPaper(20, 22, 25), kInk(255, 165, 0);
constexpr double kDarkest = 0.35, kEdge = 0.62, kMarginShare = 0.04;
constexpr std::array<std::array<double, 3>, 6> kMaterials{{{235, 228, 214},
                                                           {86, 180, 233},
                                                           {0, 158, 115},
                                                           {240, 228, 66},
                                                           {204, 121, 167},
                                                           {213, 94, 0}}};

struct HuRange {
  float low = std::numeric_limits<float>::max(), high = std::numeric_limits<float>::lowest();
};

// The HU at a triangle's centroid; NaN if the asset has none.
float hu_at(const Asset& asset, const AssetSlice& slice, const Triangle& t) {
  const HuPlane* const plane = asset.hu.find(slice.index);
  if (plane == nullptr) return std::numeric_limits<float>::quiet_NaN();
  double x = 0, y = 0;
  for (const std::uint32_t v : t) {
    x += asset.lattice.to_mm(slice.mesh.vertices[v].x) / 3;
    y += asset.lattice.to_mm(slice.mesh.vertices[v].y) / 3;
  }
  return plane->at(x, y);
}

// Brightness of a triangle, from 0 for the lowest HU of the slice to 1 for the highest.
double brightness(float hu, const HuRange& range) {
  if (std::isnan(hu) || !(range.high > range.low)) return 1;
  return (static_cast<double>(hu) - range.low) / (static_cast<double>(range.high) - range.low);
}

cv::Scalar colour(int material, double light) {
  const auto& c = kMaterials[static_cast<std::size_t>(material) % kMaterials.size()];
  return {c[0] * light, c[1] * light, c[2] * light};
}

}  // namespace

std::optional<int> middle_slice(const Asset& asset) {
  std::vector<int> with;
  for (const AssetSlice& s : asset.slices) {
    if (!s.mesh.triangles.empty() && (with.empty() || with.back() != s.index))
      with.push_back(s.index);
  }
  if (with.empty()) return {};
  return with[with.size() / 2];
}

Thumbnail draw_thumbnail(const Asset& asset, int slice, int size_px) {
  std::vector<const AssetSlice*> shown;
  Eigen::AlignedBox2d box;
  HuRange range;
  for (const AssetSlice& s : asset.slices) {
    if (s.index != slice || s.mesh.triangles.empty()) continue;
    shown.push_back(&s);
    for (const LatticePoint p : s.mesh.vertices)
      box.extend(Eigen::Vector2d(p.x, p.y));
    for (const Triangle& t : s.mesh.triangles) {
      const float hu = hu_at(asset, s, t);
      if (hu < range.low) range.low = hu;
      if (hu > range.high) range.high = hu;
    }
  }
  const double width = box.sizes().x(), height = box.sizes().y();
  const int large = size_px * kLarger;
  const double scale = large * (1 - 2 * kMarginShare) / std::max({width, height, 1.0});
  const auto pixel = [&](LatticePoint p) {
    const auto along = [&](double value, double low, double size) {
      return static_cast<int>(
          std::lround(((value - low - size / 2) * scale + large / 2.0) * (1 << kShift)));
    };
    return cv::Point(along(p.x, box.min().x(), width), along(p.y, box.min().y(), height));
  };
  cv::Mat sheet(large, large, CV_8UC3, kPaper);
  for (const AssetSlice* s : shown) {
    for (const Triangle& t : s->mesh.triangles) {
      const std::array<cv::Point, 3> corners{pixel(s->mesh.vertices[t[0]]),
                                             pixel(s->mesh.vertices[t[1]]),
                                             pixel(s->mesh.vertices[t[2]])};
      const double light = kDarkest + (1 - kDarkest) * brightness(hu_at(asset, *s, t), range);
      cv::fillConvexPoly(sheet, corners.data(), 3, colour(s->material, light), cv::LINE_8, kShift);
      for (std::size_t k = 0; k < 3; ++k)
        cv::line(sheet, corners[k], corners[(k + 1) % 3], colour(s->material, light * kEdge), 1,
                 cv::LINE_8, kShift);
    }
  }
  for (const AssetSlice* s : shown) {
    for (const Ring& ring : s->pslg.rings) {
      for (std::size_t i = 0; i < ring.size(); ++i)
        cv::line(sheet, pixel(ring[i]), pixel(ring[(i + 1) % ring.size()]), kInk, kLarger,
                 cv::LINE_8, kShift);
    }
  }
  cv::Mat small;
  cv::resize(sheet, small, {size_px, size_px}, 0, 0, cv::INTER_AREA);
  const double step = asset.lattice.step_mm();
  return {{small.cols, small.rows, std::vector<std::uint8_t>(small.datastart, small.dataend)},
          width * step,
          height * step};
}

}  // namespace trocar::pipeline
