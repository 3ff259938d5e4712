// SPDX-License-Identifier: Apache-2.0
// Computes the force on a tool that a testing machine pushes into uniform tissue and pulls out
// again. The force follows from the force law `cutting` (runtime/bone_cutting/law/cutting_law.h),
// which has a solution in closed form for this motion:
//  - The cutting front is the depth down to which tissue has been cut. A spring acts between the
//    tip and the front. When the spring's force reaches the strength of the tissue, cutting begins:
//    the front then follows the tip, and the tip's force is the strength, which is
//    kCutting + kDrift * (cut depth - middle_mm).
//  - A hard layer at the surface has a constant strength of its own. In the law the force falls
//    immediately where the layer ends. Here, however, the force falls over the length `fall_mm`.
//  - The shaft adds the friction kFriction * cut depth. During a withdrawal the friction has the
//    other sign and acts on the whole length below the surface. The tip then adds no force.
// Tests: tests/runtime/calibration/curve_fit_test.cpp
#pragma once

#include <array>
#include <cstdint>

namespace trocar::runtime {

enum CurveParameter : std::uint8_t {
  kBaseline,      ///< the load cell's force before contact, N
  kContact,       ///< depth of the surface, mm
  kLogStiffness,  ///< natural logarithm of the tip's stiffness in N/mm
  kCutting,       ///< strength at the cut depth CurveShape::middle_mm, N
  kFriction,      ///< friction per embedded length, N/mm
  kDrift,         ///< change of the strength with depth, N/mm
  kLayerForce,    ///< strength of the hard layer, N
  kLayerEnd,      ///< depth of the middle of the stretch in which the layer's force falls, mm
  kCurveParameters
};
using CurveParameters = std::array<double, kCurveParameters>;

struct CurveShape {
  double middle_mm = 0;  ///< cut depth at which the strength is kCutting
  bool has_layer = false;
  double fall_mm = 0.1;  ///< length of the stretch in which the layer's force falls; above 0
};

/// Force in N at a depth in mm: insertion_N() during the insertion, withdrawal_N() during the
/// withdrawal.
double insertion_N(const CurveParameters& parameters, const CurveShape& shape, double depth_mm);
double withdrawal_N(const CurveParameters& parameters, double depth_mm);

}  // namespace trocar::runtime
