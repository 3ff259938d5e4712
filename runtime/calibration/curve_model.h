// SPDX-License-Identifier: Apache-2.0
// The force that the law `cutting` (runtime/bone_cutting/law/cutting_law.h) gives if a testing machine pushes a tool
// into uniform tissue, and pulls it out again. The law has closed solutions for this motion:
//  - The tip is a spring against the cutting front until its force equals the strength. From then on the front
//    follows the tip, and the tip's force is the strength, S + drift * (cut depth - middle).
//  - A hard layer at the surface has a constant strength of its own. Where it ends, the force falls over the length
//    `fall_mm`; in the law itself it falls at once.
//  - The shaft adds friction * cut depth. During a withdrawal friction has the other sign and acts on the whole
//    length below the surface, and the tip adds nothing.
// Tests: tests/runtime/calibration/curve_fit_test.cpp
#pragma once

#include <array>
#include <cstdint>

namespace trocar::runtime {

enum CurveParameter : std::uint8_t {
  kBaseline,      ///< the load cell's force before contact, N
  kContact,       ///< depth of the surface, mm
  kLogStiffness,  ///< logarithm of the tip's stiffness in N/mm
  kCutting,       ///< strength at the middle of the cut, N
  kFriction,      ///< friction per embedded length, N/mm
  kDrift,         ///< change of the strength with depth, N/mm
  kLayerForce,    ///< strength of the hard layer, N
  kLayerEnd,      ///< depth at which the force falls from the hard layer's, mm
  kCurveParameters
};
using CurveParameters = std::array<double, kCurveParameters>;

struct CurveShape {
  double middle_mm = 0;  ///< cut depth at which kCutting holds
  bool has_layer = false;
  double fall_mm = 0.1;  ///< above 0
};

/// Force in N during the insertion and during the withdrawal, at a depth in mm.
double insertion_N(const CurveParameters& parameters, const CurveShape& shape, double depth_mm);
double withdrawal_N(const CurveParameters& parameters, double depth_mm);

}  // namespace trocar::runtime
