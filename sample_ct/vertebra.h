// SPDX-License-Identifier: Apache-2.0
// The bone of the phantom: an L3-like lumbar vertebra as a blend of analytic solids. The same
// vertebra is repeated above and below, so that the facet joints (the small joints between the
// arches of neighbouring vertebrae) are complete, as in a real scan.
//
// Anatomical frame (mm): x to the patient's left, y to the back, z up; origin at the middle of the
// vertebral body of the middle vertebra. The left half is the mirror image of the right half.
// Proportions follow a clinical CT of an L3 (see README.md).
#pragma once

#include "sample_ct/sdf.h"

namespace trocar::sample {

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

}  // namespace trocar::sample
