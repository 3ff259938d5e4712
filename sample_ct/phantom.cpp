// SPDX-License-Identifier: Apache-2.0
#include "sample_ct/phantom.h"

#include <array>
#include <limits>
#include <numbers>

#include "sample_ct/random.h"

namespace trocar::sample {
namespace {

/// Fraction of a solid at signed distance d from its surface: Phi(-d / sigma).
double coverage(double d, double sigma) {
  if (sigma <= 0) return d < 0 ? 1.0 : 0.0;
  const double t = d / sigma;
  if (t > 6) return 0;
  if (t < -6) return 1;
  return 0.5 * std::erfc(t * (1 / std::numbers::sqrt2));
}

/// Signed distance from an upright elliptic cylinder. It is 1-Lipschitz, and smaller than the true
/// distance along the longer axis.
struct EllipseColumn {
  Vec2 centre;
  Vec2 semi_axes;
  Vec2 along{1, 0};  // direction of the first semi-axis, length 1 within 1e-3
};
double column_distance(Vec2 p, const EllipseColumn& e) {
  const Vec2 w = p - e.centre;
  const Vec2 q{dot(e.along, w) / e.semi_axes.x, cross(e.along, w) / e.semi_axes.y};
  return (norm(q) - 1) * std::min(e.semi_axes.x, e.semi_axes.y);
}

// Muscles of one side, in the anatomical frame. The other side is the mirror image.
constexpr EllipseColumn kPatient{{0, -12}, {168, 106}};
constexpr double kSkin_mm = 1.6;
constexpr EllipseColumn kAbdomen{{0, -62}, {120, 40}};
constexpr std::array<EllipseColumn, 5> kMuscles{{
    {{40, 3}, {20, 25}, {0.989, 0.149}},      // psoas
    {{71, 26}, {9, 21}, {0.878, 0.479}},      // quadratus lumborum
    {{41, 61}, {25, 18}, {0.989, 0.149}},     // erector spinae
    {{13.5, 54}, {13, 17}, {0.969, -0.247}},  // multifidus
    {{20, 33}, {26, 13}, {0.939, 0.343}},     // filling around the joints
}};
constexpr EllipseColumn kAorta{{9, -30}, {9.5, 9.5}};
constexpr EllipseColumn kVenaCava{{-16, -27}, {12.5, 8.5}, {0.980, 0.199}};

}  // namespace

Vec3 to_anatomy(const PhantomOptions& phantom, Vec3 p) {
  const double c = std::cos(phantom.rotation_rad), s = std::sin(phantom.rotation_rad);
  const double x = p.x - phantom.shift_mm.x, y = p.y - phantom.shift_mm.y;
  return {c * x + s * y, -s * x + c * y, p.z};
}

BoneSample sample_bone(const PhantomOptions& phantom, Vec3 p_scan) {
  return sample_bone(to_anatomy(phantom, p_scan));
}

BoneFractions blurred_fractions(const PhantomOptions& phantom, const BoneSample& bone) {
  return {coverage(bone.distance_mm, phantom.edge_sigma_mm),
          coverage(bone.distance_mm + bone.cortical_mm, phantom.edge_sigma_mm)};
}

double blur_radius_mm(const PhantomOptions& phantom) {
  return 3.4 * phantom.edge_sigma_mm;
}

double soft_tissue_hu(const PhantomOptions& phantom, Vec3 p_scan) {
  const Vec3 p = to_anatomy(phantom, p_scan);
  const TissueHu& tissue = phantom.tissue;
  const double sigma = phantom.edge_sigma_mm;
  const Vec2 q{p.x, p.y}, mirrored{std::abs(p.x), p.y};
  const double skin = column_distance(q, kPatient);
  if (skin > 6 * sigma) return tissue.air;

  const double texture =
      tissue.soft_texture * value_noise(phantom.seed ^ 0x50f7, p.x / 2.6, p.y / 2.6, p.z / 6.0);
  double hu = tissue.fat + texture;
  const auto lay = [&](double tissue_hu, double d) { hu += (tissue_hu - hu) * coverage(d, sigma); };

  // Muscle bellies have uneven rims. Fat fills thin sheets along the zero crossings of a smooth
  // noise; the sheets are thickest where another noise is high.
  const double uneven = 2.2 * value_noise(phantom.seed ^ 0xb311, p.x / 7.0, p.y / 7.0, p.z / 25.0);
  double muscle = std::numeric_limits<double>::infinity();
  for (const EllipseColumn& column : kMuscles)
    muscle = std::min(muscle, column_distance(mirrored, column));
  const double u = 0.83 * p.x - 0.56 * p.y, v = 0.56 * p.x + 0.83 * p.y;
  const double sheet = std::abs(value_noise(phantom.seed ^ 0x57e4, u / 9.0, v / 7.0, p.z / 25.0));
  const double width = 0.07 * value_noise(phantom.seed ^ 0x31d7, v / 6.0, u / 6.0, p.z / 20.0);
  lay(tissue.muscle + texture, std::max(muscle + uneven, 8.0 * (width - sheet)));
  lay(tissue.bowel + texture, column_distance(q, kAbdomen) + 4 * uneven);
  lay(tissue.vessel, std::min(column_distance(q, kAorta), column_distance(q, kVenaCava)));
  // Ligaments around the column, the discs, the contents of the canal.
  const double column = disc_column_distance_mm(p);
  lay(tissue.muscle, column - 1.2);
  lay(tissue.disc, column);
  lay(tissue.canal, canal_distance_mm(p));
  lay(tissue.skin, std::abs(skin + 0.5 * kSkin_mm) - 0.5 * kSkin_mm);
  lay(tissue.air, -skin);
  return hu;
}

double cancellous_hu(const PhantomOptions& phantom, Vec3 p_scan) {
  const Vec3 p = to_anatomy(phantom, p_scan);
  const double fine = value_noise(phantom.seed ^ 0xcace, p.x / 1.5, p.y / 1.5, p.z / 2.5);
  const double coarse = value_noise(phantom.seed ^ 0xce11, p.x / 4.0, p.y / 4.0, p.z / 4.0);
  return phantom.tissue.cancellous +
         phantom.tissue.cancellous_texture * (0.6 * fine + 0.4 * coarse);
}

}  // namespace trocar::sample
