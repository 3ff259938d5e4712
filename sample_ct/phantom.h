// SPDX-License-Identifier: Apache-2.0
// The phantom: a lumbar vertebra and what surrounds it.
#pragma once

#include <cstdint>

#include "sample_ct/sdf.h"

namespace trocar::sample {

// The bone of the phantom: an L3-like lumbar vertebra as a blend of analytic solids. The same
// vertebra is repeated above and below, so that the facet joints (the small joints between the
// arches of neighbouring vertebrae) are complete, as in a real scan.
//
// Anatomical frame (mm): x to the patient's left, y to the back, z up; origin at the middle of the
// vertebral body of the middle vertebra. The left half is the mirror image of the right half.
// Proportions follow a clinical CT of an L3 (see README.md).

/// Distance between neighbouring vertebrae along z: 28 mm for the body and 10 mm for the disc.
inline constexpr double kVertebraPitch_mm = 38.0;
/// Half the height of the vertebral body, measured at the rim of its end plates (its upper and
/// lower faces, which are hollow in the middle).
inline constexpr double kBodyHalfHeight_mm = 14.0;

/// The bone near a point.
struct BoneSample {
  double distance_mm = 0;  ///< signed distance to the outer surface, negative inside
  double cortical_mm = 1;  ///< thickness of the cortical shell near the point
};

/// The bone (all vertebrae) at a point of the anatomical frame. The distance is 1-Lipschitz
/// (sdf.h). It has the sign of the exact distance, and its magnitude never exceeds that of the
/// exact distance. At the side walls of a vertebral body the magnitude is at most 4 % too small.
BoneSample sample_bone(Vec3 p);

/// Signed distance from the vertebral canal, negative inside. The canal has the same cross-section
/// at every height, 23 mm wide and 16 mm deep.
double canal_distance_mm(Vec3 p);

/// Signed distance from the column of vertebral bodies and discs, positive outside. At every
/// height, the column has the outline of the body, grown by 1 mm, because the discs bulge.
double disc_column_distance_mm(Vec3 p);

// The phantom: tissue and radio-density (HU) at any point in space. Formulas describe the shape of
// the bone (above); soft tissue is made of simple solids. Bone and soft tissue have a faint
// random texture, which depends on a seed. render.h computes pixels and slices and adds noise.
//
// Scan frame: DICOM's patient frame, LPS in mm, z along the patient. The anatomy is slightly
// rotated about z and shifted in this frame (PhantomOptions), so that nothing is aligned with the
// pixel grid by accident.
//
// The HU include the scanner's in-plane blur (point spread). The blur is a formula: at the signed
// distance d from a surface, the HU are f times those of the inner tissue plus 1 - f times those of
// the outer tissue, with f = Phi(-d / sigma). Phi is the cumulative normal distribution, and sigma
// is PhantomOptions::edge_sigma_mm. The formula is exact for a flat surface, and a close
// approximation if the radius of curvature is larger than sigma.

/// Mean radio-density of each tissue in HU.
struct TissueHu {
  double air = -1000;
  double fat = -100;
  double skin = 40;
  double muscle = 55;
  double bowel = 30;
  double vessel = 48;
  double disc = 90;
  double canal = 20;
  double cortical = 900;
  double cancellous = 315;
  double cancellous_texture = 40;  ///< largest deviation from `cancellous`
  double soft_texture = 9;         ///< largest deviation in fat, muscle and bowel
};

struct PhantomOptions {
  std::uint64_t seed = 1;  ///< seed of the textures
  TissueHu tissue;
  double edge_sigma_mm = 0.4;   ///< standard deviation of the in-plane blur; 0 gives sharp edges
  double rotation_rad = 0.045;  ///< rotation of the anatomy about z in the scan frame
  Vec2 shift_mm{1.7, -1.2};     ///< shift of the anatomy in the scan frame
};

/// Transforms a point from the scan frame to the anatomical frame.
Vec3 to_anatomy(const PhantomOptions& phantom, Vec3 p_scan);

/// The bone at a point of the scan frame (above): the thickness of the cortical shell, and the
/// signed distance from the bone's outer surface. The distance is negative inside, and 1-Lipschitz:
/// from point to point it changes by at most the distance of the points.
BoneSample sample_bone(const PhantomOptions& phantom, Vec3 p_scan);

/// Volume fractions, 0..1, of bone and of its cancellous core at a point, after the in-plane blur.
/// core <= bone.
struct BoneFractions {
  double bone = 0;
  double core = 0;
  BoneFractions& operator+=(BoneFractions o) { return bone += o.bone, core += o.core, *this; }
  friend BoneFractions operator*(BoneFractions f, double s) { return {f.bone * s, f.core * s}; }
};
BoneFractions blurred_fractions(const PhantomOptions& phantom, const BoneSample& bone);

/// At a point farther than this from a surface, blurred_fractions() differ from 0 or 1 by less than
/// 4e-4 (less than 0.5 HU), so they may be set to 0 or 1.
double blur_radius_mm(const PhantomOptions& phantom);

/// soft_tissue_hu() returns the HU that a point of the scan frame would have if there were no bone.
/// cancellous_hu() returns the HU that it would have if it were in the cancellous core.
double soft_tissue_hu(const PhantomOptions& phantom, Vec3 p_scan);
double cancellous_hu(const PhantomOptions& phantom, Vec3 p_scan);

/// HU of a mixture of soft tissue, cortical bone and cancellous core.
inline double mixed_hu(const PhantomOptions& phantom, BoneFractions fraction, double soft_hu,
                       double core_hu) {
  return soft_hu + (phantom.tissue.cortical - soft_hu) * fraction.bone +
         (core_hu - phantom.tissue.cortical) * fraction.core;
}

}  // namespace trocar::sample
