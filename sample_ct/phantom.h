// SPDX-License-Identifier: Apache-2.0
// The phantom: tissue and radio-density (HU) at any point in space. Formulas describe the shape of
// the bone (vertebra.h); soft tissue is made of simple solids. Bone and soft tissue have a faint
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
#pragma once

#include <cstdint>

#include "sample_ct/sdf.h"
#include "sample_ct/vertebra.h"

namespace trocar::sample {

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

/// The bone at a point of the scan frame (vertebra.h): the thickness of the cortical shell, and the
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
