// SPDX-License-Identifier: Apache-2.0
// A spring that yields: elastic below a force, with constant force beyond it (Huber, 1964).
// Tests: tests/runtime/bone_cutting/law/cutting_law_test.cpp
#pragma once

namespace trocar::runtime {

/// Energy, force and second derivatives, along the spring and across it.
struct YieldSpring {
  double energy = 0, force = 0, along = 0, across = 0;
};

/// `most`: the force at which it yields; `length` >= 0. With `majorise`, the second derivative along the spring
/// is that of a parabola that lies above the energy everywhere.
inline YieldSpring yield_spring(double stiffness, double most, double length,
                                bool majorise) noexcept {
  if (stiffness * length <= most)
    return {0.5 * stiffness * length * length, stiffness * length, stiffness, stiffness};
  const double across = most / length;
  return {most * length - 0.5 * most * most / stiffness, most, majorise ? across : 0, across};
}

}  // namespace trocar::runtime
