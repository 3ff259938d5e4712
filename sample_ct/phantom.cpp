// SPDX-License-Identifier: Apache-2.0
#include "sample_ct/phantom.h"

#include <array>
#include <limits>
#include <numbers>

#include "sample_ct/random.h"

namespace trocar::sample {
namespace {

// Shape of the vertebral body.
constexpr double kWaist_mm = 1.8;           // depth of the side walls' concavity, half-way up
constexpr double kEndPlateHollow_mm = 1.3;  // depth of the end-plates' concavity, at their middle
constexpr double kEndPlateRadius_mm = 17.0;
constexpr double kCorticalBody_mm = 1.0;
constexpr double kCorticalEndPlate_mm = 0.8;
constexpr double kCorticalArch_mm = 1.3;
// Joint space between a superior articular process and the inferior one of the
// vertebra above, which it encloses.
constexpr double kJointSpace_mm = 1.9;

/// The body's outline in an axial plane: round in front, flat and slightly concave behind; 45 mm
/// wide, 33 mm deep.
double body_outline(Vec2 p) {
  const double front = norm(p - Vec2{std::clamp(p.x, -2.5, 2.5), 2.0}) - 20.3;
  const double rear = smooth_max(p.y - 16.5, 29.5 - norm(p - Vec2{0, 45.0}), 1.0);
  return smooth_max(front, rear, 7.0);
}

struct BodySample {
  double distance = 0;
  double end_plate = 0;  // 0 at the side walls .. 1 at the end-plates
};

BodySample sample_body(Vec3 p) {
  constexpr double kWaistSlope = 2 * kWaist_mm / kBodyHalfHeight_mm;
  constexpr double kHollowSlope = 2 * kEndPlateHollow_mm / kEndPlateRadius_mm;
  static const double waist_scale = 1 / std::sqrt(1 + kWaistSlope * kWaistSlope);
  static const double hollow_scale = 1 / std::sqrt(1 + kHollowSlope * kHollowSlope);

  const double s = std::min(std::abs(p.z) / kBodyHalfHeight_mm, 1.0);
  const double side = (body_outline({p.x, p.y}) + kWaist_mm * (1 - s * s)) * waist_scale;
  const double r = norm(Vec2{p.x, p.y + 1.0}) / kEndPlateRadius_mm;
  const double hollow = kEndPlateHollow_mm * std::max(1 - r * r, 0.0);
  const double end = (std::abs(p.z) - (kBodyHalfHeight_mm - hollow)) * hollow_scale;

  // Opening of the basivertebral vein in the middle of the rear wall.
  const double vein = round_cone_distance(p, {0, 19, 0.5}, {0, 10, 0.5}, 2.6, 0.9);
  return {smooth_max(smooth_max(side, end, 2.5), -vein, 1.5),
          std::clamp(0.5 + 0.5 * (end - side), 0.0, 1.0)};
}

/// A ball that contains a solid, so that the solid can be skipped if it is too far away to matter.
/// The larger of the solid's and the ball's distance is used. This describes the same solid, is
/// still 1-Lipschitz, and is never below the ball's distance. So skipping the solid does not change
/// the result.
struct Ball {
  Vec3 centre;
  double radius;
  double distance(Vec3 p) const { return sphere_distance(p, centre, radius); }
};

/// Adds a solid to the union with the distance d, blended over k. `solid` gives the solid's
/// distance; it is called only if the solid is near.
template <typename Solid>
double add(double d, Vec3 p, Ball ball, double k, const Solid& solid) {
  const double bound = ball.distance(p);
  return bound >= d + k ? d : smooth_min(d, std::max(solid(), bound), k);
}

/// The coordinates of p in a frame with its origin at the centre, rotated about z so that x is
/// along (c, s).
Vec3 rotated(Vec3 p, Vec3 centre, double c, double s) {
  const Vec3 w = p - centre;
  return {c * w.x + s * w.y, -s * w.x + c * w.y, w.z};
}

/// Direction of the facet joints in the axial plane (x >= 0), front to rear.
constexpr Vec2 kFacetAlong{0.450, 0.893};

/// The inferior articular process (x >= 0): down from the lamina, oblong along the
/// facet, whose rear end lies farther out than its front end.
constexpr Ball kInferiorBall{{11, 36, -17}, 18};
double inferior_process(Vec3 p) {
  const double stem = round_cone_distance(p, {12.2, 34.0, -5}, {10.8, 36.0, -16}, 4.2, 4.6);
  constexpr std::array<Vec2, 6> kPlate{
      {{-2.8, -12}, {2.8, -12}, {3.0, -19}, {0.9, -26.8}, {-0.9, -26.8}, {-2.8, -19}}};
  const Vec3 q = rotated(p, {10.9, 36.0, 0}, kFacetAlong.x, kFacetAlong.y);
  const double tip = plate_distance(polygon_distance({q.x, q.z}, kPlate), q.y, 0.7, 3.6);
  return std::max(smooth_min(stem, tip, 3.0), kInferiorBall.distance(p));
}

double pedicle(Vec3 p) {
  // An upright oval rod from the upper half of the body to the back.
  return rounded_box_distance(p - Vec3{15.4, 19.5, 4.8}, {0.5, 9.0, 3.2}, 3.6);
}

double lamina(Vec3 p) {
  constexpr Vec2 kStart{14.6, 27.4};
  constexpr Vec2 kAlong{-0.80, 0.60};  // in the axial plane, length 1
  constexpr std::array<Vec2, 4> kPlate{{{0, 5.0}, {18.0, 0.5}, {18.0, -13.0}, {0, -10.5}}};
  const Vec2 w = Vec2{p.x, p.y} - kStart;
  return plate_distance(polygon_distance({dot(w, kAlong), p.z}, kPlate), cross(kAlong, w), 0.9,
                        1.9);
}

double spinous_process(Vec3 p) {
  // Hatchet-shaped in the sagittal plane, thick at its rim.
  constexpr std::array<Vec2, 7> kPlate{
      {{37, 0}, {52, -3.5}, {64, -4.5}, {68, -9}, {67, -17.5}, {61, -20}, {37, -12}}};
  const double plate = plate_distance(polygon_distance({p.y, p.z}, kPlate), p.x, 0.5, 2.1);
  const double rim = round_cone_distance(p, {0, 68.0, -8.5}, {0, 66.0, -18.5}, 3.0, 4.2);
  return smooth_min(plate, rim, 3.5);
}

double transverse_process(Vec3 p) {
  constexpr Vec2 kStart{17.0, 25.5};
  constexpr Vec2 kAlong{0.7986, 0.6018};
  constexpr std::array<Vec2, 6> kPlate{
      {{-1, 8.0}, {14, 6.5}, {30, 7.5}, {33, 4.0}, {14, 0.5}, {-1, -1.5}}};
  const Vec2 w = Vec2{p.x, p.y} - kStart;
  const double root = round_cone_distance(p, {18, 26.5, 3.5}, {28, 33.5, 3.5}, 4.6, 2.0);
  return smooth_min(
      plate_distance(polygon_distance({dot(w, kAlong), p.z}, kPlate), cross(kAlong, w), 0.2, 2.2),
      root, 3.0);
}

double superior_process(Vec3 p) {
  // The process itself, and the mammillary process on its rear rim.
  constexpr std::array<Vec2, 6> kPlate{
      {{-4, 4.5}, {4, 4.5}, {4.2, 11.5}, {1.2, 18.4}, {-1.5, 18.4}, {-4.2, 11.5}}};
  const Vec3 q = rotated(p, {18.2, 31.0, 0}, kFacetAlong.x, kFacetAlong.y);
  const double process = plate_distance(polygon_distance({q.x, q.z}, kPlate), q.y, 0.8, 3.9);
  const double mammillary = round_cone_distance(p, {20.5, 35.0, 8}, {20.4, 37.2, 15}, 3.2, 2.7);
  return smooth_min(process, mammillary, 2.5);
}

/// Everything behind the body (x >= 0).
double arch(Vec3 p) {
  double d = pedicle(p);
  d = add(d, p, {{14.2, 32.9, -0.75}, 12}, 3.0, [&] {  // pars
    return round_cone_distance(p, {15.8, 29.0, 5.5}, {12.8, 33.6, -7}, 4.4, 4.0);
  });
  d = add(d, p, kInferiorBall, 2.0, [&] { return inferior_process(p); });
  d = add(d, p, {{7.4, 32.8, -4}, 16}, 2.5, [&] { return lamina(p); });
  d = add(d, p, {{0, 53.5, -10.5}, 24}, 3.5, [&] { return spinous_process(p); });
  d = add(d, p, {{29, 35, 3.5}, 24}, 4.0, [&] { return transverse_process(p); });
  d = add(d, p, {{19, 32, 11}, 15}, 2.5, [&] { return superior_process(p); });
  // The facet is the process without the upper vertebra's inferior process and without the joint
  // space.
  constexpr double kRound = 1.0;
  const Vec3 q = p - Vec3{0, 0, kVertebraPitch_mm};
  if (kJointSpace_mm - kInferiorBall.distance(q) <= d - kRound) return d;
  return smooth_max(d, kJointSpace_mm - inferior_process(q), kRound);
}
constexpr double kArchFront_mm = 6.0;  // the arch lies behind this y

// Signed distance from the vertebral canal, negative inside. The canal has the same cross-section
// at every height, 23 mm wide and 16 mm deep.
double canal_distance_mm(Vec3 p) {
  constexpr std::array<Vec2, 5> kCanal{
      {{-6.0, 20.3}, {6.0, 20.3}, {7.7, 23.0}, {0, 28.9}, {-7.7, 23.0}}};
  return polygon_distance({std::abs(p.x), p.y}, kCanal) - 3.8;
}

// Signed distance from the column of vertebral bodies and discs, positive outside. At every
// height, the column has the outline of the body, grown by 1 mm, because the discs bulge.
double disc_column_distance_mm(Vec3 p) {
  return body_outline({p.x, p.y}) - 1.0;
}

BoneSample sample_vertebra(Vec3 p) {
  const Vec3 q{std::abs(p.x), p.y, p.z};
  const BodySample body = sample_body(p);
  const double shell =
      kCorticalBody_mm + (kCorticalEndPlate_mm - kCorticalBody_mm) * body.end_plate;
  constexpr double kBlend = 3.0;
  const double front = kArchFront_mm - p.y;
  if (front >= body.distance + kBlend) return {body.distance, shell};

  const double behind = std::max(smooth_max(arch(q), -canal_distance_mm(p), 1.5), front);
  const double d = smooth_min(body.distance, behind, kBlend);
  const double to_arch = std::clamp(0.5 + 0.25 * (body.distance - behind), 0.0, 1.0);
  return {d, shell + (kCorticalArch_mm - shell) * to_arch};
}

/// Bound of a whole vertebra: a ball between two planes. It is used like the ball of a solid.
double vertebra_bound(Vec3 p) {
  constexpr Ball kBall{{0, 27, -4}, 56};
  return std::max({kBall.distance(p), -32.0 - p.z, p.z - 24.0});
}

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

BoneSample sample_bone(Vec3 p) {
  // Evaluate the nearest vertebra first, and another one only if its bound is nearer.
  const double level = std::clamp(std::round(p.z / kVertebraPitch_mm), -1.0, 1.0);
  BoneSample best{std::numeric_limits<double>::infinity(), kCorticalBody_mm};
  for (const double other : {0.0, -1.0, 1.0}) {
    const double at = level + other;
    if (at < -1.0 || at > 1.0) continue;
    const Vec3 q = p - Vec3{0, 0, at * kVertebraPitch_mm};
    const double bound = vertebra_bound(q);
    if (bound >= best.distance_mm) continue;
    BoneSample sample = sample_vertebra(q);
    sample.distance_mm = std::max(sample.distance_mm, bound);
    if (sample.distance_mm < best.distance_mm) best = sample;
  }
  return best;
}

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
