// SPDX-License-Identifier: Apache-2.0
// The bone of the phantom: an L3-like lumbar vertebra as a blend of analytic solids, with the same
// vertebra above and below it, so that the facet joints are complete, as in a real scan.
//
// Anatomical frame (mm): x to the patient's left, y to the back, z up; origin
// at the middle of the vertebral body of the middle vertebra. Left and right are
// mirror images. Proportions follow a clinical CT of an L3 (see README.md).
// Tests: tests/sample_ct/phantom_test.cpp
#pragma once

#include "sample_ct/sdf.h"

namespace trocar::sample {

/// Distance between neighbouring vertebrae along z: 28 mm for the body and 10 mm for the disc.
inline constexpr double kVertebraPitch_mm = 38.0;
/// Half the height of the vertebral body at the edge of its end plates.
inline constexpr double kBodyHalfHeight_mm = 14.0;

/// The bone near a point.
struct BoneSample {
  double distance_mm = 0;  ///< signed distance to the outer surface, negative inside
  double cortical_mm = 1;  ///< thickness of the cortical shell near the point
};

/// The bone (all vertebrae) at a point of the anatomical frame. The distance is 1-Lipschitz. It has
/// the sign of the exact distance and never exceeds the exact distance in magnitude. On the walls
/// of the body it is at most 4 % smaller.
BoneSample sample_bone(Vec3 p);

/// sample_bone(p).distance_mm.
double bone_distance_mm(Vec3 p);

/// Signed distance from the vertebral canal, which is the same at every height: 23 mm wide and 16
/// mm deep.
double canal_distance_mm(Vec3 p);

/// Signed distance from the column of vertebral bodies and discs, positive outside. The body's
/// outline continues through the discs, which bulge by 1 mm.
double disc_column_distance_mm(Vec3 p);

}  // namespace trocar::sample
