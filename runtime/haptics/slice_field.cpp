// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/slice_field.h"

#include <limits>

namespace trocar::runtime {
namespace {

constexpr float kNoMaterial = std::numeric_limits<float>::quiet_NaN();

bool has_label(const TissueChoice& choice, const NamedTissue& tissue) {
  return std::any_of(tissue.labels.begin(), tissue.labels.end(), [&](int wanted) {
    return std::find(choice.asset_labels.begin(), choice.asset_labels.end(), wanted) !=
           choice.asset_labels.end();
  });
}

bool has_hu(const TissueChoice& choice, const NamedTissue& tissue) {
  return tissue.hu && choice.mean_hu && *choice.mean_hu >= (*tissue.hu)[0] &&
         *choice.mean_hu <= (*tissue.hu)[1];
}

}  // namespace

SliceField::SliceField(const SliceMesh& mesh, std::span<const float> hu, const Lattice& lattice,
                       const HuPlane* plane)
    : has_hu_(plane != nullptr || !hu.empty()) {
  if (mesh.vertices.empty()) return;
  const LatticeBox box = box_around(std::span<const LatticePoint>(mesh.vertices));
  const double step_mm = lattice.step_mm();
  const double width_mm = static_cast<double>(std::int64_t{box.high.x} - box.low.x) * step_mm,
               height_mm = static_cast<double>(std::int64_t{box.high.y} - box.low.y) * step_mm;
  pixel_mm_ = std::max(kPixel_mm, std::sqrt(width_mm * height_mm / kMaxPixels));
  left_mm_ = box.low.x * step_mm;
  bottom_mm_ = box.low.y * step_mm;
  columns_ = static_cast<int>(width_mm / pixel_mm_) + 1;
  rows_ = static_cast<int>(height_mm / pixel_mm_) + 1;
  hu_.assign(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_), kNoMaterial);
  const auto place = [&](std::uint32_t v) {
    return Eigen::Vector2d((mesh.vertices[v].x * step_mm - left_mm_) / pixel_mm_,
                           (mesh.vertices[v].y * step_mm - bottom_mm_) / pixel_mm_);
  };
  for (const Triangle& t : mesh.triangles) {
    const Eigen::Vector2d a = place(t[0]), ab = place(t[1]) - a, ac = place(t[2]) - a;
    const double doubled = ab.x() * ac.y() - ab.y() * ac.x();
    const Eigen::Vector2d low = a.cwiseMin(a + ab).cwiseMin(a + ac),
                          high = a.cwiseMax(a + ab).cwiseMax(a + ac);
    const int top = std::min(rows_ - 1, static_cast<int>(high.y() - 0.5)),
              right = std::min(columns_ - 1, static_cast<int>(high.x() - 0.5));
    for (int r = std::max(0, static_cast<int>(std::ceil(low.y() - 0.5))); r <= top; ++r) {
      for (int c = std::max(0, static_cast<int>(std::ceil(low.x() - 0.5))); c <= right; ++c) {
        const Eigen::Vector2d p(c + 0.5 - a.x(), r + 0.5 - a.y());
        const double at_b = (p.x() * ac.y() - p.y() * ac.x()) / doubled,
                     at_c = (ab.x() * p.y() - ab.y() * p.x()) / doubled;
        if (at_b < 0 || at_c < 0 || at_b + at_c > 1) continue;
        double value = 0;
        if (plane != nullptr) {
          value = static_cast<double>(
              plane->at(left_mm_ + (c + 0.5) * pixel_mm_, bottom_mm_ + (r + 0.5) * pixel_mm_));
          if (std::isnan(value)) value = 0;
        } else if (has_hu_) {
          value = (1 - at_b - at_c) * hu[t[0]] + at_b * hu[t[1]] + at_c * hu[t[2]];
        }
        hu_[static_cast<std::size_t>(r) * static_cast<std::size_t>(columns_) +
            static_cast<std::size_t>(c)] = static_cast<float>(value);
      }
    }
  }
  if (!has_hu_) return;
  double sum = 0;
  std::size_t filled = 0;
  for (const float value : hu_) {
    if (std::isnan(value)) continue;
    sum += value;
    ++filled;
  }
  if (filled > 0) mean_hu_ = sum / static_cast<double>(filled);
}

float SliceField::at(double x_mm, double y_mm) const noexcept {
  const double c = (x_mm - left_mm_) / pixel_mm_, r = (y_mm - bottom_mm_) / pixel_mm_;
  if (!(c >= 0 && r >= 0 && c < columns_ && r < rows_)) return kNoMaterial;
  return hu_[static_cast<std::size_t>(r) * static_cast<std::size_t>(columns_) +
             static_cast<std::size_t>(c)];
}

SliceField::Mean SliceField::mean(const PlanarTransform& transform, const Eigen::Vector2d& at_m,
                                  double radius_m) const noexcept {
  const std::array<Eigen::Vector2d, 19>& points = disc_points();
  const double step_mm = transform.lattice.step_mm();
  const Eigen::Vector2d middle_mm = transform.to_lattice(at_m) * step_mm;
  Mean mean;
  int within = 0;
  for (const Eigen::Vector2d& p : points) {
    const Eigen::Vector2d q = middle_mm + radius_m * 1e3 * p;
    const float hu = at(q.x(), q.y());
    if (std::isnan(hu)) continue;
    ++within;
    mean.hu += hu;
  }
  if (within == 0) return mean;
  mean.hu /= within;
  mean.share = within / static_cast<double>(points.size());
  return mean;
}

TissueChoice choose_tissue(const Scene& scene, const SceneSlice& wanted, const Asset& asset,
                           const AssetSlice& slice) {
  TissueChoice choice;
  choice.tissue = scene.tissue;
  choice.asset_labels = labels_of(asset);
  choice.mean_hu = mean_hu_of(slice);
  for (const NamedTissue& tissue : scene.tissues) {
    const bool named = wanted.tissue && tissue.name == *wanted.tissue;
    if (!named && (wanted.tissue || !(has_label(choice, tissue) || has_hu(choice, tissue))))
      continue;
    choice.tissue = tissue.tissue;
    choice.name = tissue.name;
    choice.reason = named                       ? TissueReason::kNamed
                    : has_label(choice, tissue) ? TissueReason::kLabel
                                                : TissueReason::kMeanHu;
    break;
  }
  return choice;
}

}  // namespace trocar::runtime
